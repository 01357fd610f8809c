"""Obstacle avoidance of a simulated vehicle: the avoidance of real flights, with simulated sensors."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from missions.avoidance.scans import Scan
from missions.avoidance.setpoints import SetpointAvoidance, Surroundings
from missions.avoidance.values import DetourLimits, MotionState
from missions.dry_run.document import DryRunFinding
from missions.dry_run.fleet import TICK_S, Vehicle
from missions.dry_run.pilot import Step, finding_now
from missions.frames import Quaternion, Vector3, rotate
from missions.runner.sampler import ScriptSampler
from missions.setpoints import DirectSetpoint
from vehicle_sim.world.lidar import SECTOR_DEG, SECTORS

STOPPED_S = 5.0
"""If avoidance stops the vehicle for this long, a finding reports that there is no way around [s]."""
SCAN_EVERY_TICKS = 10
"""5 Hz, the rate that the server requests from a real vehicle."""
_ANGLES = np.radians(SECTOR_DEG) * np.arange(SECTORS)
_FORWARD, _RIGHT = np.cos(_ANGLES)[:, None], np.sin(_ANGLES)[:, None]


class ObstacleLidar:
    """The sensors of one vehicle. All vehicles of a fleet measure at the same ticks, because the rays of all
    are computed at once."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._view = vehicle.autopilot.view
        self._steps_per_tick = round(TICK_S / self._view.simulation.dt_s)
        self._scans: tuple[Scan, ...] = ()

    def scans(self, now_s: float) -> tuple[Scan, ...]:
        """The newest scan of each sensor."""
        tick = self._view.simulation.steps // self._steps_per_tick
        if not self._scans or tick % SCAN_EVERY_TICKS == 0:
            self._scans = (self._around(now_s), self._down(now_s))
        return self._scans

    def _around(self, now_s: float) -> Scan:
        simulation, row = self._view.simulation, self._view.row
        measured_m = simulation.distances_around_m(row).tolist()
        distances_m = tuple(each if math.isfinite(each) else None for each in measured_m)
        directions = _sector_directions(self._view.estimate.q_ned_frd)
        half_sector_rad = math.radians(SECTOR_DEG / 2.0)
        return Scan(now_s, directions, distances_m, simulation.world.lidars.range_m, half_sector_rad)

    def _down(self, now_s: float) -> Scan:
        measured_m = self._view.simulation.distance_down_m(self._view.row)
        direction = rotate(self._view.estimate.q_ned_frd, (0.0, 0.0, 1.0))
        distance_m = measured_m if math.isfinite(measured_m) else None
        return Scan(now_s, (direction,), (distance_m,), self._view.parameter("SIH_DISTSNSR_MAX"))


def _sector_directions(q_ned_frd: Quaternion) -> tuple[Vector3, ...]:
    """Directions of the sectors, clockwise from the nose."""
    forward = np.array(rotate(q_ned_frd, (1.0, 0.0, 0.0)))
    right = np.array(rotate(q_ned_frd, (0.0, 1.0, 0.0)))
    rows: NDArray[np.float64] = _FORWARD * forward + _RIGHT * right
    return tuple((n, e, d) for n, e, d in rows.tolist())


class SimulatedAvoidance:
    """Avoidance of one vehicle, in the steps whose avoidance is on.

    Args:
        vehicle: the simulated vehicle.
        findings: receives a finding for each step in which the vehicle flies a detour or finds no way.
    """

    def __init__(self, vehicle: Vehicle, findings: list[DryRunFinding]) -> None:
        self._vehicle, self._findings = vehicle, findings
        self._lidar = ObstacleLidar(vehicle)
        self._avoidance = SetpointAvoidance()
        self._stopped_since_s: float | None = None
        self._reported: set[tuple[str, Step | None]] = set()
        self.is_needed = not vehicle.autopilot.view.simulation.world.empty
        """Whether the simulated world has anything to avoid."""

    def reset(self) -> None:
        """Ends a detour; called when the mission sends no setpoints."""
        self._avoidance.reset()
        self._stopped_since_s = None

    def apply(
        self, now_s: float, sampler: ScriptSampler, requested: DirectSetpoint, position_ned_m: Vector3 | None
    ) -> DirectSetpoint:
        """The setpoint to send instead of the requested one.

        Args:
            now_s: simulated time.
            sampler: the mission, which states whether avoidance is on.
            requested: the mission's current setpoint.
            position_ned_m: position of the vehicle in the mission's local frame.
        """

        def surroundings() -> Surroundings:
            estimate = self._vehicle.autopilot.view.estimate
            motion = None
            if position_ned_m is not None:
                motion = MotionState(position_ned_m, estimate.velocity_ned_m_s, estimate.yaw_ned_rad)
            return Surroundings(motion, self._lidar.scans(now_s), DetourLimits(fence=sampler.fence))

        # Avoidance that a step requests ends with the step, but never during a detour.
        avoidance = self._avoidance
        way = avoidance.way if avoidance.is_on_detour else sampler.avoidance
        return avoidance.apply(
            now_s, requested, lambda at_s: sampler.setpoint_ahead(at_s - now_s), way, surroundings
        )

    def add_findings(self, now_s: float, step: Step | None, t_s: float) -> None:
        """Adds a finding when the vehicle leaves its path or has no way around.

        Args:
            now_s: simulated time.
            step: the current step.
            t_s: time since the start of the flight.
        """
        status = self._avoidance.status
        where = "the start" if step is None else step.place
        if status is None or status.state != "stopped":
            self._stopped_since_s = None
        elif self._stopped_since_s is None:
            self._stopped_since_s = now_s
        elif now_s - self._stopped_since_s >= STOPPED_S:
            self._report("avoidance_stopped", f"The vehicle waits at {where}: {status.text}", step, t_s)
        if status is not None and status.state in ("over", "around"):
            message = (
                f"The vehicle leaves its path at {where} to avoid an obstacle. In a real flight, only the "
                "obstacle sensor can detect the obstacle."
            )
            self._report("obstacle_avoided", message, step, t_s)

    def _report(self, code: str, message: str, step: Step | None, t_s: float) -> None:
        if (code, step) not in self._reported:
            self._reported.add((code, step))
            self._findings.append(finding_now(code, message, step, t_s, self._vehicle))
