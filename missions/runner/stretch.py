"""A part of a mission that is flown by setpoints, or a wait on the ground."""

from __future__ import annotations

import math

from missions.errors import PlanError
from missions.offboard.segments import HoldSegment, Segment, WaitSegment
from missions.runner.course import ConditionWatch
from missions.runner.flight import Flight
from missions.runner.parts import Failure, Part
from missions.runner.payload import photos_due, point_gimbal
from missions.runner.player import Player
from missions.runner.reading import Reading
from missions.runner.requests import Play, Request, Steer, Tell
from missions.runner.script import Played, Steering

AHEAD_S = 60.0
"""Segments are sent to the stream this far ahead, so that a stalled event loop does not affect the flight."""
HELD_BACK_TOLD_S = 2.0
"""A vehicle that is held back for this long is reported."""
RENEW_S = 0.5
"""Period in which the stream is renewed."""
STARTS_WITHIN_S = 40.0


class StretchPart(Part):
    """From the current segment to the next take-off or landing, or to the end."""

    def __init__(self, flight: Flight) -> None:
        super().__init__(flight)
        self._first = self._base = self._sent = flight.index
        self._number = 0
        self._local: Player | None = None
        """Whether the vehicle is on the ground, where nothing is streamed."""
        self._began_s = self._steered_s = self._last_s = 0.0
        self._mode_before: str | None = None
        self._flying = False
        self._go_past = 0
        self._steered: tuple[bool, int] = (False, 0)
        self._stop_for: int | None = None
        """Segment with which to continue after the stop."""
        self._watch: ConditionWatch | None = None
        self._watched = -1
        self._waited_s = 0.0
        self._answered = False
        self._played: Played | None = None
        self._held_back_s = 0.0
        """Duration for which the vehicle has been held back [s]."""

    # --- requests of clients ----------------------------------------------------------------------

    def answer(self) -> bool:
        """Continues after a wait for the operator; False: there is no such wait."""
        if self.question is None:
            return False
        self._answered = True
        return True

    @property
    def meeting(self) -> str | None:
        """The meeting at which it waits for the other roles; None: it waits at none."""
        segment, played = self.flight.segment, self._played
        waits = played is not None and played.waiting and played.index >= self._go_past
        if not waits or self.flight.paused or self._watched != self.flight.index:
            return None
        return segment.message if isinstance(segment, WaitSegment) and segment.kind == "meet" else None

    def leave_meeting(self) -> None:
        """All have come: it goes on."""
        self._answered = True

    def skip(self) -> None:
        """Stops, then continues with the next step."""
        self._stop_for = self.flight.course.next_step(self.flight.index)
        self.flight.paused = False

    def resume(self) -> None:
        """Resumes along the path; away from the path, with the next segment."""
        self.flight.paused = False
        if self._played is not None and self._played.diverted:
            self._stop_for = self.flight.index + 1

    # --- a part -----------------------------------------------------------------------------------

    @property
    def in_offboard(self) -> bool:  # type: ignore[override]
        return self._local is None

    @property
    def state(self) -> str:  # type: ignore[override]
        played = self._played
        if self._local is None and not self._flying:
            return "starting"
        if self.flight.paused:
            return "paused" if played is not None and played.rate == 0.0 else "pausing"
        return "waiting" if played is not None and played.waiting else "flying"

    @property
    def played(self) -> Played | None:
        """Progress of the current script."""
        return self._played

    def deviation_m(self, reading: Reading) -> float | None:
        """From the position that is sent."""
        wanted, here = None if self._played is None else self._played.position_ned_m, reading.position_ned_m
        return None if wanted is None or here is None else math.dist(wanted, here)

    def begin(self, now_s: float, reading: Reading) -> list[Request]:
        self._began_s = self._last_s = now_s
        self._mode_before = reading.mode
        return self._play(now_s, reading)

    def expects(self, reading: Reading) -> bool:
        if self._local is not None:
            return True
        if reading.mode == "offboard":
            return True
        return not self._flying and reading.mode == self._mode_before

    def tick(self, now_s: float, reading: Reading) -> list[Request]:
        dt_s, self._last_s = now_s - self._last_s, now_s
        played = self._look(now_s, reading)
        if played is None or self.failure is not None:
            return []
        out: list[Request] = []
        self.flight.index = max(self._first, self._base + played.index)
        self.flight.t_s = played.t_s
        if self._stop_for is not None and played.rate == 0.0:
            return self._go_on_with(self._stop_for, now_s, reading)
        if not played.approaching:
            out += photos_due(self.flight)
        if self._local is None:
            out += point_gimbal(self.flight, played, now_s)
        if self._stop_for is None and not self.flight.paused:
            out += self._wait(now_s, dt_s, reading, played)
        out += self._tell_held_back(dt_s, reading, played)
        appended = self._append(now_s, reading)
        return [*out, *self._steer(now_s, appended)]

    # --- inside -----------------------------------------------------------------------------------

    def _play(self, now_s: float, reading: Reading) -> list[Request]:
        cut = self.flight.course.cut_after(self.flight.index)
        on_ground = reading.on_ground
        if on_ground and (flown := self._flown_on_ground(cut)) is not None:
            text = f"{flown.title} ({flown.place}) needs a take-off before it"
            self.failure = Failure("hold", text)
            return []
        try:
            script, self._base, self._sent = self.flight.script(reading, cut)
            self._first = self.flight.index
        except PlanError as error:
            text = f"The way to the path cannot be flown: {error.place}: {error.reason}"
            self.failure = Failure(self.flight.actions.failure, text)
            return []
        self._number, self._go_past, self._stop_for, self._played = script.number, 0, None, None
        self._steered, self._steered_s = (False, 0), now_s
        if on_ground:
            self._local = Player(script, now_s)
            return []
        return [Play(script)]

    def _flown_on_ground(self, cut: int) -> Segment | None:
        segments = self.flight.course.segments[self.flight.index : cut]
        return next((s for s in segments if not isinstance(s, HoldSegment | WaitSegment)), None)

    def _look(self, now_s: float, reading: Reading) -> Played | None:
        """Progress of the script; None while it is not flown."""
        if self._local is not None:
            self._local.at(now_s)
            self._played = self._local.played
            return self._played
        if reading.stream == "flying":
            self._flying = True
        elif self._flying:
            self.failure = Failure(self.flight.actions.failure, _sentence(reading.stream_text))
            return None
        elif now_s - self._began_s > STARTS_WITHIN_S:
            self.failure = Failure(self.flight.actions.failure, "The vehicle did not switch to Offboard")
            return None
        played = reading.played
        if reading.stream != "flying" or played is None or played.number != self._number:
            return None
        self._played = played
        return played

    def _go_on_with(self, index: int, now_s: float, reading: Reading) -> list[Request]:
        """Continues with another segment after the stop."""
        self.flight.move_to(index)
        self._forget_wait()
        course = self.flight.course
        if course.is_cut(index) or (index >= len(course.segments) and course.decision is None):
            self._stop_for = None
            self.done = True
            return []
        return self._play(now_s, reading)

    def _wait(self, now_s: float, dt_s: float, reading: Reading, played: Played) -> list[Request]:
        """Continues after a wait that has ended."""
        segment = self.flight.segment
        if not played.waiting or not isinstance(segment, WaitSegment) or played.index < self._go_past:
            return []
        out: list[Request] = []
        if self._watched != self.flight.index:
            self._forget_wait()
            self._watched = self.flight.index
            if segment.kind == "person":
                self.question = segment.message or "Go on?"
                out.append(Tell("question", f"Asks: {self.question}"))
            elif segment.value is not None:
                self._watch = ConditionWatch(segment.value, segment.above, segment.below, segment.for_s)
        self._waited_s += dt_s
        if self._answered or (self._watch is not None and self._watch.fulfilled(now_s, reading)):
            return [*out, *self._past(played)]
        if self._waited_s >= segment.timeout_s:
            text = f"{_missed(segment)} within {segment.timeout_s:g} s ({segment.place})"
            if segment.on_timeout == "continue":
                return [*out, Tell("timeout", f"{text}: continuing."), *self._past(played)]
            self.failure = Failure(segment.on_timeout, text)
        return out

    def _tell_held_back(self, dt_s: float, reading: Reading, played: Played) -> list[Request]:
        before_s, self._held_back_s = self._held_back_s, self._held_back_s + dt_s if played.held_back else 0.0
        wanted, here = played.position_ned_m, reading.position_ned_m
        if not before_s < HELD_BACK_TOLD_S <= self._held_back_s or wanted is None or here is None:
            return []
        text = f"The vehicle is {math.dist(wanted, here):.0f} m behind on its path: the mission waits for it."
        return [Tell("held_back", text, warning=True)]

    def _past(self, played: Played) -> list[Request]:
        self._forget_wait()
        self._go_past = played.index + 1
        return []

    def _forget_wait(self) -> None:
        self.question, self._watch, self._answered, self._waited_s = None, None, False, 0.0
        self._watched = -1

    def _append(self, now_s: float, reading: Reading) -> tuple[Segment, ...]:
        """Sends the next segments in time, decides branches, and detects the end."""
        course, index = self.flight.course, self.flight.index
        if index >= len(course.segments) and course.decision is not None and not self.flight.paused:
            self._decide(now_s, reading)
        cut = course.cut_after(index)
        if index >= cut and (course.is_cut(cut) or course.decision is None):
            self.done = self._stop_for is None and not self.flight.paused
            return ()
        ahead_s = sum(s.duration_s for s in course.segments[index : self._sent])
        if self._sent >= cut or ahead_s >= AHEAD_S:
            return ()
        first, self._sent = self._sent, self.flight.chunk_end(self._sent, cut)
        return tuple(course.segments[first : self._sent])

    def _decide(self, now_s: float, reading: Reading) -> None:
        decision = self.flight.course.decision
        assert decision is not None
        if self._watch is None:
            self._watch = ConditionWatch(decision.value, decision.above, decision.below, decision.for_s)
        fulfilled = self._watch.fulfilled(now_s, reading)
        if fulfilled or not self._watch.holds_now(reading):
            self.flight.course.choose(fulfilled)
            self._forget_wait()

    def _steer(self, now_s: float, appended: tuple[Segment, ...]) -> list[Request]:
        """Sends the pause state when it changes, and periodically."""
        wanted = (self.flight.paused or self._stop_for is not None, self._go_past)
        if not appended and wanted == self._steered and now_s - self._steered_s < RENEW_S:
            return []
        self._steered, self._steered_s = wanted, now_s
        steering = Steering(wanted[0], wanted[1], appended)
        if self._local is not None:
            self._local.steer(steering)
            return []
        return [Steer(steering)]


def _missed(segment: WaitSegment) -> str:
    if segment.kind == "meet":
        return f"Not all came to the meeting {segment.message!r}"
    return "No answer" if segment.kind == "person" else "The condition did not come true"


def _sentence(text: str | None) -> str:
    return (text or "The setpoint stream has ended").rstrip(".")
