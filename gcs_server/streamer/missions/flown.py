"""Records how a vehicle flew an offboard mission, and compares the flight with its plan."""

from __future__ import annotations

from dataclasses import dataclass

from gcs_server.streamer.missions.start import Start
from missions.geodesy import LocalOrigin
from missions.offboard.samples import Leg, legs
from missions.runner.flown import FlownSample, FlownTrack
from missions.runner.reading import Reading
from missions.runner.status import RunnerStatus


@dataclass(frozen=True, slots=True)
class FlownMission:
    """The flown path of a vehicle's newest mission, with the planned one."""

    name: str
    started_unix_s: float
    over: bool
    """Whether the mission has ended."""
    duration_s: float
    """Time from the start to the end of the mission, or until now."""
    planned_duration_s: float
    """Planned duration of the whole mission, with the longest branch."""
    planned_length_m: float
    """Planned length of the whole path, with the longest branch, take-off and landing."""
    planned_legs: tuple[Leg, ...]
    """The planned path of each step, on all branches."""
    origin: LocalOrigin | None
    """Global position of the local origin at the start; null: it was not known."""
    battery_start_share: float | None
    """Battery charge at the start, 0 to 1; null: the vehicle did not report it."""
    battery_end_share: float | None
    """Newest battery charge of the mission, 0 to 1; null: the vehicle did not report it."""
    samples: tuple[FlownSample, ...]
    """Two samples per second; fewer for a flight longer than half an hour."""
    deviation_mean_m: float | None
    """Mean distance from the streamed positions; null: no position was streamed."""
    deviation_max_m: float | None
    """Largest distance from the streamed positions; null: no position was streamed."""


class FlightRecord:
    """The record of one flight.

    Args:
        start: the mission.
        unix_s: time of the start.
        now_s: the same on the monotonic clock.
        reading: the vehicle's state at the start.
        origin: global position of its local origin; None: it is not known.
    """

    def __init__(
        self, start: Start, unix_s: float, now_s: float, reading: Reading, origin: LocalOrigin | None
    ) -> None:
        self._start = start
        self.started_unix_s = unix_s
        self._started_s = now_s
        self._ended_s: float | None = None
        self._start_ned_m = reading.position_ned_m or (0.0, 0.0, 0.0)
        self._origin = origin
        self._battery_start_share = self._battery_end_share = reading.battery_share
        self._track = FlownTrack()
        self._legs: tuple[Leg, ...] | None = None

    def record(self, now_s: float, reading: Reading, status: RunnerStatus) -> None:
        """Adds the vehicle's state, while the mission has not ended."""
        self._track.record(now_s - self._started_s, reading, status)
        if reading.battery_share is not None:
            self._battery_end_share = reading.battery_share
            if self._battery_start_share is None:
                self._battery_start_share = reading.battery_share

    def end(self, now_s: float) -> None:
        """Keeps the time of the end; later calls do nothing."""
        if self._ended_s is None:
            self._ended_s = now_s

    def flown(self, now_s: float) -> FlownMission:
        """The flight so far."""
        if self._legs is None:
            self._legs = legs(self._start.timeline, self._start_ned_m)
        samples = tuple(self._track.samples)
        deviations_m = [each.deviation_m for each in samples if each.deviation_m is not None]
        mean_m = round(sum(deviations_m) / len(deviations_m), 2) if deviations_m else None
        return FlownMission(
            name=self._start.mission.name,
            started_unix_s=self.started_unix_s,
            over=self._ended_s is not None,
            duration_s=round((now_s if self._ended_s is None else self._ended_s) - self._started_s, 1),
            planned_duration_s=round(self._start.timeline.duration_s, 1),
            planned_length_m=round(self._start.timeline.length_m, 1),
            planned_legs=self._legs,
            origin=self._origin,
            battery_start_share=self._battery_start_share,
            battery_end_share=self._battery_end_share,
            samples=samples,
            deviation_mean_m=mean_m,
            deviation_max_m=max(deviations_m, default=None),
        )
