"""Executes a compiled mission part by part, without clock, server or simulator.

The caller calls `tick` about ten times a second with the vehicle's state, executes the returned requests, and
reports failed requests. The runner acts only while the mission controls the vehicle. If the RC pilot, an
operator's command or a PX4 failsafe takes over, the runner requests nothing until an operator resumes the
mission.
"""

from __future__ import annotations

from missions.offboard.segments import Segment, WaitSegment
from missions.offboard.timeline import Timeline
from missions.runner.corridor import Corridor, CorridorWatch
from missions.runner.flight import Flight
from missions.runner.parts import LandPart, Part, TakeOffPart, release_gimbal
from missions.runner.reading import Reading
from missions.runner.requests import (
    ACTION_TEXTS,
    MODE_BY_ACTION,
    CannotDo,
    Notify,
    Photo,
    Request,
    RunnerStatus,
    SetMode,
    StopStream,
    StreamScript,
    TakeOff,
)
from missions.runner.setpoint_part import SetpointPart
from missions.runner.watch import (
    IN_FLIGHT,
    REPLACED,
    ExecutorControl,
    FlightWatch,
    missing_estimate,
    takeover_reason,
)
from missions.trajectory.limits import MotionLimits

LOW_BATTERY_SHARE = 0.15
"""Default of BAT_LOW_THR."""


class Runner:
    """One flight of a mission.

    Args:
        timeline: the mission, compiled for the vehicle's position.
        name: name of the mission.
        motion: limits, including the speed, for pauses and for approaches to the path.
        low_battery_share: battery charge at which the mission's low-battery action is executed.
        corridor: corridor of a dry run; the runner reports when the vehicle leaves it.
        mode: mode in which the vehicle follows setpoints: Offboard, or a mode registered with PX4.
    """

    def __init__(
        self,
        timeline: Timeline,
        name: str,
        motion: MotionLimits | None = None,
        low_battery_share: float = LOW_BATTERY_SHARE,
        corridor: Corridor | None = None,
        mode: str = "offboard",
    ) -> None:
        self.flight = Flight(timeline, name, motion or MotionLimits(speed_m_s=5.0), mode)
        self._watch = FlightWatch(self.flight, low_battery_share)
        self._corridor = None if corridor is None else CorridorWatch(corridor)
        self._executor_control = ExecutorControl()
        self._part: Part | None = None
        self._had_link = True
        self._was_in_air = False
        self._final_state: str | None = None
        self._reason: str | None = None
        self._suspended = False
        self._paused_in_hold = False
        """Whether the mission is suspended because the operator paused it during take-off or landing."""
        self._requests: list[Request] = []
        self._reported_payload_failures: set[str] = set()

    # --- requests of clients ----------------------------------------------------------------------

    def start(self, now_s: float, reading: Reading) -> list[Request]:
        """Starts the mission for the client in control.

        Raises:
            CannotDo: The mission needs an estimate that the vehicle does not have.
        """
        self.require_startable(reading)
        self._watch.record_start(reading)
        self._begin_part(now_s, reading)
        return self._take_requests()

    def require_startable(self, reading: Reading) -> None:
        """Raises CannotDo if the mission cannot start now."""
        missing = missing_estimate(self.flight, reading, self.flight.needs)
        if missing is not None:
            raise CannotDo(f"there is no valid estimate of {missing}", "Wait until the vehicle has it.")

    def pause(self, now_s: float, reading: Reading, by: str) -> list[Request]:
        """Pauses the mission: on the path, or in Hold mode during take-off and landing."""
        part = self._controlling_part("pause")
        if isinstance(part, SetpointPart):
            self.flight.paused = True
            self._notify("paused", f"{by} paused the mission.")
            return self._take_requests()
        self._suspend(f"{by} paused the mission")
        self._paused_in_hold = True
        if not reading.on_ground or reading.armed:
            self._requests.append(SetMode("hold"))
        return self._take_requests()

    def resume(self, now_s: float, reading: Reading, by: str) -> list[Request]:
        """Resumes the mission along the path. If the vehicle has left the path, it first returns to the path.

        Raises:
            CannotDo: The mission is neither paused nor suspended, or an estimate is missing.
        """
        self.require_resumable(reading)
        part = self._part
        self._watch.record_start(reading, may_be_selected=self._suspended)
        if not self._suspended and isinstance(part, SetpointPart):
            part.resume()
        else:
            self._suspended, self._paused_in_hold, self._reason = False, False, None
            self.flight.paused = False
            self._begin_part(now_s, reading)
        self._notify("resumed", f"{by} resumed the mission.")
        return self._take_requests()

    def require_resumable(self, reading: Reading) -> None:
        """Raises CannotDo if the mission cannot be resumed now."""
        self._require_not_over("resume")
        if not self._suspended:
            if not self.flight.paused or not isinstance(self._part, SetpointPart):
                raise CannotDo("the mission is not paused", "Pause the mission first.")
            return
        missing = missing_estimate(self.flight, reading, IN_FLIGHT)
        if missing is not None and not reading.on_ground:
            raise CannotDo(f"there is no valid estimate of {missing}", "Wait until the vehicle has it.")

    def skip(self, now_s: float, reading: Reading, by: str) -> list[Request]:
        """Continues with the next step. A suspended mission continues with the next step when it is resumed.

        Raises:
            CannotDo: The vehicle is on the ground and the step is its take-off.
        """
        self._require_not_over("skip a step")
        flight, part = self.flight, self._part
        if isinstance(part, TakeOffPart) and reading.on_ground and not self._suspended:
            raise CannotDo("the vehicle is still on the ground", "Wait until it has lifted off, or abort.")
        self._notify("skipped", f"{by} skipped {flight.segment.place if flight.segment else 'the end'}.")
        if self._suspended:
            flight.move_to(flight.course.next_step(flight.index))
        elif isinstance(part, SetpointPart):
            part.skip()
        else:
            flight.move_to(flight.index + 1)
            self._begin_part(now_s, reading)
        return self._take_requests()

    def continue_after_question(self, by: str) -> list[Request]:
        """Continues after a wait for the operator.

        Raises:
            CannotDo: The mission is not waiting for the operator.
        """
        part = self._part
        if self._suspended or not isinstance(part, SetpointPart) or not part.continue_after_question():
            raise CannotDo(
                "the mission is not waiting for the operator",
                "The mission's status shows its current step.",
            )
        self._notify("answered", f"{by} continued the mission.")
        return self._take_requests()

    def abort(self, reading: Reading, by: str, then: str = "hold") -> list[Request]:
        """Aborts the mission; the vehicle holds, returns or lands.

        If the mission does not control the vehicle, the mission ends without a command to the vehicle, unless
        `then` is return or land.
        """
        self._require_not_over("abort")
        is_flying_or_armed = not reading.on_ground or bool(reading.armed)
        if is_flying_or_armed and (not self._suspended or then != "hold"):
            self._requests.append(SetMode(MODE_BY_ACTION[then]))
        self._end("aborted", f"{by} aborted the mission")
        return self._take_requests()

    # --- with other roles -------------------------------------------------------------------------

    @property
    def setpoint_part(self) -> SetpointPart | None:
        """The current part; None: PX4 flies it, or the mission does not control the vehicle."""
        return self._part if self.in_charge and isinstance(self._part, SetpointPart) else None

    @property
    def interrupted(self) -> bool:
        """Whether the vehicle does not follow the setpoints, which keep it at its place."""
        part = self.setpoint_part
        return part is not None and part.interrupted

    @property
    def paused(self) -> bool:
        """Whether the mission is paused, by an operator or because control changed."""
        return self._final_state is None and (self._paused_in_hold or (self.in_charge and self.flight.paused))

    def stop(self, reading: Reading, reason: str) -> list[Request]:
        """Ends the mission because another role has left it; the vehicle holds, a landing continues."""
        if self._final_state is not None:
            return []
        is_landing = isinstance(self._part, LandPart) and not self._suspended
        has_taken_off = isinstance(self._part, TakeOffPart) or not reading.on_ground
        if self.in_charge and has_taken_off and not is_landing:
            self._requests.append(SetMode("hold"))
        self._end("stopped", reason)
        return self._take_requests()

    # --- time -------------------------------------------------------------------------------------

    def tick(self, now_s: float, reading: Reading) -> list[Request]:
        """Updates the mission with the vehicle's state; returns the requests to execute."""
        self._update(now_s, reading)
        return self._take_requests()

    def request_failed(self, request: Request, reading: Reading, text: str) -> list[Request]:
        """Handles a failed request."""
        text = text.rstrip(".")
        is_flight_command = isinstance(request, TakeOff | StreamScript | SetMode)
        if self._final_state is not None:
            self._notify("failed", f"{text}.", warning=True)
        elif is_flight_command and not self._suspended and self._executor_control.is_lost(reading):
            self._suspend_after_takeover(reading, REPLACED)
        elif isinstance(request, TakeOff):
            if not self._suspended:
                self._suspend(f"The take-off failed: {text}")
        elif isinstance(request, StreamScript):
            if not self._suspended:
                reason = f"The path cannot be flown: {text}"
                self._execute_action(self.flight.actions.failure, reason, reading)
        elif isinstance(request, SetMode):
            if not self._suspended:
                self._suspend(f"The vehicle did not change its mode: {text}")
            else:
                self._notify("failed", f"The vehicle did not change its mode: {text}.", warning=True)
        else:
            self._payload_failed(request, text)
        return self._take_requests()

    @property
    def over(self) -> bool:
        """Whether the mission is done, aborted or stopped."""
        return self._final_state is not None

    @property
    def early_end_reason(self) -> str | None:
        """The reason why the mission ended early or is suspended; None: it is active, paused or done."""
        if self._final_state in ("aborted", "stopped") or (self._suspended and not self._paused_in_hold):
            return self._reason or "The mission was interrupted"
        return None

    @property
    def state(self) -> str:
        """`RunnerStatus.state`."""
        if self._final_state is not None or self._part is None:
            return self._final_state or "ready"
        if not self._had_link and self._part.in_offboard and not self._suspended:
            return "not_following"
        return "suspended" if self._suspended else self._part.state

    @property
    def segment(self) -> Segment | None:
        """The current segment; None: the mission has ended."""
        return None if self._final_state is not None else self.flight.segment

    @property
    def question(self) -> str | None:
        """The question to the pilot; None: no question."""
        return self._part.question if self._part is not None and self.in_charge else None

    def status(self, reading: Reading) -> RunnerStatus:
        """Status of the mission."""
        flight, segment, deviation_m = self.flight, self.segment, None
        if self.in_charge and isinstance(self._part, SetpointPart):
            deviation_m = self._part.deviation_m(reading)
        return RunnerStatus(
            state=self.state,
            place=segment.place if segment else None,
            title=segment.title if segment else None,
            step=flight.index if segment else None,
            remaining_s=None if self.over else flight.course.remaining_s(flight.index, flight.t_s),
            deviation_m=deviation_m,
            outside_corridor_m=self._corridor.outside_m if self._corridor and not self.over else None,
            question=self.question,
            reason=self._reason,
        )

    @property
    def in_charge(self) -> bool:
        """Whether the mission controls the vehicle."""
        return self._part is not None and not self._suspended and self._final_state is None

    # --- inside: one update -----------------------------------------------------------------------

    def _update(self, now_s: float, reading: Reading) -> None:
        part = self._part
        if self._final_state is not None or part is None:
            return
        if not reading.link_active:
            self._had_link = False
            return
        link_is_back, self._had_link = not self._had_link, True
        self._was_in_air |= reading.in_air
        if self._suspended:
            if reading.armed is False and self._was_in_air:
                self._end("stopped", self._reason or "The vehicle has landed")
            return
        if link_is_back and self._handle_restored_link(now_s, reading, part):
            return
        if part.in_offboard and self._was_in_air and reading.armed is False:
            self._end("stopped", "The vehicle disarmed")
            self._requests.append(StopStream())
            return
        if not part.expects(reading):
            self._suspend_after_takeover(reading)
            return
        if self._executor_control.is_lost(reading):
            if self._executor_control.loss_confirmed(now_s):
                self._suspend_after_takeover(reading, REPLACED)
            return
        for failure in self._watch.problems(now_s, reading, by_setpoints=part.in_offboard):
            self._execute_action(failure.action, failure.text, reading)
            if self._suspended:
                return
        self._watch_corridor(now_s, reading)
        self._requests += part.tick(now_s, reading)
        if part.failure is not None:
            failure, part.failure = part.failure, None
            self._execute_action(failure.action, failure.text, reading)
        elif part.done:
            if not isinstance(part, SetpointPart):
                self.flight.move_to(self.flight.index + 1)
            self._begin_part(now_s, reading)

    def _watch_corridor(self, now_s: float, reading: Reading) -> None:
        watch = self._corridor
        if watch is None or not reading.in_air or not watch.update(now_s, reading.position_ned_m):
            return
        self._requests.append(watch.notification())

    def _begin_part(self, now_s: float, reading: Reading) -> None:
        """Starts the part of the current segment; skips a take-off in the air and a landing on the ground."""
        flight = self.flight
        while isinstance(segment := flight.segment, WaitSegment) and flight.course.flown_by_px4(flight.index):
            is_unnecessary = reading.on_ground if segment.kind == "land" else not reading.on_ground
            if not is_unnecessary:
                part = (TakeOffPart if segment.kind == "take_off" else LandPart)(flight, segment)
                break
            flight.move_to(flight.index + 1)
        else:
            if flight.segment is None and flight.course.decision is None:
                self._complete(reading)
                return
            part = SetpointPart(flight)
        self._part = part
        self._watch.begin_part()
        self._executor_control.begin_part(reading)
        self._was_in_air = reading.in_air
        self._requests += part.begin(now_s, reading)
        if part.failure is not None:
            failure, part.failure = part.failure, None
            self._execute_action(failure.action, failure.text, reading)

    def _complete(self, reading: Reading) -> None:
        if not reading.on_ground:
            self._requests.append(SetMode("hold"))
        self._requests += release_gimbal(self.flight)
        self._end("done", None)

    # --- inside: mode changes ---------------------------------------------------------------------

    def _suspend_after_takeover(self, reading: Reading, reason: str | None = None) -> None:
        """Suspends the mission, because another party controls the vehicle; no command is sent."""
        self._requests.append(StopStream())
        self._suspend(reason or takeover_reason(reading))

    def _handle_restored_link(self, now_s: float, reading: Reading, part: Part) -> bool:
        """Handles a restored link; returns whether this update is complete.

        PX4 flies take-off and landing by itself. The stream has ended with the link, and PX4 or the server
        has changed the mode. The mission continues only if the vehicle is in the mission's mode or in Hold,
        and no other party commanded this mode.
        """
        if not part.in_offboard or reading.stream == "flying":
            return False
        action = self.flight.actions.link_loss
        is_in_own_mode = reading.mode == self.flight.mode or (
            reading.mode == "hold" and reading.mode_source not in ("pilot", "failsafe", "station")
        )
        if not is_in_own_mode or reading.on_ground:
            self._suspend_after_takeover(reading)
        elif action == "continue":
            self._notify("link_back", "Connection lost and restored: continuing.")
            self._begin_part(now_s, reading)
        else:
            self._execute_action(action, "Connection lost and restored", reading)
        return True

    # --- inside: actions --------------------------------------------------------------------------

    def _execute_action(self, action: str, reason: str, reading: Reading) -> None:
        """Executes the mission's action for a problem; a landing always continues."""
        if action == "pause":
            self.flight.paused = True
            self._notify("control_taken", f"{reason}: paused.", warning=True)
            return
        if action == "continue" or isinstance(self._part, LandPart):
            self._notify("continued", f"{reason}: continuing.", warning=True)
            return
        if reading.on_ground and not reading.armed:
            self._suspend(reason)
            return
        if missing_estimate(self.flight, reading, ("position",)) is not None:
            action = "land"
        self._suspend(f"{reason}: {ACTION_TEXTS[action]}")
        self._requests.append(SetMode(MODE_BY_ACTION[action]))

    def _controlling_part(self, verb: str) -> Part:
        self._require_not_over(verb)
        if self._part is None or self._suspended:
            raise CannotDo("the mission does not control the vehicle now", "Resume the mission first.")
        return self._part

    def _take_requests(self) -> list[Request]:
        requests, self._requests = self._requests, []
        return requests

    def _suspend(self, reason: str) -> None:
        self._paused_in_hold = False
        self._suspended, self._reason = True, reason
        self._notify("suspended", f"{reason}.", warning=True)

    def _end(self, state: str, reason: str | None) -> None:
        self._final_state, self._reason = state, reason
        self._notify(state, f"{reason}." if reason else "The mission is done.", warning=state == "stopped")

    def _notify(self, code: str, text: str, *, warning: bool = False) -> None:
        self._requests.append(Notify(code, text, warning))

    def _payload_failed(self, request: Request, text: str) -> None:
        failure = "A photo was not taken" if isinstance(request, Photo) else "The gimbal did not follow"
        if failure not in self._reported_payload_failures:
            self._reported_payload_failures.add(failure)
            self._notify("payload", f"{failure}: {text}. The mission continues.", warning=True)

    def _require_not_over(self, verb: str) -> None:
        if self._final_state is not None:
            raise CannotDo(f"the mission has ended: there is nothing to {verb}", "Start the mission again.")
