"""PX4's autotune of a multicopter (MAV_CMD_DO_AUTOTUNE_ENABLE): starts it, follows it, ends it.

The vehicle moves about roll, pitch and yaw by itself and computes gains of its controllers. It ends by
itself, also without a ground station: with gains, or without them when a stick of roll or pitch is moved by
more than 5 %, the mode changes, or a step lasts 20 s. The command cannot end it: a copy of it that arrives
after the end starts it again, up to v1.17 whatever its parameters say. Therefore it is followed only as
`autotune_polls.py` allows; after that by MC_AT_START, whose reading starts nothing: PX4 up to v1.17 sets it
to 0 at the end.

MC_AT_APPLY says what becomes of the gains: 0, they are only in the log; 1, PX4 writes them once disarmed; 2,
in flight.
"""

from __future__ import annotations

import asyncio
from collections.abc import Collection
from dataclasses import dataclass
from typing import Final, Protocol, Unpack

from gcs_server.errors import Disconnected, GcsError, Interrupted, NoReply, PlanFindings, Refused, Rejected
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.mailbox import Reply, Waiter
from gcs_server.vehicle.px4.modes import BY_NAME
from gcs_server.vehicle.samples import GlobalPosition
from gcs_server.vehicle.services.autotune_polls import AutotunePolls
from gcs_server.vehicle.services.command import CommandOptions, CommandService
from gcs_server.vehicle.services.param_changes import ConfigurableVehicle
from gcs_server.vehicle.services.transaction import RESULT_TEXT, ReportProgress, Request, is_our_ack
from gcs_server.vehicle.tickets import Ticket

MODES: Final = ("position", "position_slow", "altitude", "hold")
MIN_HEIGHT_M: Final = 4.0
"""PX4's documentation advises 4 to 20 m."""
BEGINS_WITHIN_S: Final = 23.0
"""PX4 ends its preparation after 20 s: progress 0 for longer is a vehicle whose module does not run [s]."""
MAX_DURATION_S: Final = 150.0
"""Longer than all steps of PX4 together: 20 s each at most [s]."""
WATCH_PERIOD_S: Final = 1.0
STEP_LIMIT_S: Final = 19.0
"""A step that lasted so long was ended by PX4's limit of 20 s [s]."""
MODE_REPORTED_S: Final = 1.2
"""A mode whose change has ended autotune is in the next heartbeat [s]."""
LAND_S: Final = 0.5
"""PX4 looks at the mode every 0.1 s."""
ENABLED, APPLY, START = "MC_AT_EN", "MC_AT_APPLY", "MC_AT_START"
LOW = "autotune_low"
APPLIES: Final = {1: "autotune_applies_after_disarming", 2: "autotune_applies_in_flight"}
"""Codes of the findings that the caller of `start` accepts."""
APPLIES_TEXT: Final = {1: "once it is disarmed", 2: "in flight, as soon as it has found them"}
STEPS: Final = ((20, "roll"), (40, "pitch"), (60, "yaw"))


class AutotuneVehicle(ConfigurableVehicle, Protocol):
    """A vehicle with parameters and commands."""

    command: CommandService


@dataclass(frozen=True, slots=True)
class AutotuneState:
    """Whether autotune can start, and what becomes of its gains."""

    enabled: bool | None
    """MC_AT_EN; null: the vehicle did not answer."""
    apply: int | None
    """MC_AT_APPLY. 0: gains are only in the log; 1: PX4 writes them once disarmed; 2: in flight."""
    running: bool | None
    """Whether it runs; null: the vehicle has no MC_AT_START (PX4 from v1.18 on), or did not answer."""
    problem: str | None
    """Why it cannot start now; null: it can."""
    remedy: str | None
    """What to do about it."""


@dataclass(slots=True)
class AutotuneRun:
    """A run that was started."""

    polls: AutotunePolls
    apply: int
    mode: str
    start_s: float
    watchable: bool
    """Whether the vehicle has MC_AT_START."""
    progress: int = 0
    """Newest progress [%]."""
    step_s: float = 0.0
    """Time of the first answer with this progress [s, monotonic]."""
    interrupted: str | None = None
    """Why nothing more may be sent; None: it may."""
    first: Reply | None = None
    """The answer to the start, until it was looked at."""


class AutotuneService:
    """Autotune of one vehicle."""

    def __init__(self, vehicle: AutotuneVehicle) -> None:
        self._vehicle = vehicle
        self._run: AutotuneRun | None = None

    async def state(self) -> AutotuneState:
        """Reads the vehicle's settings.

        Raises:
            Refused, NotVerified, Disconnected: the vehicle cannot be asked.
        """
        self._vehicle.require("parameters")
        enabled, apply, start = [await self._read(name) for name in (ENABLED, APPLY, START)]
        running = True if self._run is not None else None if start is None else start != 0
        refusal = self._refusal(enabled, apply, running is True)
        why = (None, None) if refusal is None else (str(refusal), refusal.remedy)
        return AutotuneState(None if enabled is None else enabled != 0, apply, running, *why)

    async def start(self, ticket: Ticket, *, despite: Collection[str] = ()) -> AutotuneRun:
        """Starts autotune; returns once the vehicle has answered that it runs.

        Args:
            ticket: the ticket of the command.
            despite: accepted findings: `LOW`, and those of `APPLIES`.

        Raises:
            Refused: it cannot start now.
            PlanFindings: there are findings that the caller has not accepted.
            Rejected: the vehicle refuses.
            NoReply: the vehicle did not answer; it is not known whether it has started.
        """
        vehicle = self._vehicle
        vehicle.require_commandable()
        vehicle.command.require_no_kill("autotune")
        enabled, apply, start = [await self._read(name) for name in (ENABLED, APPLY, START)]
        if (refusal := self._refusal(enabled, apply, start == 1)) is not None:
            raise refusal
        assert apply is not None
        self._require_accepted(apply, despite)
        ticket.claim()
        now_s = vehicle.clock.monotonic_s()
        run = AutotuneRun(AutotunePolls(now_s), apply, vehicle.status.mode, now_s, start is not None)
        self._run = run
        try:
            await self._begin(run, ticket)
        except BaseException:
            self._run = None
            raise
        return run

    async def follow(self, run: AutotuneRun, ticket: Ticket, report: ReportProgress) -> dict[str, object]:
        """Follows a started run to its end.

        Returns:
            `outcome`: `complete`, or `waits_for_disarming`: PX4 writes the gains then; and `apply`.

        Raises:
            Rejected: it ended without gains.
            Interrupted: it is no longer followed; or it ended after a later command.
            NoReply: its result is not known.
        """
        try:
            outcome = await self._ask(run, ticket, report) or await self._watch(run, report)
            return {"outcome": outcome, "apply": run.apply}
        except asyncio.CancelledError:
            raise Interrupted(
                f"The autotune of vehicle {self._vehicle.id} is no longer followed. The vehicle goes on by "
                "itself to its end; “End autotune” ends it."
            ) from None
        finally:
            ticket.close()
            self._run = None

    async def end(self, **options: Unpack[CommandOptions]) -> None:
        """Ends autotune by a change of the mode, and leaves the vehicle in Hold. In Hold it is first in Land
        for about a second, because PX4 ends autotune only when the mode changes.

        Raises:
            Refused: autotune does not run.
        """
        vehicle = self._vehicle
        vehicle.require_commandable()
        if self._run is None and await self._read(START) == 0:
            raise Refused(f"Vehicle {vehicle.id} does not tune itself.")
        if vehicle.status.mode == "hold":
            await vehicle.command.set_mode("land", **options)
            await vehicle.clock.sleep(LAND_S)
        await vehicle.command.hold(**options)

    # --- internal -------------------------------------------------------------------------------------

    async def _read(self, name: str) -> int | None:
        """A parameter; None: the vehicle does not have it, or did not answer."""
        try:
            return int((await self._vehicle.params.get(name)).value)
        except (NoReply, Rejected, ValueError, OverflowError):
            return None

    def _refusal(self, enabled: int | None, apply: int | None, running: bool) -> Refused | None:
        """Why autotune cannot start, whatever the caller accepts; None: it can."""
        vehicle, state = self._vehicle, self._vehicle.flight_state
        if enabled is None or apply is None:
            return Refused(
                f"Vehicle {vehicle.id} does not answer about its autotune ({ENABLED}, {APPLY}).",
                remedy="Its PX4 may be built without it; otherwise check the link.",
            )
        if not enabled:
            return Refused(
                f"Autotune is off on vehicle {vehicle.id} ({ENABLED} is 0).",
                remedy=f"Land, set {ENABLED} to 1, and restart the vehicle.",
            )
        if running or self._run is not None:
            return Refused(
                f"Vehicle {vehicle.id} is already tuning itself ({START} is 1).",
                remedy="Wait for its end, or end it.",
            )
        if not state.armed or state.landed_state != "in_air":
            return Refused(f"Vehicle {vehicle.id} is not flying.", remedy="Take off first.")
        if vehicle.status.mode not in MODES:
            return Refused(
                f"Autotune cannot start in {vehicle.status.mode_label}.",
                remedy="Switch to Position, Altitude or Hold.",
            )
        return None

    def _require_accepted(self, apply: int, despite: Collection[str]) -> None:
        """Raises PlanFindings."""
        vehicle = self._vehicle
        found: dict[str, str] = {}
        if (code := APPLIES.get(apply)) is not None:
            when = APPLIES_TEXT[apply]
            found[code] = f"Vehicle {vehicle.id} writes the gains itself, {when} ({APPLY} is {apply})."
        sample = vehicle.topic("global_position")
        height_m = sample.value.alt_home_m if sample and isinstance(sample.value, GlobalPosition) else None
        if height_m is not None and height_m < MIN_HEIGHT_M:
            found[LOW] = (
                f"Vehicle {vehicle.id} is only {height_m:.1f} m above home; "
                f"at least {MIN_HEIGHT_M:.0f} m are advised."
            )
        missing = [code for code in found if code not in despite]
        if missing:
            raise PlanFindings(
                " ".join(found[code] for code in missing),
                codes=tuple(missing),
                reasons=tuple(found[code] for code in missing),
                remedy="Climb first; or name the code in `despite`."
                if missing == [LOW]
                else f"Set {APPLY} to 0 to prove gains before they are written; or name the codes.",
            )

    async def _begin(self, run: AutotuneRun, ticket: Ticket) -> None:
        vehicle = self._vehicle
        with vehicle.mailbox.expect(d.MAVLINK_MSG_ID_COMMAND_ACK) as waiter:
            answer = await self._answer(run, waiter, ticket)
        if answer is None:
            if run.watchable and await self._read(START) == 1:
                return  # it runs, and is followed without requests
            raise NoReply(
                f"Vehicle {vehicle.id} did not answer the start of autotune. It may be tuning itself.",
                deadline_s=run.polls.silent_s - run.start_s,
                remedy="Watch the vehicle; another mode or a stick ends autotune.",
            )
        if answer.result == d.MAV_RESULT_IN_PROGRESS:
            run.first = answer
        elif answer.result in (d.MAV_RESULT_ACCEPTED, d.MAV_RESULT_FAILED):
            raise Rejected(
                f"Vehicle {vehicle.id} has not started autotune: it still reports the end of an earlier run.",
                mav_result=answer.result,
                remedy="Start it again in 3 s; if it still does not start, land and restart the vehicle.",
            )
        else:
            reason = RESULT_TEXT.get(answer.result, f"result {answer.result}")
            raise Rejected(
                f"Vehicle {vehicle.id} refused autotune: {reason}.",
                mav_result=answer.result,
                remedy=f"Its autotune runs only if {ENABLED} was 1 when the vehicle started.",
            )

    async def _answer(self, run: AutotuneRun, waiter: Waiter, ticket: Ticket) -> Reply | None:
        """Sends requests as they are due, until the vehicle answers; None: it did not, and none may be sent
        any more.

        Raises:
            Interrupted: a later command was accepted, or the client has lost control.
        """
        vehicle, polls = self._vehicle, run.polls
        identity = vehicle.identity
        request = Request(d.MAV_CMD_DO_AUTOTUNE_ENABLE, (1.0, 0, 0, 0, 0, 0, 0))
        while (now_s := vehicle.clock.monotonic_s()) < polls.silent_s:
            if now_s >= polls.next_s:
                ticket.require()
                message = request.message(identity.system_id, identity.component_id, 0, False)
                vehicle.send(message, until_s=polls.until_s)
                polls.sent(now_s)
            try:
                async with asyncio.timeout(max(0.0, min(polls.next_s, polls.silent_s) - now_s)):
                    message = await waiter.next()
            except TimeoutError:
                continue
            if is_our_ack(message, vehicle, request.command):
                return message
        return None

    async def _ask(self, run: AutotuneRun, ticket: Ticket, report: ReportProgress) -> str | None:
        """Follows a run by its answers; None: it must be watched from now on."""
        with self._vehicle.mailbox.expect(d.MAVLINK_MSG_ID_COMMAND_ACK) as waiter:
            while True:
                try:
                    answer = run.first or await self._answer(run, waiter, ticket)
                except Interrupted as error:
                    run.interrupted = str(error)
                    return None
                except Disconnected:
                    return None
                run.first = None
                if answer is None:
                    return None
                if (outcome := await self._take(run, answer, report)) is not None:
                    return outcome

    async def _take(self, run: AutotuneRun, answer: Reply, report: ReportProgress) -> str | None:
        """The outcome that an answer tells; None: autotune goes on.

        Raises:
            Rejected: it has ended without gains.
        """
        now_s, vehicle = self._vehicle.clock.monotonic_s(), self._vehicle
        if answer.result == d.MAV_RESULT_ACCEPTED:
            return "complete"
        if answer.result != d.MAV_RESULT_IN_PROGRESS:
            await vehicle.clock.sleep(MODE_REPORTED_S)
            raise Rejected(self._failure(run, now_s), mav_result=answer.result, remedy=self._advice(run))
        run.polls.answered(now_s)
        if answer.progress != run.progress or not run.step_s:
            run.progress, run.step_s = answer.progress, now_s
        if run.progress >= 95:
            return "waits_for_disarming"
        if run.progress == 0 and now_s - run.start_s > BEGINS_WITHIN_S:
            if run.watchable:  # otherwise the vehicle would begin to tune after its next boot
                await vehicle.params.set(START, 0)
                remedy = f"It must be restarted after {ENABLED} was set to 1: land and restart it."
            else:  # PX4 v1.18 tunes once a boot, and takes a second start with the next change of a parameter
                remedy = "It may still begin, with the next change of a parameter: land and restart it."
            raise Rejected(
                f"Vehicle {vehicle.id} accepted autotune and does not begin.",
                mav_result=answer.result,
                remedy=remedy,
            )
        report(self._step_text(run.progress), run.progress / 100)
        return None

    async def _watch(self, run: AutotuneRun, report: ReportProgress) -> str:
        """Watches a run that must not be asked any more, by a parameter whose reading starts nothing.

        Raises:
            Interrupted: it ended after a later command.
            NoReply: its result is not known.
        """
        vehicle = self._vehicle
        if not run.watchable:
            raise self._unknown(
                run, f"It is not known whether the autotune of vehicle {vehicle.id} goes on. {self._why(run)}"
            )
        while vehicle.clock.monotonic_s() < run.start_s + MAX_DURATION_S:
            why = self._why(run)
            report(
                f"Tuning goes on; its progress is not known. A stick of roll or pitch ends it. {why}", None
            )
            await vehicle.clock.sleep(WATCH_PERIOD_S)
            try:
                value = await self._read(START)
            except GcsError:  # not connected now
                continue
            if value == 0 and run.interrupted is not None:
                raise Interrupted(f"Autotune ended before it was complete. {run.interrupted}")
            if value == 0:
                raise self._unknown(
                    run,
                    f"Autotune of vehicle {vehicle.id} has ended; its result is not known. {self._why(run)}",
                )
        raise self._unknown(
            run, f"The autotune of vehicle {vehicle.id} has not ended within {MAX_DURATION_S:.0f} s."
        )

    def _why(self, run: AutotuneRun) -> str:
        if run.interrupted is not None:
            return run.interrupted
        return "Too many answers were lost; asking again could start it again."

    def _unknown(self, run: AutotuneRun, text: str) -> NoReply:
        return NoReply(
            text,
            deadline_s=self._vehicle.clock.monotonic_s() - run.start_s,
            remedy="Watch the vehicle: another mode or a stick ends autotune. The log says how it ended.",
        )

    def _step_text(self, progress: int) -> str:
        axis = next((name for percent, name in STEPS if percent == progress), None)
        if axis is not None:
            return f"Vehicle {self._vehicle.id} moves about its {axis} axis."
        if progress < STEPS[0][0]:
            return f"Vehicle {self._vehicle.id} prepares autotune."
        return f"Vehicle {self._vehicle.id} checks the gains that it has found."

    def _failure(self, run: AutotuneRun, now_s: float) -> str:
        mode = self._vehicle.status.mode
        if mode != run.mode and (known := BY_NAME.get(mode)) is not None:
            reason = f"The mode changed to {known.label}."
        elif now_s - run.step_s >= STEP_LIMIT_S:
            reason = "It found no model of the vehicle within 20 s."
        elif run.progress >= 80:
            reason = "The gains that it found are out of range, or did not pass its test."
        else:
            reason = "A stick was moved, or the gains that it found are out of range."
        return f"Autotune of vehicle {self._vehicle.id} ended without gains. {reason}"

    def _advice(self, run: AutotuneRun) -> str:
        if run.progress >= 90 and run.apply == 2:
            return "It had written gains for its test: compare the parameters with those before the flight."
        return "If the vehicle hardly moved, raise MC_AT_SYSID_AMP; leave the sticks alone."
