"""The parts of a mission: take-off and landing in PX4's own modes, and the parts flown by setpoints.

Each part checks the vehicle's mode (`expects`), returns its requests, and sets `done` at its end. A part that
failed sets `failure`: the mission's action and the reason.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

from missions.offboard.segments import WaitSegment
from missions.runner.flight import Flight
from missions.runner.reading import Reading
from missions.runner.requests import Notify, Request, SetMode, TakeOff

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
