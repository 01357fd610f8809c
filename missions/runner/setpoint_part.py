"""The part of a mission between take-off and landing, flown by setpoints; also waits on the ground."""

from __future__ import annotations

import math

from missions.errors import PlanError
from missions.offboard.segments import (
    AttitudeSegment,
    HoldSegment,
    Segment,
    VelocitySegment,
    WaitSegment,
)
from missions.runner.course import ConditionWatch
from missions.runner.flight import Flight
from missions.runner.parts import Failure, Part, photos_due, point_gimbal
from missions.runner.reading import Reading
from missions.runner.requests import ChangeScript, Notify, Request, StreamScript
from missions.runner.sampler import ScriptSampler
from missions.runner.script import ScriptChange, ScriptProgress

AHEAD_S = 60.0
"""The server sends segments to the stream this long before they are flown, so that a stalled event loop does
not affect the flight [s]."""
HELD_BACK_REPORTED_S = 2.0
"""Time after which a vehicle that is held back is reported [s]."""
RESTART_PERIOD_S = 2.0
"""Time after which a script that goes on from the vehicle's place is sent again [s]."""
RENEW_S = 0.5
"""Period in which the pause state is sent again, which renews the stream [s]."""
STARTS_WITHIN_S = 40.0
"""Time within which the vehicle must be in the mission's mode; otherwise the part fails."""


class SetpointPart(Part):
    """The part from the current segment to the next take-off or landing, or to the end of the mission."""

    def __init__(self, flight: Flight) -> None:
        super().__init__(flight)
        self._first_index = flight.index
        """Index of the first segment to fly."""
        self._script_start = flight.index
        """Index of the script's first segment."""
        self._sent_end = flight.index
        """Index after the last segment that was sent."""
        self._number = 0
        self._ground_sampler: ScriptSampler | None = None
        """Samples the script while the vehicle is on the ground and nothing is streamed; None: the vehicle
        flies."""
        self._began_s = self._last_sent_s = self._last_s = 0.0
        self._initial_mode: str | None = None
        self._flying = False
        self._first_open_wait = 0
        self._last_pause_state: tuple[bool, int] = (False, 0)
        self._continue_at: int | None = None
        """Index of the segment with which to continue after a stop; None: no stop."""
        self._condition_watch: ConditionWatch | None = None
        self._wait_index = -1
        """Index of the current wait segment; -1: no wait."""
        self._waited_s = 0.0
        self._may_continue = False
        """Whether the current wait has ended, because the operator has answered or all roles have arrived."""
        self._progress: ScriptProgress | None = None
        self._interrupted_s: float | None = None
        """When the vehicle stopped following its setpoints; None: it follows them."""
        self._restarted_s = -math.inf
        """When the last script that goes on from the vehicle's place was sent."""
        self._held_back_s = 0.0
        """Time for which the vehicle has been held back [s]."""

    # --- requests of clients ----------------------------------------------------------------------

    def continue_after_question(self) -> bool:
        """Continues after a wait for the operator. Returns False if the mission is not waiting for the
        operator."""
        if self.question is None:
            return False
        self._may_continue = True
        return True

    @property
    def meeting(self) -> str | None:
        """The meeting at which this role waits for the other roles; None: the role does not wait."""
        segment, progress = self.flight.segment, self._progress
        is_waiting = progress is not None and progress.waiting and progress.index >= self._first_open_wait
        if not is_waiting or self.flight.paused or self._wait_index != self.flight.index:
            return None
        return segment.message if isinstance(segment, WaitSegment) and segment.kind == "meet" else None

    def leave_meeting(self) -> None:
        """Continues after the meeting, because all roles have arrived."""
        self._may_continue = True

    def skip(self) -> None:
        """Stops, then continues with the next step."""
        self._continue_at = self.flight.course.next_step(self.flight.index)
        self.flight.paused = False

    def resume(self) -> None:
        """Resumes along the path; if the vehicle has left the path, with the next segment."""
        self.flight.paused = False
        if self._progress is not None and self._progress.diverted:
            self._continue_at = self.flight.index + 1

    # --- a part -----------------------------------------------------------------------------------

    @property
    def in_offboard(self) -> bool:  # type: ignore[override]
        return self._ground_sampler is None

    @property
    def state(self) -> str:  # type: ignore[override]
        progress = self._progress
        if self._ground_sampler is None and not self._flying:
            return "starting"
        if self.interrupted or (progress is not None and progress.held_back and progress.rate == 0.0):
            return "not_following"
        if self.flight.paused:
            return "paused" if progress is not None and progress.rate == 0.0 else "pausing"
        return "waiting" if progress is not None and progress.waiting else "flying"

    @property
    def interrupted(self) -> bool:
        """Whether the vehicle has left the setpoints, which now keep it at its place."""
        return self._interrupted_s is not None

    @property
    def progress(self) -> ScriptProgress | None:
        """Progress of the current script."""
        return self._progress

    def deviation_m(self, reading: Reading) -> float | None:
        """Distance from the position setpoint."""
        setpoint_ned_m = None if self._progress is None else self._progress.position_ned_m
        position_ned_m = reading.position_ned_m
        if setpoint_ned_m is None or position_ned_m is None:
            return None
        return math.dist(setpoint_ned_m, position_ned_m)

    def begin(self, now_s: float, reading: Reading) -> list[Request]:
        self._began_s = self._last_s = now_s
        self._initial_mode = reading.mode
        return self._begin_script(now_s, reading)

    def expects(self, reading: Reading) -> bool:
        if self._ground_sampler is not None:
            return True
        if reading.mode == self.flight.mode or reading.stream == "interrupted":
            return True
        if reading.mode_source == "failsafe" and reading.stream == "flying":
            return True  # the stream decides whether the failsafe interrupts it or ends it
        return not self._flying and reading.mode == self._initial_mode

    def tick(self, now_s: float, reading: Reading) -> list[Request]:
        dt_s, self._last_s = now_s - self._last_s, now_s
        if reading.stream == "interrupted":
            return self._continue_from_place(now_s, reading)
        progress = self._update_progress(now_s, reading)
        if progress is None or self.failure is not None:
            return []
        requests: list[Request] = []
        self.flight.index = max(self._first_index, self._script_start + progress.index)
        self.flight.t_s = progress.t_s
        if self._continue_at is not None and progress.rate == 0.0:
            return self._continue_with(self._continue_at, now_s, reading)
        if not progress.approaching:
            requests += photos_due(self.flight)
        if self._ground_sampler is None:
            requests += point_gimbal(self.flight, progress, now_s)
        if self._continue_at is None and not self.flight.paused:
            requests += self._update_wait(now_s, dt_s, reading, progress)
        requests += self._report_held_back(dt_s, reading, progress)
        appended = self._next_segments(now_s, reading)
        return [*requests, *self._change_script(now_s, appended)]

    # --- inside -----------------------------------------------------------------------------------

    def _begin_script(self, now_s: float, reading: Reading) -> list[Request]:
        end_index = self.flight.course.next_px4_segment(self.flight.index)
        on_ground = reading.on_ground
        if on_ground and (flight_segment := self._segment_needing_flight(end_index)) is not None:
            text = f"{flight_segment.title} ({flight_segment.place}) needs a take-off first"
            self.failure = Failure("hold", text)
            return []
        try:
            script, self._script_start, self._sent_end = self.flight.script(reading, end_index)
            self._first_index = self.flight.index
        except PlanError as error:
            text = f"The approach to the path cannot be flown: {error.place}: {error.reason}"
            self.failure = Failure(self.flight.actions.failure, text)
            return []
        self._number, self._first_open_wait, self._continue_at, self._progress = script.number, 0, None, None
        self._last_pause_state, self._last_sent_s = (False, 0), now_s
        if on_ground:
            self._ground_sampler = ScriptSampler(script, now_s)
            return []
        return [StreamScript(script)]

    def _segment_needing_flight(self, end_index: int) -> Segment | None:
        segments = self.flight.course.segments[self.flight.index : end_index]
        return next((s for s in segments if not isinstance(s, HoldSegment | WaitSegment)), None)

    def _update_progress(self, now_s: float, reading: Reading) -> ScriptProgress | None:
        """Progress of the script; None while the script is not being flown."""
        if self._ground_sampler is not None:
            self._ground_sampler.at(now_s)
            self._progress = self._ground_sampler.progress
            return self._progress
        if reading.stream == "flying":
            self._flying, self._interrupted_s = True, None
        elif self._flying:
            self.failure = Failure(self.flight.actions.failure, _reason(reading.stream_text))
            return None
        elif now_s - self._began_s > STARTS_WITHIN_S:
            mode = "Offboard" if self.flight.mode == "offboard" else "its mode"
            self.failure = Failure(self.flight.actions.failure, f"The vehicle did not switch to {mode}")
            return None
        progress = reading.progress
        if reading.stream != "flying" or progress is None or progress.number != self._number:
            return None
        self._progress = progress
        return progress

    def _continue_from_place(self, now_s: float, reading: Reading) -> list[Request]:
        """Goes on from where the vehicle is, once it follows its setpoints again: with an approach within the
        mission's limits. A velocity or attitude segment has no path to which the vehicle could return."""
        if self._interrupted_s is None:
            self._interrupted_s = now_s
            text = "The vehicle does not follow its setpoints: the mission waits for it."
            return [Notify("not_following", text, warning=True)]
        if reading.mode != self.flight.mode or reading.position_ned_m is None:
            return []
        if now_s - self._restarted_s < RESTART_PERIOD_S:
            return []
        notify = Notify("follows_again", "The vehicle follows again: going on from where it is.")
        self._restarted_s = now_s
        index = self._continue_at
        if index is None and isinstance(self.flight.segment, VelocitySegment | AttitudeSegment):
            index = self.flight.index + 1
        if index is not None:
            return [notify, *self._continue_with(index, now_s, reading)]
        return [notify, *self._begin_script(now_s, reading)]

    def _continue_with(self, index: int, now_s: float, reading: Reading) -> list[Request]:
        """Continues with another segment after the stop."""
        self.flight.move_to(index)
        self._reset_wait()
        course = self.flight.course
        if course.flown_by_px4(index) or (index >= len(course.segments) and course.decision is None):
            self._continue_at = None
            self.done = True
            return []
        return self._begin_script(now_s, reading)

    def _update_wait(
        self, now_s: float, dt_s: float, reading: Reading, progress: ScriptProgress
    ) -> list[Request]:
        """Updates the current wait, and continues after it has ended."""
        segment = self.flight.segment
        if (
            not progress.waiting
            or not isinstance(segment, WaitSegment)
            or progress.index < self._first_open_wait
        ):
            return []
        requests: list[Request] = []
        if self._wait_index != self.flight.index:
            self._reset_wait()
            self._wait_index = self.flight.index
            if segment.kind == "person":
                self.question = segment.message or "Go on?"
                requests.append(Notify("question", f"Question: {self.question}"))
            elif segment.value is not None:
                self._condition_watch = ConditionWatch(
                    segment.value, segment.above, segment.below, segment.for_s
                )
        self._waited_s += dt_s
        if self._may_continue or (
            self._condition_watch is not None and self._condition_watch.is_fulfilled(now_s, reading)
        ):
            return [*requests, *self._end_wait(progress)]
        if self._waited_s >= segment.timeout_s:
            text = f"{_timeout_text(segment)} within {segment.timeout_s:g} s ({segment.place})"
            if segment.on_timeout == "continue":
                return [*requests, Notify("timeout", f"{text}: continuing."), *self._end_wait(progress)]
            self.failure = Failure(segment.on_timeout, text)
        return requests

    def _report_held_back(self, dt_s: float, reading: Reading, progress: ScriptProgress) -> list[Request]:
        before_s, self._held_back_s = (
            self._held_back_s,
            self._held_back_s + dt_s if progress.held_back else 0.0,
        )
        setpoint_ned_m, position_ned_m = progress.position_ned_m, reading.position_ned_m
        if not before_s < HELD_BACK_REPORTED_S <= self._held_back_s or setpoint_ned_m is None:
            return []
        if position_ned_m is None:
            return [Notify("held_back", "The vehicle sends no position: the mission waits.", warning=True)]
        behind_m = math.dist(setpoint_ned_m, position_ned_m)
        text = f"The vehicle is {behind_m:.0f} m behind on its path: the mission waits for it."
        return [Notify("held_back", text, warning=True)]

    def _end_wait(self, progress: ScriptProgress) -> list[Request]:
        self._reset_wait()
        self._first_open_wait = progress.index + 1
        return []

    def _reset_wait(self) -> None:
        self.question, self._condition_watch, self._may_continue, self._waited_s = None, None, False, 0.0
        self._wait_index = -1

    def _next_segments(self, now_s: float, reading: Reading) -> tuple[Segment, ...]:
        """The next segments to send; also decides branches, and sets `done` at the end of the part."""
        course, index = self.flight.course, self.flight.index
        if index >= len(course.segments) and course.decision is not None and not self.flight.paused:
            self._choose_branch(now_s, reading)
        end_index = course.next_px4_segment(index)
        if index >= end_index and (course.flown_by_px4(end_index) or course.decision is None):
            self.done = self._continue_at is None and not self.flight.paused
            return ()
        ahead_s = sum(s.duration_s for s in course.segments[index : self._sent_end])
        if self._sent_end >= end_index or ahead_s >= AHEAD_S:
            return ()
        first, self._sent_end = self._sent_end, self.flight.chunk_end(self._sent_end, end_index)
        return tuple(course.segments[first : self._sent_end])

    def _choose_branch(self, now_s: float, reading: Reading) -> None:
        decision = self.flight.course.decision
        assert decision is not None
        if self._condition_watch is None:
            self._condition_watch = ConditionWatch(
                decision.value, decision.above, decision.below, decision.for_s
            )
        fulfilled = self._condition_watch.is_fulfilled(now_s, reading)
        if fulfilled or not self._condition_watch.is_true(reading):
            self.flight.course.choose(fulfilled)
            self._reset_wait()

    def _change_script(self, now_s: float, appended: tuple[Segment, ...]) -> list[Request]:
        """The request that sends the pause state and new segments: when they change, and periodically."""
        pause_state = (self.flight.paused or self._continue_at is not None, self._first_open_wait)
        if not appended and pause_state == self._last_pause_state and now_s - self._last_sent_s < RENEW_S:
            return []
        self._last_pause_state, self._last_sent_s = pause_state, now_s
        change = ScriptChange(pause_state[0], pause_state[1], appended)
        if self._ground_sampler is not None:
            self._ground_sampler.change_script(change)
            return []
        return [ChangeScript(change)]


def _timeout_text(segment: WaitSegment) -> str:
    if segment.kind == "meet":
        return f"Not all vehicles arrived at the meeting {segment.message!r}"
    return "No answer" if segment.kind == "person" else "The condition did not become true"


def _reason(text: str | None) -> str:
    return (text or "The setpoint stream has ended").rstrip(".")
