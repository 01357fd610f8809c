"""Steady tasks of an armed vehicle on the ground or in its take-off ramp."""

from __future__ import annotations

from vehicle_sim.autopilot.arming import auto_disarm_after_s
from vehicle_sim.autopilot.commander import Commander
from vehicle_sim.autopilot.land_detector import LandDetector
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.autopilot.navigator import LANDING_MODES, Navigator
from vehicle_sim.autopilot.path import TICK_S
from vehicle_sim.autopilot.steady_task import ON_GROUND, SteadyTask
from vehicle_sim.autopilot.takeoff import TakeoffRamp, TakeoffState
from vehicle_sim.vehicle_view import VehicleView


def ground_task(
    view: VehicleView,
    commander: Commander,
    navigator: Navigator,
    takeoff: TakeoffRamp,
    detector: LandDetector,
) -> SteadyTask | None:
    """The steady task until the take-off or landing state changes; None if the mode needs full ticks."""
    mode, state = commander.active, takeoff.state
    in_ground_contact = state is TakeoffState.FLIGHT and detector.ground_contact
    if navigator.awaits_rally_check:
        return None
    if mode is NavState.TAKEOFF and state is TakeoffState.RAMPUP:
        task = navigator.steady_task(mode) if view.parameter("MPC_TKO_RAMP_T") > TICK_S else None
    elif mode is NavState.TAKEOFF and state is TakeoffState.SPOOLUP:
        task = ON_GROUND._replace(
            wait_start_s=takeoff.armed_at_s, wait_duration_s=view.parameter("COM_SPOOLUP_TIME")
        )
    elif mode in LANDING_MODES and (in_ground_contact or state is TakeoffState.READY):
        task = ON_GROUND
    else:
        return None
    if task is None:
        return None
    task = task._replace(takeoff=state, landing_stages=detector.stages)
    if commander.landed and state is not TakeoffState.SPOOLUP:  # the task ends at the automatic disarming
        since_s = commander.landed_at_s if commander.took_off else commander.armed_at_s
        wait_s = auto_disarm_after_s(view, took_off=commander.took_off)
        task = task._replace(wait_start_s=since_s, wait_duration_s=wait_s)
    return task


def is_on_ground_or_ramping(takeoff: TakeoffRamp, detector: LandDetector) -> bool:
    """Whether the vehicle is on the ground or in its take-off ramp."""
    return not takeoff.flying or detector.stages != 0.0
