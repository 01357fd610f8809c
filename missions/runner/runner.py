"""Executes a compiled mission part by part, without clock, server or simulator.

Whoever drives it calls `tick` about ten times a second with what is known of the vehicle, carries out what it
asks for, and says which of it failed. It acts only while it is in charge: once somebody else flies the
vehicle (its pilot, an operator's command, PX4's failsafe) it asks for nothing, until a person resumes it.
"""

from __future__ import annotations

from missions.offboard.segments import WaitSegment
from missions.offboard.timeline import Timeline
from missions.runner.corridor import Corridor, CorridorWatch
from missions.runner.ending import Ending
from missions.runner.flight import Flight
from missions.runner.parts import LandPart, Part, TakeOffPart
from missions.runner.payload import release_gimbal
from missions.runner.reading import Reading
from missions.runner.requests import (
    MODE_OF,
    NAME_OF,
    Photo,
    Play,
    Request,
    SetMode,
    StopStream,
    TakeOff,
)
from missions.runner.status import CannotDo, RunnerStatus
from missions.runner.stretch import StretchPart
from missions.runner.watch import IN_FLIGHT, FlightWatch, missing_estimate, who_took_over
from missions.trajectory.limits import MotionLimits

LOW_BATTERY_SHARE = 0.15
"""BAT_LOW_THR."""


class Runner(Ending):
    """One flight of a mission.

    Args:
        timeline: compiled for the vehicle's position.
        name: name of the mission.
        motion: limits for pauses and for approaches to the path, with the wanted speed.
        low_battery_share: at this charge the mission's action for low battery is executed.
        corridor: corridor of a dry run; leaving it is reported.
    """

    def __init__(
        self,
        timeline: Timeline,
        name: str,
        motion: MotionLimits | None = None,
        low_battery_share: float = LOW_BATTERY_SHARE,
        corridor: Corridor | None = None,
    ) -> None:
        super().__init__()
        self.flight = Flight(timeline, name, motion or MotionLimits(speed_m_s=5.0))
        self._watch = FlightWatch(self.flight, low_battery_share)
        self._corridor = None if corridor is None else CorridorWatch(corridor)
        self._part: Part | None = None
        self._had_link = True
        self._was_in_air = False
        self._payload_told: set[str] = set()

    # --- requests of clients ----------------------------------------------------------------------

    def start(self, now_s: float, reading: Reading) -> list[Request]:
        """Starts the mission for the client in control.

        Raises:
            CannotDo: An estimate is missing that the mission needs.
        """
        self.require_startable(reading)
        self._watch.answered_for(reading)
        self._begin_part(now_s, reading)
        return self._taken()

    def require_startable(self, reading: Reading) -> None:
        """Raises CannotDo if it cannot begin now."""
        missing = missing_estimate(self.flight, reading, self.flight.needs)
        if missing is not None:
            raise CannotDo(f"there is no valid estimate of {missing}", "Wait until the vehicle has it.")

    def pause(self, now_s: float, reading: Reading, by: str) -> list[Request]:
        """Pauses: on the path in Offboard, or in Hold during take-off and landing."""
        part = self._in_charge("pause")
        if isinstance(part, StretchPart):
            self.flight.paused = True
            self._tell("paused", f"{by} paused it.")
            return self._taken()
        self._suspend(f"{by} paused it")
        self._paused_in_hold = True
        if not reading.on_ground or reading.armed:
            self._out.append(SetMode("hold"))
        return self._taken()

    def resume(self, now_s: float, reading: Reading, by: str) -> list[Request]:
        """Resumes: along the path, or back to it if the vehicle has left it.

        Raises:
            CannotDo: It is neither paused nor suspended, or an estimate is missing.
        """
        self.require_resumable(reading)
        part = self._part
        if not self._suspended and isinstance(part, StretchPart):
            part.resume()
        else:
            self._suspended, self._paused_in_hold, self._reason = False, False, None
            self.flight.paused = False
            self._begin_part(now_s, reading)
        self._watch.answered_for(reading)
        self._tell("resumed", f"{by} resumed it.")
        return self._taken()

    def require_resumable(self, reading: Reading) -> None:
        """Raises CannotDo if it cannot be resumed now."""
        self._require_not_over("resume")
        if not self._suspended:
            if not self.flight.paused or not isinstance(self._part, StretchPart):
                raise CannotDo("it is not paused", "Pause it first.")
            return
        missing = missing_estimate(self.flight, reading, IN_FLIGHT)
        if missing is not None and not reading.on_ground:
            raise CannotDo(f"there is no valid estimate of {missing}", "Wait until the vehicle has it.")

    def skip(self, now_s: float, reading: Reading, by: str) -> list[Request]:
        """Continues with the next step; a suspended mission will resume there.

        Raises:
            CannotDo: The vehicle is on the ground and the step is its take-off.
        """
        self._require_not_over("skip a step")
        flight, part = self.flight, self._part
        if isinstance(part, TakeOffPart) and reading.on_ground and not self._suspended:
            raise CannotDo("the vehicle is still on the ground", "Wait until it has lifted off, or abort.")
        self._tell("skipped", f"{by} skipped {flight.segment.place if flight.segment else 'the end'}.")
        if self._suspended:
            flight.move_to(flight.course.next_step(flight.index))
        elif isinstance(part, StretchPart):
            part.skip()
        else:
            flight.move_to(flight.index + 1)
            self._begin_part(now_s, reading)
        return self._taken()

    def go_on(self, by: str) -> list[Request]:
        """Continues after a wait for the operator.

        Raises:
            CannotDo: The mission is not waiting for the operator.
        """
        part = self._part
        if self._suspended or not isinstance(part, StretchPart) or not part.answer():
            raise CannotDo(
                "it is not waiting for the operator", "The mission's status says what it is waiting for."
            )
        self._tell("answered", f"{by} continued the mission.")
        return self._taken()

    def abort(self, reading: Reading, by: str, then: str = "hold") -> list[Request]:
        """Aborts the mission; the vehicle holds, returns or lands.

        A mission that does not fly the vehicle ends without a command, unless `then` is return or land.
        """
        self._require_not_over("abort")
        flies = not reading.on_ground or bool(reading.armed)
        if flies and (not self._suspended or then != "hold"):
            self._out.append(SetMode(MODE_OF[then]))
        self._end("aborted", f"{by} aborted it")
        return self._taken()

    # --- with other roles -------------------------------------------------------------------------

    @property
    def stretch(self) -> StretchPart | None:
        """What it flies between take-off and landing; None: it does not now."""
        return self._part if self.in_charge and isinstance(self._part, StretchPart) else None

    @property
    def paused(self) -> bool:
        """Whether a person has paused it, or somebody has taken control."""
        return self._over is None and (self._paused_in_hold or (self.in_charge and self.flight.paused))

    def stop(self, reading: Reading, reason: str) -> list[Request]:
        """Ends it because another role has left the mission: the vehicle holds; a landing goes on."""
        if self._over is not None:
            return []
        lands = isinstance(self._part, LandPart) and not self._suspended
        begun = isinstance(self._part, TakeOffPart) or not reading.on_ground
        if self.in_charge and begun and not lands:
            self._out.append(SetMode("hold"))
        self._end("stopped", reason)
        return self._taken()

    # --- time -------------------------------------------------------------------------------------

    def tick(self, now_s: float, reading: Reading) -> list[Request]:
        """Updates with a reading; returns the requests to execute."""
        self._look(now_s, reading)
        return self._taken()

    def failed(self, request: Request, reading: Reading, text: str) -> list[Request]:
        """Handles a failed request."""
        text = text.rstrip(".")
        if self._over is not None:
            self._tell("failed", f"{text}.", warning=True)
        elif isinstance(request, TakeOff):
            if not self._suspended:
                self._suspend(f"The take-off failed: {text}")
        elif isinstance(request, Play):
            if not self._suspended:
                self._act(self.flight.actions.failure, f"The path cannot be flown: {text}", reading)
        elif isinstance(request, SetMode):
            if not self._suspended:
                self._suspend(f"The vehicle did not change its mode: {text}")
            else:
                self._tell("failed", f"The vehicle did not change its mode: {text}.", warning=True)
        else:
            self._payload_failed(request, text)
        return self._taken()

    def status(self, reading: Reading) -> RunnerStatus:
        """Status of the mission."""
        flight, part = self.flight, self._part
        segment, deviation_m = flight.segment, None
        state = self._over or ("ready" if part is None else "suspended" if self._suspended else part.state)
        if self._over is not None:
            segment = None
        elif isinstance(part, StretchPart) and state not in ("suspended", "ready"):
            deviation_m = part.deviation_m(reading)
        return RunnerStatus(
            state=state,
            place=segment.place if segment else None,
            title=segment.title if segment else None,
            step=flight.index if segment else None,
            remaining_s=None if self._over else flight.course.remaining_s(flight.index, flight.t_s),
            deviation_m=deviation_m,
            outside_corridor_m=self._corridor.outside_m if self._corridor and self._over is None else None,
            question=part.question if part is not None and not self._suspended and not self._over else None,
            reason=self._reason,
        )

    @property
    def in_charge(self) -> bool:
        """Whether the mission flies the vehicle."""
        return self._part is not None and not self._suspended and self._over is None

    # --- inside: one update -----------------------------------------------------------------------

    def _look(self, now_s: float, reading: Reading) -> None:
        part = self._part
        if self._over is not None or part is None:
            return
        if not reading.link_heard:
            self._had_link = False
            return
        link_came_back, self._had_link = not self._had_link, True
        self._was_in_air |= reading.in_air
        if self._suspended:
            if reading.armed is False and self._was_in_air:
                self._end("stopped", self._reason or "The vehicle has landed")
            return
        if link_came_back and self._after_lost_link(now_s, reading, part):
            return
        if part.in_offboard and self._was_in_air and reading.armed is False:
            self._end("stopped", "The vehicle disarmed")
            self._out.append(StopStream())
            return
        if not part.expects(reading):
            self._taken_over(reading)
            return
        for failure in self._watch.look(now_s, reading, by_setpoints=part.in_offboard):
            self._act(failure.action, failure.text, reading)
            if self._suspended:
                return
        self._watch_corridor(now_s, reading)
        self._out += part.tick(now_s, reading)
        if part.failure is not None:
            failure, part.failure = part.failure, None
            self._act(failure.action, failure.text, reading)
        elif part.done:
            if not isinstance(part, StretchPart):
                self.flight.move_to(self.flight.index + 1)
            self._begin_part(now_s, reading)

    def _watch_corridor(self, now_s: float, reading: Reading) -> None:
        watch = self._corridor
        if watch is None or not reading.in_air or not watch.update(now_s, reading.position_ned_m):
            return
        self._out.append(watch.told())

    def _begin_part(self, now_s: float, reading: Reading) -> None:
        """Of the present place, with whatever needs nothing to be done left out."""
        flight = self.flight
        while isinstance(segment := flight.segment, WaitSegment) and flight.course.is_cut(flight.index):
            done = reading.on_ground if segment.kind == "land" else not reading.on_ground
            if not done:
                part = (TakeOffPart if segment.kind == "take_off" else LandPart)(flight, segment)
                break
            flight.move_to(flight.index + 1)
        else:
            if flight.segment is None and flight.course.decision is None:
                self._complete(reading)
                return
            part = StretchPart(flight)
        self._part = part
        self._watch.begin_part()
        self._was_in_air = reading.in_air
        self._out += part.begin(now_s, reading)
        if part.failure is not None:
            failure, part.failure = part.failure, None
            self._act(failure.action, failure.text, reading)

    def _complete(self, reading: Reading) -> None:
        if not reading.on_ground:
            self._out.append(SetMode("hold"))
        self._out += release_gimbal(self.flight)
        self._end("done", None)

    # --- inside: mode changes ---------------------------------------------------------------------

    def _taken_over(self, reading: Reading) -> None:
        """Suspends: another party flies the vehicle, so nothing is commanded."""
        self._out.append(StopStream())
        self._suspend(who_took_over(reading))

    def _after_lost_link(self, now_s: float, reading: Reading, part: Part) -> bool:
        """Handles a restored link; True: this update is complete.

        PX4 flies take-off and landing by itself. The stream has ended with the link, and PX4 or the stream
        has changed the mode: the mission continues only from a Hold that no other party commanded.
        """
        if not part.in_offboard or reading.stream == "flying":
            return False
        action = self.flight.actions.link_loss
        ours = reading.mode == "offboard" or (
            reading.mode == "hold" and reading.mode_source not in ("pilot", "failsafe", "station")
        )
        if not ours or reading.on_ground:
            self._taken_over(reading)
        elif action == "continue":
            self._tell("link_back", "The link was lost and is back: continuing.")
            self._begin_part(now_s, reading)
        else:
            self._act(action, "The link was lost and is back", reading)
        return True

    # --- inside: actions --------------------------------------------------------------------------

    def _act(self, action: str, why: str, reading: Reading) -> None:
        """Executes the mission's action for a problem; a landing always continues."""
        if action == "pause":
            self.flight.paused = True
            self._tell("control_taken", f"{why}: paused.", warning=True)
            return
        if action == "continue" or isinstance(self._part, LandPart):
            self._tell("continued", f"{why}: continuing.", warning=True)
            return
        if reading.on_ground and not reading.armed:
            self._suspend(why)
            return
        if missing_estimate(self.flight, reading, ("position",)) is not None:
            action = "land"
        self._suspend(f"{why}: {NAME_OF[action]}")
        self._out.append(SetMode(MODE_OF[action]))

    def _payload_failed(self, request: Request, text: str) -> None:
        what = "A picture was not taken" if isinstance(request, Photo) else "The gimbal did not follow"
        if what not in self._payload_told:
            self._payload_told.add(what)
            self._tell("payload", f"{what}: {text}. The mission continues.", warning=True)

    def _in_charge(self, what: str) -> Part:
        self._require_not_over(what)
        if self._part is None or self._suspended:
            raise CannotDo("it does not fly the vehicle now", "Resume it first.")
        return self._part

    def _require_not_over(self, what: str) -> None:
        if self._over is not None:
            raise CannotDo(f"the mission has ended: there is nothing to {what}", "Start it anew.")
