"""The result of a dry run as clients read it (`GET /dry_runs/{d}`): each class is also a schema of the API.

This module needs no simulator, so that the server can describe the result.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from missions.dry_run.setup import Conditions
from missions.dry_run.spread import Chance, Quantiles, Spread
from missions.frames import Quaternion, Vector3

Array = NDArray[np.float64]
DIGITS = 4
"""Decimals of all numbers but lengths and times."""

CODES: dict[str, tuple[Literal["error", "warning"], str]] = {
    "item_refused": ("error", "the vehicle refuses an item of the plan"),
    "start_refused": ("error", "the vehicle cannot be armed, or does not start the mission"),
    "fence_touched": ("error", "the flight leaves the geofence"),
    "obstacle_hit": ("error", "the flight ends at an obstacle or at steep ground"),
    "ground_touched": ("error", "the flight touches rising ground"),
    "failsafe": ("error", "a failsafe of the vehicle takes over"),
    "mission_left": ("error", "the vehicle leaves the mission before its end"),
    "not_finished": ("error", "the flight did not finish within the allowed time"),
    "battery_empty": ("error", "the battery is empty before the end"),
    "battery_reserve": ("warning", "less than the battery's reserve is left at the end"),
    "battery_unknown": ("warning", "the battery's discharge rate is unknown"),
    "obstacle_near": ("warning", "the flight comes closer than 2 m to an obstacle"),
    "obstacle_avoided": ("warning", "the vehicle leaves its path to avoid an obstacle"),
    "avoidance_stopped": ("error", "obstacle avoidance finds no way, and the vehicle waits"),
    "separation": ("error", "two vehicles of the mission come too near to each other"),
    "ends_in_air": ("warning", "the flight ends in the air; the vehicle holds its position"),
}
"""Severity and meaning of each code."""


@dataclass(frozen=True, slots=True)
class DryRunFinding:
    """A problem that the dry run found."""

    code: str
    """Stable code; `docs/missions.md` lists all."""
    text: str
    """Message for the pilot."""
    step: str | None = None
    """Step in which the problem occurred (its `place`)."""
    t_s: float | None = None
    """Time since the start of the flight [s]."""
    position_ned_m: Vector3 | None = None
    """Position of the vehicle, from `origin` [m]."""
    severity: Literal["error", "warning"] = field(init=False)
    """error: do not fly this plan; warning: check the plan."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "severity", CODES[self.code][0])


@dataclass(frozen=True, slots=True)
class StepTime:
    """One execution of a step; a repeated step is listed once for each execution."""

    place: str
    """`item 3` of a waypoint plan, `step 4.2` of an offboard mission."""
    title: str
    """Title of the step."""
    row: int | None
    """Index in the plan's `items`; null for an offboard mission."""
    start_s: float
    """Begin, since the start of the flight [s]."""
    end_s: float
    """End, since the start of the flight [s]."""
    fence_distance_m: float | None
    """Smallest distance to the geofence [m]; negative: outside; null: no geofence."""
    obstacle_distance_m: float | None
    """Smallest distance to an obstacle [m]; null: no obstacles."""


@dataclass(frozen=True, slots=True)
class FlownPath:
    """The flown path; all lists are equally long."""

    t_s: list[float]
    """Time since the start [s]; 10 Hz, for long flights reduced to 4000 samples."""
    position_ned_m: list[Vector3]
    """Position from `origin` [m]."""
    velocity_ned_m_s: list[Vector3]
    """Velocity [m/s]."""
    q_ned_frd: list[Quaternion]
    """Attitude: rotation from body FRD to NED, order w, x, y, z."""
    gimbal_rad: list[tuple[float, float]]
    """Pitch (up is positive), yaw from north [rad]."""
    battery_share: list[float] | None
    """Battery charge, 0 to 1; null: not known."""
    ground_m: list[float] | None
    """Altitude of the ground below the vehicle, above `origin` [m]; null: level ground."""
    step: list[int]
    """Index in `step_places`; -1: no step."""
    step_places: list[str]
    """Names of the flown steps."""


@dataclass(frozen=True, slots=True)
class FlightResult:
    """The flight in the requested conditions."""

    conditions: Conditions
    """Conditions of this flight."""
    finished: bool
    """Whether the whole plan was flown."""
    landed: bool
    """Whether the vehicle was on the ground and disarmed at the end."""
    duration_s: float
    """Time from arming to the end [s]."""
    length_m: float
    """Length of the flown path [m]."""
    battery_start_share: float
    """Battery charge at the start, 0 to 1."""
    battery_end_share: float | None
    """Battery charge at the end; null: the battery's drain is not known."""
    fence_distance_m: float | None
    """Smallest distance to the geofence [m]; negative: outside; null: no geofence."""
    obstacle_distance_m: float | None
    """Smallest distance to an obstacle [m]; null: no obstacles."""
    steps: tuple[StepTime, ...]
    """Steps in flown order."""
    findings: tuple[DryRunFinding, ...]
    """Errors first; at most 100."""
    times_real_time: float
    """Simulation speed relative to real time."""


@dataclass(frozen=True, slots=True)
class Band:
    """Quantiles of a deviation at each point of the corridor [m]."""

    p5: Array
    """5 % quantile."""
    p50: Array
    """Median."""
    p95: Array
    """95 % quantile."""
    greatest: Array
    """The deviation with the largest magnitude, signed."""


@dataclass(frozen=True, slots=True)
class Corridor:
    """Deviation of the flights from the nominal flight, at up to 400 points of the nominal path."""

    t_s: Array
    """Time since the start of the nominal flight [s]."""
    position_ned_m: Array
    """Position of the nominal flight, from `origin` [m]."""
    horizontal_m: Band
    """Horizontal deviation."""
    vertical_m: Band
    """Vertical deviation; positive: higher."""

    @property
    def width_m(self) -> float:
        """The largest horizontal deviation."""
        return float(self.horizontal_m.greatest.max(initial=0.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightSummary(Conditions):
    """Conditions and summary of one flight."""

    finished: bool
    """Whether the whole plan was flown."""
    duration_s: float
    """Time from arming to the end [s]."""
    battery_end_share: float | None
    """Battery charge at the end; null: not known."""
    fence_distance_m: float | None
    """Smallest distance to the geofence [m]; null: no geofence."""
    obstacle_distance_m: float | None
    """Smallest distance to an obstacle [m]; null: no obstacles."""
    findings: tuple[str, ...]
    """Codes of the flight's findings."""


@dataclass(frozen=True, slots=True)
class MonteCarloResult:
    """Many flights, each in different conditions."""

    spread: Spread
    """How the conditions varied."""
    seed: int
    """Seed of the varied conditions, noise and gusts."""
    flights: tuple[FlightSummary, ...]
    """All flights except the nominal flight."""
    corridor: Corridor | None
    """Null: the nominal flight did not start."""
    duration_s: Quantiles | None
    """Duration of the finished flights [s]; null: no flight was finished."""
    battery_end_share: Quantiles | None
    """Battery charge at the end, 0 to 1; null: unknown."""
    fence_distance_m: Quantiles | None
    """Smallest distance to the geofence [m]."""
    obstacle_distance_m: Quantiles | None
    """Smallest distance to an obstacle [m]."""
    chances: dict[str, Chance]
    """Probability of `not_finished`, `fence_touched`, `obstacle_hit`, `obstacle_near` (2 m), `failsafe` and
    `battery_reserve`; with roles also of `separation` (the separation guard would act) and
    `nearer_than_minimum` (two vehicles come nearer than the minimum separation)."""
    times_real_time: float
    """Simulated time of all flights divided by computing time."""


@dataclass(frozen=True, slots=True)
class ClosestApproach:
    """Smallest distance between two vehicles."""

    roles: tuple[str, str]
    """Their roles."""
    distance_m: float
    """Distance between the vehicles' centres [m]."""
    t_s: float
    """Time since the common start [s]."""


@dataclass(frozen=True, slots=True)
class PairDistance:
    """Smallest distance between two vehicles in many flights."""

    roles: tuple[str, str]
    """Their roles."""
    distance_m: Quantiles
    """Smallest distance of each flight, between the centres [m]."""
    nearer_than_minimum: Chance
    """Probability that the two vehicles come nearer than the mission's minimum separation."""


def plain(value: Any, shape: Any = None, digits: int = DIGITS) -> Any:
    """A value as JSON values, with rounded numbers.

    Args:
        value: an object of this module, or a part of it.
        shape: the class whose fields the document has; None: the value's own class.
        digits: decimals of numbers; lengths and times have two.
    """
    if dataclasses.is_dataclass(value):
        names = [each.name for each in dataclasses.fields(shape or value)]
        return {name: plain(getattr(value, name), digits=_digits(name, digits)) for name in names}
    if isinstance(value, Mapping):
        return {name: plain(each, digits=digits) for name, each in value.items()}  # type: ignore[misc]
    if isinstance(value, tuple | list):
        return [plain(each, digits=digits) for each in value]  # type: ignore[misc]
    if isinstance(value, np.ndarray):
        return np.round(value, digits).tolist()
    return round(float(value), digits) if isinstance(value, float) else value


def _digits(name: str, digits: int) -> int:
    return 2 if name.endswith(("_m", "_s")) else digits
