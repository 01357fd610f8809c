"""Records how a vehicle flew, and compares the flight with its plan: offboard missions and waypoint plans."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from missions.frames import Vector3
from missions.geodesy import LocalOrigin
from missions.offboard.samples import Leg, legs, setpoint_time_s
from missions.offboard.timeline import Timeline
from missions.runner.reading import Reading
from missions.runner.requests import RunnerStatus

PERIOD_S = 0.5
MAX_SAMPLES = 4000
"""Half an hour at 2 Hz. For a longer flight every second sample is deleted, and the period is doubled."""
PlannedBy = Literal["mission", "dry_run", "plan"]


@dataclass(frozen=True, slots=True)
class FlownSample:
    """The flown and the planned position at one time."""

    t_s: float
    """Time since the start of the mission."""
    place: str | None
    """Current step: "step 3", "step 4.2" of an offboard mission, "item 3" of a waypoint plan."""
    flown_ned_m: Vector3
    """The vehicle's position estimate, in its local frame."""
    planned_ned_m: Vector3 | None
    """Offboard mission: the position setpoint; null: PX4 flew in one of its own modes, or the setpoint had no
    position. Waypoint plan: the nearest point of the planned path; null: the vehicle was not on the planned
    path (Hold, another mode, before the path), or the planned path is not known."""
    deviation_m: float | None
    """Distance between the flown and the planned position; null: the planned position is null."""
    outside_corridor_m: float | None
    """Distance outside the dry run's corridor, 0 inside; null: no corridor is monitored."""


@dataclass(frozen=True, slots=True)
class PlannedState:
    """The planned values at one moment of the flight."""

    place: str | None = None
    """Current step."""
    planned_ned_m: Vector3 | None = None
    """See `FlownSample.planned_ned_m`."""
    outside_corridor_m: float | None = None
    """See `FlownSample.outside_corridor_m`."""
    is_counted: bool | None = None
    """Whether this time counts for `FlownMission.duration_s`; None: not known."""


@dataclass(frozen=True, slots=True)
class PlannedFlight:
    """The planned path and its figures."""

    source: PlannedBy
    duration_s: float | None
    """Planned value of `FlownMission.duration_s`; None: not known."""
    length_m: float | None
    """Length of the whole path; None: not known."""
    legs: tuple[Leg, ...]


@dataclass(frozen=True, slots=True)
class FlownMission:
    """The flown path of a vehicle's newest mission, with the planned path."""

    name: str
    started_unix_s: float
    over: bool
    """Whether the mission has ended."""
    duration_s: float
    """Duration until the end of the mission, or until now. Offboard mission: time flown by setpoints, without
    PX4's own take-off and landing. Waypoint plan: from arming to disarming."""
    planned_duration_s: float | None
    """Planned value of `duration_s`, with the longest branch; null: not known. If a plan was not flown from
    its beginning, this duration begins at the first flown item."""
    planned_length_m: float | None
    """Planned length of the whole path, with the longest branch, take-off and landing; null: not known."""
    planned_by: PlannedBy
    """Source of the planned values: the compiled offboard mission, the dry run that was named at the start,
    or the plan (straight lines between the items, and the estimated time)."""
    planned_legs: tuple[Leg, ...]
    """The planned path of each step, on all branches."""
    origin: LocalOrigin | None
    """Global position of the local origin at the start; null: not known."""
    battery_start_share: float | None
    """Battery charge at the start, 0 to 1; null: not reported."""
    battery_end_share: float | None
    """Newest battery charge of the mission, 0 to 1; null: not reported."""
    samples: tuple[FlownSample, ...]
    """Two samples per second; fewer for a flight longer than half an hour."""
    deviation_mean_m: float | None
    """Mean of the samples' `deviation_m`; null: no sample has a deviation."""
    deviation_max_m: float | None
    """Largest of the samples' `deviation_m`; null: no sample has a deviation."""


class FlownTrack:
    """The samples of one mission, at most MAX_SAMPLES."""

    def __init__(self) -> None:
        self.samples: list[FlownSample] = []
        self._period_s = PERIOD_S
        self._next_s = 0.0

    def record(self, t_s: float, position_ned_m: Vector3 | None, planned: PlannedState) -> None:
        """Adds a sample if the period has passed and the vehicle's position is known."""
        if position_ned_m is None or t_s < self._next_s:
            return
        planned_ned_m = planned.planned_ned_m
        self.samples.append(
            FlownSample(
                round(t_s, 2), planned.place, _millimetres(position_ned_m),
                None if planned_ned_m is None else _millimetres(planned_ned_m),
                None if planned_ned_m is None else round(math.dist(position_ned_m, planned_ned_m), 3),
                planned.outside_corridor_m,
            )
        )  # fmt: skip
        if len(self.samples) >= MAX_SAMPLES:
            self.samples = self.samples[::2]
            self._period_s *= 2.0
        self._next_s = t_s + self._period_s


class Stopwatch:
    """Adds up the time of the parts of a flight that count."""

    def __init__(self) -> None:
        self._counted_s = 0.0
        self._since_s: float | None = None

    def update(self, now_s: float, is_counted: bool | None) -> None:
        """Starts or stops counting; None: unknown, and counting does not change."""
        if is_counted is True and self._since_s is None:
            self._since_s = now_s
        elif is_counted is False:
            self._counted_s, self._since_s = self.read(now_s), None

    def read(self, now_s: float) -> float:
        """The counted time until now [s]."""
        return self._counted_s + (0.0 if self._since_s is None else now_s - self._since_s)


class FlightRecord:
    """The record of one flight.

    Args:
        name: name of the mission.
        unix_s: time of the start.
        now_s: the same time on the monotonic clock.
        reading: the vehicle's state at the start.
        origin: global position of the vehicle's local origin; None: not known.
        planned: returns the planned flight; called for each comparison.
    """

    def __init__(
        self,
        name: str,
        unix_s: float,
        now_s: float,
        reading: Reading,
        origin: LocalOrigin | None,
        planned: Callable[[], PlannedFlight],
    ) -> None:
        self._name = name
        self.started_unix_s = unix_s
        self._started_s = now_s
        self._over = False
        self._origin = origin
        self._battery_start_share = self._battery_end_share = reading.battery_share
        self._track, self._stopwatch = FlownTrack(), Stopwatch()
        self._planned = planned

    def record(self, now_s: float, reading: Reading, planned: PlannedState) -> None:
        """Adds the vehicle's state and the planned values; call it only until the mission ends."""
        self._track.record(now_s - self._started_s, reading.position_ned_m, planned)
        self._stopwatch.update(now_s, planned.is_counted)
        if reading.battery_share is not None:
            self._battery_end_share = reading.battery_share
            if self._battery_start_share is None:
                self._battery_start_share = reading.battery_share

    def end(self, now_s: float) -> None:
        """Ends the record; later calls do nothing."""
        if not self._over:
            self._over = True
            self._stopwatch.update(now_s, is_counted=False)

    def flown(self, now_s: float) -> FlownMission:
        """The record of the flight until now."""
        planned = self._planned()
        samples = tuple(self._track.samples)
        deviations_m = [each.deviation_m for each in samples if each.deviation_m is not None]
        mean_m = round(sum(deviations_m) / len(deviations_m), 2) if deviations_m else None
        return FlownMission(
            name=self._name,
            started_unix_s=self.started_unix_s,
            over=self._over,
            duration_s=round(self._stopwatch.read(now_s), 1),
            planned_duration_s=None if planned.duration_s is None else round(planned.duration_s, 1),
            planned_length_m=None if planned.length_m is None else round(planned.length_m, 1),
            planned_by=planned.source,
            planned_legs=planned.legs,
            origin=self._origin,
            battery_start_share=self._battery_start_share,
            battery_end_share=self._battery_end_share,
            samples=samples,
            deviation_mean_m=mean_m,
            deviation_max_m=max(deviations_m, default=None),
        )


def planned_by_mission(timeline: Timeline, start_ned_m: Vector3) -> PlannedFlight:
    """The planned flight of an offboard mission."""
    return PlannedFlight("mission", setpoint_time_s(timeline), timeline.length_m, legs(timeline, start_ned_m))


def state_in_mission(reading: Reading, status: RunnerStatus) -> PlannedState:
    """The planned values of an offboard mission: the current step, and the position of the current
    setpoint."""
    progress = reading.progress
    by_setpoints = reading.stream == "flying"
    setpoint_ned_m = progress.position_ned_m if progress is not None and by_setpoints else None
    return PlannedState(status.place, setpoint_ned_m, status.outside_corridor_m, by_setpoints)


def _millimetres(position_ned_m: Vector3) -> Vector3:
    n, e, d = position_ned_m
    return (round(n, 3), round(e, 3), round(d, 3))
