"""The modes of a mission's flight: take-off and landing, which PX4 flies itself, and the stretches between.

Each says what the vehicle does while the part is in charge (`expects`), asks for what it needs, and knows
when it is done. A part that has failed says what is to be done about it: an action of the mission, and why.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

from missions.offboard.segments import WaitSegment
from missions.runner.flight import Flight
from missions.runner.reading import Reading
from missions.runner.requests import Request, SetMode, TakeOff, Tell

DOWN_FOR_S = 10.0
"""A vehicle that stays armed on the ground for so long has landed."""
NEAR_HEIGHT_M = 1.0


@dataclass(frozen=True, slots=True)
class Failure:
    """Why a part cannot go on as planned, and what is to be done."""

    action: str
    """continue, hold, return, land; of a watch also pause."""
    text: str


class Part(ABC):
    """One part of the flight."""

    state: str
    """For people and programs: taking_off, starting, flying, waiting, pausing, paused, landing."""
    in_offboard = False
    """Whether it flies by setpoints of ours."""
    question: str | None = None
    """What a person is asked just now."""

    def __init__(self, flight: Flight) -> None:
        self.flight = flight
        self.done = False
        self.failure: Failure | None = None

    @abstractmethod
    def begin(self, now_s: float, reading: Reading) -> list[Request]:
        """Asks for what it begins with."""

    @abstractmethod
    def tick(self, now_s: float, reading: Reading) -> list[Request]:
        """Looks on; sets `done` or `failure`."""

    @abstractmethod
    def expects(self, reading: Reading) -> bool:
        """Whether the vehicle does what this part asked for: else somebody else is in charge."""


class TakeOffPart(Part):
    """PX4's own take-off: done when it holds at its height."""

    state = "taking_off"

    def __init__(self, flight: Flight, segment: WaitSegment) -> None:
        super().__init__(flight)
        self._segment = segment
        self._mode_before: str | None = None
        self._seen = False
        self._began_s = 0.0

    def begin(self, now_s: float, reading: Reading) -> list[Request]:
        self._mode_before, self._began_s = reading.mode, now_s
        return [TakeOff(self._segment.height_m or 0.0)]

    def tick(self, now_s: float, reading: Reading) -> list[Request]:
        self._seen |= reading.mode == "takeoff"
        if self._seen and reading.mode == "hold" and reading.armed:
            self.done = True
        elif now_s - self._began_s > self._segment.timeout_s:
            text = f"The take-off did not end within {self._segment.timeout_s:g} s"
            self.failure = Failure(self.flight.actions.failure, text)
        return []

    def expects(self, reading: Reading) -> bool:
        if reading.mode == "hold" and self._seen:
            return reading.mode_source in (None, "vehicle") or self._is_up(reading)
        return reading.mode == "takeoff" or (not self._seen and reading.mode == self._mode_before)

    def _is_up(self, reading: Reading) -> bool:
        here = reading.position_ned_m
        return here is not None and abs(here[2] - self._segment.end_ned_m[2]) < NEAR_HEIGHT_M


class LandPart(Part):
    """PX4's own landing: done when the motors have stopped."""

    state = "landing"

    def __init__(self, flight: Flight, segment: WaitSegment) -> None:
        super().__init__(flight)
        self._segment = segment
        self._mode_before: str | None = None
        self._seen = False
        self._began_s = 0.0
        self._down_s: float | None = None
        self._told = False

    def begin(self, now_s: float, reading: Reading) -> list[Request]:
        self._mode_before, self._began_s = reading.mode, now_s
        return [SetMode("land")]

    def tick(self, now_s: float, reading: Reading) -> list[Request]:
        self._seen |= reading.mode == "land"
        if not reading.on_ground:
            self._down_s = None
        elif self._down_s is None:
            self._down_s = now_s
        down_for_s = 0.0 if self._down_s is None else now_s - self._down_s
        self.done = reading.armed is False or down_for_s >= DOWN_FOR_S
        if not self.done and not self._told and now_s - self._began_s > self._segment.timeout_s:
            self._told = True
            text = f"The landing has taken longer than {self._segment.timeout_s:g} s; it continues."
            return [Tell("landing_late", text, warning=True)]
        return []

    def expects(self, reading: Reading) -> bool:
        if reading.armed is False or reading.mode == "land":
            return True
        return not self._seen and reading.mode == self._mode_before
