"""The part of a mission between take-off and landing, flown by setpoints; also waits on the ground."""

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
from missions.runner.requests import ChangeScript, Notify, Play, Request
from missions.runner.script import Played, ScriptChange

AHEAD_S = 60.0
"""Segments are sent to the stream this long before they are flown, so that a stalled event loop does not
affect the flight [s]."""
HELD_BACK_REPORTED_S = 2.0
"""Time after which a vehicle that is held back is reported [s]."""
RENEW_S = 0.5
"""Period in which the stream is renewed."""
STARTS_WITHIN_S = 40.0


class SetpointPart(Part):
    """The part from the current segment to the next take-off or landing, or to the end."""

    def __init__(self, flight: Flight) -> None:
        super().__init__(flight)
        self._first = self._base = self._sent = flight.index
        """Index of the first segment to fly, of the script's first segment, and after the last segment that
        was sent."""
        self._number = 0
        self._local: Player | None = None
        """Plays the script while the vehicle is on the ground, where nothing is streamed; None: it flies."""
        self._began_s = self._last_change_s = self._last_s = 0.0
        self._initial_mode: str | None = None
        self._flying = False
        self._go_past = 0
        self._last_change: tuple[bool, int] = (False, 0)
        self._stop_for: int | None = None
        """Segment with which to continue after the stop."""
        self._watch: ConditionWatch | None = None
        self._watched = -1
        """Index of the segment that is being waited for; -1: none."""
        self._waited_s = 0.0
        self._answered = False
        self._played: Played | None = None
        self._held_back_s = 0.0
        """Duration for which the vehicle has been held back [s]."""

    # --- requests of clients ----------------------------------------------------------------------

    def answer(self) -> bool:
        """Continues after a wait for the operator. Returns False if the mission is not waiting for the
        operator."""
        if self.question is None:
            return False
        self._answered = True
        return True

    @property
    def meeting(self) -> str | None:
        """The meeting at which this role waits for the others; None: it does not wait."""
        segment, played = self.flight.segment, self._played
        waits = played is not None and played.waiting and played.index >= self._go_past
        if not waits or self.flight.paused or self._watched != self.flight.index:
            return None
        return segment.message if isinstance(segment, WaitSegment) and segment.kind == "meet" else None

    def leave_meeting(self) -> None:
        """Continues, because all roles have arrived."""
        self._answered = True

    def skip(self) -> None:
        """Stops, then continues with the next step."""
        self._stop_for = self.flight.course.next_step(self.flight.index)
        self.flight.paused = False

    def resume(self) -> None:
        """Resumes along the path, or with the next segment if the vehicle is away from the path."""
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
        """Distance from the position setpoint."""
        setpoint_ned_m = None if self._played is None else self._played.position_ned_m
        position_ned_m = reading.position_ned_m
        if setpoint_ned_m is None or position_ned_m is None:
            return None
        return math.dist(setpoint_ned_m, position_ned_m)

    def begin(self, now_s: float, reading: Reading) -> list[Request]:
        self._began_s = self._last_s = now_s
        self._initial_mode = reading.mode
        return self._play(now_s, reading)

    def expects(self, reading: Reading) -> bool:
        if self._local is not None:
            return True
        if reading.mode == self.flight.mode:
            return True
        return not self._flying and reading.mode == self._initial_mode

    def tick(self, now_s: float, reading: Reading) -> list[Request]:
        dt_s, self._last_s = now_s - self._last_s, now_s
        played = self._update_progress(now_s, reading)
        if played is None or self.failure is not None:
            return []
        requests: list[Request] = []
        self.flight.index = max(self._first, self._base + played.index)
        self.flight.t_s = played.t_s
        if self._stop_for is not None and played.rate == 0.0:
            return self._continue_with(self._stop_for, now_s, reading)
        if not played.approaching:
            requests += photos_due(self.flight)
        if self._local is None:
            requests += point_gimbal(self.flight, played, now_s)
        if self._stop_for is None and not self.flight.paused:
            requests += self._wait(now_s, dt_s, reading, played)
        requests += self._report_held_back(dt_s, reading, played)
        appended = self._append(now_s, reading)
        return [*requests, *self._change_script(now_s, appended)]

    # --- inside -----------------------------------------------------------------------------------

    def _play(self, now_s: float, reading: Reading) -> list[Request]:
        end_index = self.flight.course.next_px4_segment(self.flight.index)
        on_ground = reading.on_ground
        if on_ground and (flown := self._flown_on_ground(end_index)) is not None:
            text = f"{flown.title} ({flown.place}) needs a take-off before it"
            self.failure = Failure("hold", text)
            return []
        try:
            script, self._base, self._sent = self.flight.script(reading, end_index)
            self._first = self.flight.index
        except PlanError as error:
            text = f"The approach to the path cannot be flown: {error.place}: {error.reason}"
            self.failure = Failure(self.flight.actions.failure, text)
            return []
        self._number, self._go_past, self._stop_for, self._played = script.number, 0, None, None
        self._last_change, self._last_change_s = (False, 0), now_s
        if on_ground:
            self._local = Player(script, now_s)
            return []
        return [Play(script)]

    def _flown_on_ground(self, end_index: int) -> Segment | None:
        segments = self.flight.course.segments[self.flight.index : end_index]
        return next((s for s in segments if not isinstance(s, HoldSegment | WaitSegment)), None)

    def _update_progress(self, now_s: float, reading: Reading) -> Played | None:
        """Progress of the script; None while the script is not being flown."""
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
            mode = "Offboard" if self.flight.mode == "offboard" else "its mode"
            self.failure = Failure(self.flight.actions.failure, f"The vehicle did not switch to {mode}")
            return None
        played = reading.played
        if reading.stream != "flying" or played is None or played.number != self._number:
            return None
        self._played = played
        return played

    def _continue_with(self, index: int, now_s: float, reading: Reading) -> list[Request]:
        """Continues with another segment after the stop."""
        self.flight.move_to(index)
        self._forget_wait()
        course = self.flight.course
        if course.flown_by_px4(index) or (index >= len(course.segments) and course.decision is None):
            self._stop_for = None
            self.done = True
            return []
        return self._play(now_s, reading)

    def _wait(self, now_s: float, dt_s: float, reading: Reading, played: Played) -> list[Request]:
        """Continues after a wait that has ended."""
        segment = self.flight.segment
        if not played.waiting or not isinstance(segment, WaitSegment) or played.index < self._go_past:
            return []
        requests: list[Request] = []
        if self._watched != self.flight.index:
            self._forget_wait()
            self._watched = self.flight.index
            if segment.kind == "person":
                self.question = segment.message or "Go on?"
                requests.append(Notify("question", f"Asks: {self.question}"))
            elif segment.value is not None:
                self._watch = ConditionWatch(segment.value, segment.above, segment.below, segment.for_s)
        self._waited_s += dt_s
        if self._answered or (self._watch is not None and self._watch.fulfilled(now_s, reading)):
            return [*requests, *self._end_wait(played)]
        if self._waited_s >= segment.timeout_s:
            text = f"{_timeout_text(segment)} within {segment.timeout_s:g} s ({segment.place})"
            if segment.on_timeout == "continue":
                return [*requests, Notify("timeout", f"{text}: continuing."), *self._end_wait(played)]
            self.failure = Failure(segment.on_timeout, text)
        return requests

    def _report_held_back(self, dt_s: float, reading: Reading, played: Played) -> list[Request]:
        before_s, self._held_back_s = self._held_back_s, self._held_back_s + dt_s if played.held_back else 0.0
        wanted, here = played.position_ned_m, reading.position_ned_m
        if not before_s < HELD_BACK_REPORTED_S <= self._held_back_s or wanted is None or here is None:
            return []
        text = f"The vehicle is {math.dist(wanted, here):.0f} m behind on its path: the mission waits for it."
        return [Notify("held_back", text, warning=True)]

    def _end_wait(self, played: Played) -> list[Request]:
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
        end_index = course.next_px4_segment(index)
        if index >= end_index and (course.flown_by_px4(end_index) or course.decision is None):
            self.done = self._stop_for is None and not self.flight.paused
            return ()
        ahead_s = sum(s.duration_s for s in course.segments[index : self._sent])
        if self._sent >= end_index or ahead_s >= AHEAD_S:
            return ()
        first, self._sent = self._sent, self.flight.chunk_end(self._sent, end_index)
        return tuple(course.segments[first : self._sent])

    def _decide(self, now_s: float, reading: Reading) -> None:
        decision = self.flight.course.decision
        assert decision is not None
        if self._watch is None:
            self._watch = ConditionWatch(decision.value, decision.above, decision.below, decision.for_s)
        fulfilled = self._watch.fulfilled(now_s, reading)
        if fulfilled or not self._watch.true_now(reading):
            self.flight.course.choose(fulfilled)
            self._forget_wait()

    def _change_script(self, now_s: float, appended: tuple[Segment, ...]) -> list[Request]:
        """Sends the pause state when it changes, and periodically."""
        wanted = (self.flight.paused or self._stop_for is not None, self._go_past)
        if not appended and wanted == self._last_change and now_s - self._last_change_s < RENEW_S:
            return []
        self._last_change, self._last_change_s = wanted, now_s
        change = ScriptChange(wanted[0], wanted[1], appended)
        if self._local is not None:
            self._local.change_script(change)
            return []
        return [ChangeScript(change)]


def _timeout_text(segment: WaitSegment) -> str:
    if segment.kind == "meet":
        return f"Not all vehicles arrived at the meeting {segment.message!r}"
    return "No answer" if segment.kind == "person" else "The condition did not become true"


def _sentence(text: str | None) -> str:
    return (text or "The setpoint stream has ended").rstrip(".")
