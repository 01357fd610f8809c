"""The parts of a mission: take-off and landing in PX4's own modes, and the parts flown by setpoints.

Each part checks the vehicle's mode (`expects`), returns its requests, and sets `done` at its end. A part that
failed sets `failure`: the mission's action and the reason.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

from missions.frames import wrap_pi
from missions.offboard.segments import WaitSegment
from missions.runner.flight import Flight
from missions.runner.reading import Reading
from missions.runner.requests import Notify, Photo, PointGimbal, ReleaseGimbal, Request, SetMode, TakeOff
from missions.runner.script import ScriptProgress
from missions.setpoints import Position

LANDED_AFTER_S = 10.0
"""Time on the ground after which the vehicle counts as landed, even if it is still armed [s]."""
NEAR_HEIGHT_M = 1.0
"""A vehicle is near the take-off height within this distance [m]."""
HOVERS_AFTER_S = 5.0
"""Time near the take-off height after which a take-off by an executor counts as complete, because PX4 reports
the end of the take-off only once, and this report may be lost [s]."""


@dataclass(frozen=True, slots=True)
class Failure:
    """Why a part cannot continue, and the action to execute."""

    action: str
    """continue, hold, return or land; a failure of `FlightWatch` can also have pause."""
    text: str


class Part(ABC):
    """One part of the flight."""

    state: str
    """State in the API: taking_off, starting, flying, waiting, pausing, paused, landing."""
    in_offboard = False
    """Whether the part is flown by setpoints from the server."""
    question: str | None = None
    """The question to the pilot; None: no question."""

    def __init__(self, flight: Flight) -> None:
        self.flight = flight
        self.done = False
        self.failure: Failure | None = None

    @abstractmethod
    def begin(self, now_s: float, reading: Reading) -> list[Request]:
        """Starts the part; returns its first requests."""

    @abstractmethod
    def tick(self, now_s: float, reading: Reading) -> list[Request]:
        """Updates the part; may set `done` or `failure`."""

    @abstractmethod
    def expects(self, reading: Reading) -> bool:
        """Whether this part requested the vehicle's current mode. False: another party
        controls the vehicle."""


class Px4Part(Part):
    """A part that PX4 flies in its own mode."""

    def __init__(self, flight: Flight, segment: WaitSegment) -> None:
        super().__init__(flight)
        self._segment = segment
        self._initial_mode: str | None = None
        self._mode_reached = False
        self._began_s = 0.0

    def begin(self, now_s: float, reading: Reading) -> list[Request]:
        self._initial_mode, self._began_s = reading.mode, now_s
        return [self._request()]

    @abstractmethod
    def _request(self) -> Request:
        """The request that starts the mode."""


class TakeOffPart(Px4Part):
    """PX4's own take-off; done when the vehicle holds its position at the take-off height.

    Without an executor, PX4 then switches to Hold. With an executor, PX4 stays in Takeoff and reports the end
    of the take-off to the executor.
    """

    state = "taking_off"

    def __init__(self, flight: Flight, segment: WaitSegment) -> None:
        super().__init__(flight, segment)
        self._near_height_since_s: float | None = None

    def _request(self) -> Request:
        return TakeOff(self._segment.height_m or 0.0)

    def tick(self, now_s: float, reading: Reading) -> list[Request]:
        self._mode_reached |= reading.mode == "takeoff"
        is_holding = reading.mode == "hold" or self._complete_under_executor(now_s, reading)
        if self._mode_reached and is_holding and reading.armed:
            self.done = True
        elif now_s - self._began_s > self._segment.timeout_s:
            text = f"The take-off did not end within {self._segment.timeout_s:g} s"
            self.failure = Failure(self.flight.actions.failure, text)
        return []

    def expects(self, reading: Reading) -> bool:
        if reading.mode == "hold" and self._mode_reached:
            return reading.mode_source in (None, "vehicle") or self._is_near_height(reading)
        return reading.mode == "takeoff" or (not self._mode_reached and reading.mode == self._initial_mode)

    def _complete_under_executor(self, now_s: float, reading: Reading) -> bool:
        if not reading.executor_in_charge or reading.mode != "takeoff":
            return False
        if not self._is_near_height(reading):
            self._near_height_since_s = None
        elif self._near_height_since_s is None:
            self._near_height_since_s = now_s
        near_since_s = self._near_height_since_s
        return reading.take_off_complete or (
            near_since_s is not None and now_s - near_since_s >= HOVERS_AFTER_S
        )

    def _is_near_height(self, reading: Reading) -> bool:
        position_ned_m = reading.position_ned_m
        return (
            position_ned_m is not None and abs(position_ned_m[2] - self._segment.end_ned_m[2]) < NEAR_HEIGHT_M
        )


class LandPart(Px4Part):
    """PX4's own landing; done when the motors have stopped."""

    state = "landing"

    def __init__(self, flight: Flight, segment: WaitSegment) -> None:
        super().__init__(flight, segment)
        self._on_ground_since_s: float | None = None
        self._late_reported = False

    def _request(self) -> Request:
        return SetMode("land")

    def tick(self, now_s: float, reading: Reading) -> list[Request]:
        self._mode_reached |= reading.mode == "land"
        if not reading.on_ground:
            self._on_ground_since_s = None
        elif self._on_ground_since_s is None:
            self._on_ground_since_s = now_s
        on_ground_s = 0.0 if self._on_ground_since_s is None else now_s - self._on_ground_since_s
        self.done = reading.armed is False or on_ground_s >= LANDED_AFTER_S
        if not self.done and not self._late_reported and now_s - self._began_s > self._segment.timeout_s:
            self._late_reported = True
            text = f"The landing has taken longer than {self._segment.timeout_s:g} s; it continues."
            return [Notify("landing_late", text, warning=True)]
        return []

    def expects(self, reading: Reading) -> bool:
        if reading.armed is False or reading.mode == "land":
            return True
        return not self._mode_reached and reading.mode == self._initial_mode


LEAD_S = 0.05
"""Half of the update period: with this lead, photos are early as often as late."""
UNCHANGED_RAD = math.radians(0.2)
"""A gimbal direction that differs less from the last request counts as unchanged."""
REPEAT_S = 1.0
"""Period in which an unchanged gimbal request is repeated, because a request may be lost."""


def photos_due(flight: Flight) -> list[Request]:
    """Requests for the photos that are due at the current mission time and not yet taken."""
    requests: list[Request] = []
    segments = flight.course.segments
    while flight.photo_index < len(segments) and flight.photo_index <= flight.index:
        is_current = flight.photo_index == flight.index
        photos = [e for e in segments[flight.photo_index].events if e.kind == "photo"]
        due_count = sum(e.t_s <= flight.t_s + LEAD_S for e in photos) if is_current else len(photos)
        requests += [Photo(e.component) for e in photos[flight.photos_taken : due_count]]
        flight.photos_taken = max(due_count, flight.photos_taken)
        if is_current:
            break
        flight.photo_index, flight.photos_taken = flight.photo_index + 1, 0
    return requests


def point_gimbal(flight: Flight, progress: ScriptProgress, now_s: float) -> list[Request]:
    """The gimbal request of the current track, if it has changed or must be repeated."""
    segment = flight.segment
    if segment is None:
        return []
    if segment.gimbal is None:
        return release_gimbal(flight)
    setpoint = segment.at(flight.t_s)
    if progress.position_ned_m is not None and (progress.approaching or progress.diverted):
        setpoint = Position(progress.position_ned_m, getattr(setpoint, "yaw_ned_rad", None))
    pitch_rad, yaw_rad = segment.gimbal.at(flight.t_s, setpoint, segment.end_yaw_ned_rad)
    if flight.last_gimbal_request is not None:
        pitch_before_rad, yaw_before_rad, requested_s = flight.last_gimbal_request
        turned_rad = max(abs(pitch_rad - pitch_before_rad), abs(wrap_pi(yaw_rad - yaw_before_rad)))
        if turned_rad < UNCHANGED_RAD and now_s - requested_s < REPEAT_S:
            return []
    flight.last_gimbal_request = (pitch_rad, yaw_rad, now_s)
    return [PointGimbal(pitch_rad, yaw_rad)]


def release_gimbal(flight: Flight) -> list[Request]:
    """Releases the gimbal if the mission has commanded it."""
    if flight.last_gimbal_request is None:
        return []
    flight.last_gimbal_request = None
    return [ReleaseGimbal()]
