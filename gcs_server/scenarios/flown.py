"""What was flown, as checks need it: the true motion of simulated vehicles, and what their autopilots did."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from missions.dry_run.clearance import FenceDistance
from missions.dry_run.setup import AnyObstacle
from vehicle_sim.autopilot.announcer import StatusText
from vehicle_sim.autopilot.autopilot import Autopilot
from vehicle_sim.autopilot.failsafe import Cause
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.fleet import SimulatedFleet

Array = NDArray[np.float64]
SAMPLE_PERIOD_S = 0.1
SEVERITY_WARNING = 4
MAX_WARNINGS = 50


@dataclass(frozen=True, slots=True)
class VehicleFlight:
    """The flight of one vehicle, from its first arming; N samples, ten a second."""

    name: str
    """Its role; of a single vehicle "vehicle"."""
    t_s: Array
    """(N,) time since the first vehicle of the flight was armed."""
    position_ned_m: Array
    """(N, 3) true position from the home of the first vehicle."""
    speed_m_s: Array
    """(N,) true speed."""
    battery_share: Array
    """(N,) charge, 0 to 1."""
    setpoint_age_s: Array
    """(N,) greatest age of the newest setpoint since the sample before; NaN: not in Offboard."""
    modes: tuple[tuple[float, str], ...]
    """Time and name of each mode while armed."""
    failsafes: tuple[tuple[float, str], ...]
    """Time, mode and the vehicle's reason of each failsafe that took over."""
    armed: bool
    """Whether it was ever armed."""
    landed_s: float | None
    """When it was disarmed on the ground at its end; None: it was not."""
    warnings: tuple[str, ...]
    """The vehicle's own warnings, oldest first."""


@dataclass(frozen=True, slots=True)
class Flown:
    """A flight of a scenario, with what surrounded it."""

    vehicles: tuple[VehicleFlight, ...]
    finished: bool
    """Whether the program came to its own end: the whole plan or mission, a return without an error."""
    end_reason: str
    """Why it did not finish; empty: it did."""
    faults: tuple[str, ...] = ()
    """What fails every scenario: a vehicle that does not arm, a collision, no end in time."""
    fence: FenceDistance | None = None
    """The geofence of the plan and of the vehicle's parameters; None: none."""
    obstacles: Sequence[AnyObstacle] = ()

    @property
    def duration_s(self) -> float:
        """Time from arming to the end [s]."""
        return max((float(each.t_s[-1]) for each in self.vehicles if len(each.t_s)), default=0.0)


@dataclass(slots=True)
class _Recorded:
    """What is recorded of one vehicle, with times since boot."""

    samples: list[tuple[float, ...]] = field(default_factory=list[tuple[float, ...]])
    modes: list[tuple[float, str]] = field(default_factory=list[tuple[float, str]])
    failsafes: list[tuple[float, str]] = field(default_factory=list[tuple[float, str]])
    warnings: list[str] = field(default_factory=list[str])
    armed_s: float | None = None
    disarmed_s: float | None = None
    mode: NavState | None = None
    in_failsafe: bool = False
    offboard_since_s: float | None = None
    setpoint_age_s: float = math.nan
    ended: bool = False


class FlightRecorder:
    """Records vehicles of a simulation; call `tick` after each step of the autopilots.

    Args:
        fleet: the simulation.
    """

    def __init__(self, fleet: SimulatedFleet) -> None:
        self._fleet = fleet
        self._vehicles = [_Recorded() for _ in fleet.autopilots]
        self._ticks = 0
        for autopilot, recorded in zip(fleet.autopilots, self._vehicles, strict=True):
            autopilot.announcer.add_listener(_warning_listener(recorded))

    def tick(self, sample: bool) -> None:
        """Notes changes of mode and failsafe, and with `sample` position, speed, charge."""
        now_s = self._fleet.time_s
        for recorded, autopilot in zip(self._vehicles, self._fleet.autopilots, strict=True):
            if not recorded.ended:
                _observe(recorded, autopilot, now_s)
        if not sample:
            return
        simulation = self._fleet.simulation
        positions = simulation.truth.position_ned_m
        speeds = np.linalg.norm(simulation.truth.velocity_ned_m_s, axis=1)
        charges = simulation.battery.remaining
        for row, recorded in enumerate(self._vehicles):
            if recorded.armed_s is not None and not recorded.ended:
                north, east, down = positions[row].tolist()
                recorded.samples.append(
                    (
                        now_s,
                        north,
                        east,
                        down,
                        float(speeds[row]),
                        float(charges[row]),
                        recorded.setpoint_age_s,
                    )
                )
                recorded.setpoint_age_s = math.nan

    def end(self, row: int) -> None:
        """Records no more of a vehicle, whose flight has ended."""
        self._vehicles[row].ended = True

    def armed(self, row: int) -> bool:
        """Whether a vehicle was ever armed."""
        return self._vehicles[row].armed_s is not None

    def landed(self, row: int) -> bool:
        """Whether a vehicle is disarmed after a flight."""
        return self._vehicles[row].disarmed_s is not None

    def flights(self, rows: Mapping[int, str]) -> tuple[VehicleFlight, ...]:
        """The flight of some vehicles (row: name), on one time: since the first of them was armed."""
        armings = [s for row in rows if (s := self._vehicles[row].armed_s) is not None]
        zero_s = min(armings, default=0.0)
        return tuple(_flight(self._vehicles[row], name, zero_s) for row, name in rows.items())


def _warning_listener(recorded: _Recorded) -> Callable[[object], None]:
    def listen(message: object) -> None:
        if not isinstance(message, StatusText) or message.severity > SEVERITY_WARNING:
            return
        if len(recorded.warnings) < MAX_WARNINGS:
            recorded.warnings.append(message.text.strip())

    return listen


def _observe(recorded: _Recorded, autopilot: Autopilot, now_s: float) -> None:
    commander = autopilot.commander
    if not commander.armed:
        if recorded.armed_s is not None and recorded.disarmed_s is None:
            recorded.disarmed_s = now_s
        recorded.offboard_since_s = None
        return
    if recorded.armed_s is None:
        recorded.armed_s = now_s
    recorded.disarmed_s = None
    if recorded.offboard_since_s is not None:
        age_s = now_s - max(autopilot.offboard.received_at_s, recorded.offboard_since_s)
        recorded.setpoint_age_s = np.fmax(age_s, recorded.setpoint_age_s).item()
    if commander.active is not recorded.mode:
        recorded.mode = commander.active
        recorded.modes.append((now_s, commander.active.name.lower()))
        recorded.offboard_since_s = now_s if commander.active is NavState.OFFBOARD else None
    if commander.in_failsafe and not recorded.in_failsafe:
        mode = commander.active.name.lower().replace("rtl", "return")
        recorded.failsafes.append((now_s, f"{mode}: {_failsafe_reason(recorded, autopilot)}"))
    recorded.in_failsafe = commander.in_failsafe


def _failsafe_reason(recorded: _Recorded, autopilot: Autopilot) -> str:
    """Why a failsafe takes over; PX4's own text is often only "Failsafe activated"."""
    commander = autopilot.commander
    if commander.failsafe.cause is not Cause.GENERIC:
        return commander.failsafe.cause.name.lower().replace("_", " ")
    reasons = [] if autopilot.view.estimate.valid_position else ["no valid position estimate"]
    if commander.intended is NavState.OFFBOARD and not autopilot.offboard.has_signal():
        age_s = autopilot.view.time_s - autopilot.offboard.received_at_s
        reasons.append(f"no setpoint for {age_s:.1f} s")
    return " and ".join(reasons) or (recorded.warnings[-1].rstrip(".") if recorded.warnings else "no reason")


def _flight(recorded: _Recorded, name: str, zero_s: float) -> VehicleFlight:
    samples = np.array(recorded.samples, dtype=float).reshape(-1, 7)

    def since(events: Sequence[tuple[float, str]]) -> tuple[tuple[float, str], ...]:
        return tuple((round(s - zero_s, 2), text) for s, text in events)

    disarmed_s = recorded.disarmed_s
    return VehicleFlight(
        name,
        np.round(samples[:, 0] - zero_s, 2),
        samples[:, 1:4],
        samples[:, 4],
        samples[:, 5],
        samples[:, 6],
        since(recorded.modes),
        since(recorded.failsafes),
        recorded.armed_s is not None,
        None if disarmed_s is None else round(disarmed_s - zero_s, 2),
        tuple(recorded.warnings),
    )
