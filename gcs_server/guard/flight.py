"""What a program flies: its setpoints as those of this server's stream, and who overrules it."""

from __future__ import annotations

import asyncio
from typing import Any, Final

from gcs_server.control.accepted import authorized_command
from gcs_server.control.commands import BY_NAME
from gcs_server.errors import GcsError, Refused
from gcs_server.guard import setpoints as program_setpoints
from gcs_server.guard.ends import Ends
from gcs_server.guard.program import Pending, Program
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import Frame, decode
from gcs_server.mavlink.tables import NAMES
from gcs_server.streamer.offboard.status import setpoint_view
from gcs_server.streamer.values.stream_request import OnExpiry, StreamRequest
from gcs_server.vehicle.vehicle import Vehicle
from missions.setpoints import Acceleration, Attitude, Rates, Setpoint

RATE_HZ: Final = 50.0
"""Setpoints per second to the vehicle; a newer one of the program is sent at once [Hz]."""
MAX_SETPOINT_HZ: Final = 100.0
"""More setpoints of a program per second than this are not flown: the newest counts [Hz]."""
FRESH_S: Final = 1.0
"""Offboard begins only with a setpoint that is at most this old, as PX4 requires two a second [s]."""
PROGRESS_AFTER_S: Final = 1.5
"""If Offboard takes longer to start, the program is told that it is in progress [s]."""
HOLD_FOR_S: Final = 5.0
"""After a setpoint has expired, the place is kept by setpoints for this time; then PX4's Hold [s]."""
WAITS = "The program's commands wait until a person lets it continue."
ENDED_S: Final = 5.0
"""Programs that have sent nothing for this time have been ended: whoever starts one again knows what it does
[s]."""
START = (0, b"offboard")
"""Key of a start of Offboard among the pending commands of a program."""


class ProgramFlight:
    """The flight of the programs of one link; of several programs one commands.

    Args:
        ends: the link and the vehicle.
    """

    def __init__(self, ends: Ends) -> None:
        self._ends = ends
        self._tasks: dict[str, asyncio.Task[Any]] = {}
        self.commanding: Program | None = None
        """The program whose commands and setpoints count."""
        self._streaming: Program | None = None
        """The program whose setpoints are flown, or begin to be."""
        self._starting = False
        self._own_ticket: int | None = None
        """Number of the ticket of the program's newest command that moves; None: none since its start."""
        self._own_unix_s = 0.0
        self.paused: str | None = None
        """Who has overruled the program; None: nobody."""

    @property
    def flying(self) -> bool:
        """Whether setpoints of a program are flown."""
        return self._streaming is not None and not self._starting

    def reset(self) -> None:
        """Called when the vehicle is another one, or gone."""
        self._streaming = self._own_ticket = self.paused = None

    def gone(self, program: Program) -> None:
        """Called when a program's peer was lost: its setpoints expire."""
        task = self._tasks.pop(program.peer.name, None)
        if task is not None:
            task.cancel()
        if self.commanding is program:
            self.commanding = None

    # --- who may command ------------------------------------------------------------------------

    def refusal_of(self, program: Program, row: str) -> GcsError | None:
        """Why this program may not give a command of this row; None: as far as the guard knows, it may."""
        command = BY_NAME[row]
        if self._ends.options.control == "read":
            return Refused("This link only reads: it was opened with guard=read.")
        if command.control != "open":
            other = self.commanding
            if other is not None and other is not program and other.is_present(self._ends.now_s()):
                return Refused(f"The program at {other.peer.name} commands over this link.")
            self.commanding = program
        flies = command.acts == "moves" or row in ("offboard/setpoint", "manual_control")
        if self.paused is not None and flies:
            return Refused(f"{self.paused} {WAITS}")
        return None

    def commanded(self, ticket_number: int) -> None:
        """Called when a command of the program that moves the vehicle was accepted."""
        self._own_ticket, self._own_unix_s = ticket_number, self._ends.unix_s()

    def resume(self) -> None:
        """Lets the program command again after it was overruled."""
        self.paused = self._own_ticket = None

    def tick(self, vehicle: Vehicle) -> None:
        """Looks ten times a second what has become of the flight."""
        self._check_stream(vehicle)
        now_s = self._ends.now_s()
        heard = any(now_s - program.heard_s <= ENDED_S for program in self._ends.programs.values())
        if not vehicle.flight_state.armed and not heard:
            self.resume()
        elif self.paused is None and (text := self._overruled(vehicle)) is not None:
            self.paused = text
            self._ends.tell_all(f"{text} {WAITS}")

    def _overruled(self, vehicle: Vehicle) -> str | None:
        """Who has commanded the vehicle since the program's newest command; None: nobody."""
        if self._own_ticket is None:
            return None
        newest, cause = vehicle.tickets.newest_claimed, vehicle.mode_cause
        if newest is not None and newest.number > self._own_ticket:
            command = vehicle.command.newest_command
            by = None if command is None or command.by == self._ends.principal.name else command.by
            return f"{by or 'Another client'} commanded “{newest.label}”."
        if cause is not None and cause.is_external and cause.since_unix_s > self._own_unix_s:
            return f"The mode was changed by {cause.text}."
        return None

    def _check_stream(self, vehicle: Vehicle) -> None:
        program, ends = self._streaming, self._ends
        if program is None or self._starting:
            return
        status = ends.station.offboard(vehicle.id).status()
        if not status.streaming or status.client_key != ends.principal.key:
            self._streaming = None
            program.limited = ()
            ends.tell(program, status.ended or "The setpoints of another client are flown.")
            return
        new = [text for text in status.limited if text not in program.limited]
        program.limited = status.limited
        for text in new:
            ends.tell(program, text, d.MAV_SEVERITY_NOTICE)
        if status.state == "holding":
            ends.tell(program, "No setpoint came in time: the vehicle holds its place.")

    # --- setpoints ------------------------------------------------------------------------------

    def take_setpoint(self, program: Program, frame: Frame) -> None:
        """Takes a setpoint message; the newest is applied soon."""
        program.take_setpoint(self._ends.now_s())
        program.waiting = frame
        program.arrived.set()
        if program.peer.name not in self._tasks:
            self._tasks[program.peer.name] = self._ends.supervisor.start(
                f"guard {self._ends.connection.name}: setpoints of {program.peer.name}",
                lambda: self._apply_setpoints(program),
            )

    async def _apply_setpoints(self, program: Program) -> None:
        """Applies the newest setpoint; older ones that still wait are superseded."""
        clock, next_s, period_s = self._ends.station.clock, 0.0, 1.0 / MAX_SETPOINT_HZ
        while True:
            await program.arrived.wait()
            wait_s = next_s - clock.monotonic_s()
            if wait_s > 0.0:
                await clock.sleep(wait_s)
            program.arrived.clear()
            next_s = max(next_s, clock.monotonic_s() - period_s) + period_s
            frame, program.waiting = program.waiting, None
            if frame is not None:
                await self._apply(program, frame)

    async def _apply(self, program: Program, frame: Frame) -> None:
        ends, vehicle = self._ends, self._ends.vehicle
        try:
            converted = program_setpoints.convert(decode(frame))
            setpoint = converted.setpoint
            program.setpoint_kind, program.left_out = setpoint.type, converted.left_out
            if program.newest is None or program.newest[1] != setpoint:
                program.same_since_s = ends.now_s()
            program.newest = (ends.now_s(), setpoint)
            if self._streaming is not program or vehicle is None:
                return
            refusal = self.refusal_of(program, "offboard/setpoint") or self._hangs(program, setpoint)
            with authorized_command(
                ends.station,
                ends.principal,
                "offboard/setpoint",
                vehicle.id,
                lambda: {"setpoint": setpoint_view(setpoint), "from": program.source},
                refusal=refusal,
            ):
                await ends.station.offboard(vehicle.id).setpoint(self._request(setpoint))
        except GcsError as error:
            if not self._starting:
                program.setpoints_refused += 1
                ends.refuse(program, frame, NAMES[frame.msg_id], error)

    def _hangs(self, program: Program, setpoint: Setpoint) -> GcsError | None:
        """Why a setpoint is taken for that of a program which hangs; None: it is not."""
        same_for_s = self._ends.options.same_for_s
        if not same_for_s or not _moves(setpoint) or self._ends.now_s() - program.same_since_s <= same_for_s:
            return None
        return Refused(
            f"The same {setpoint.type.replace('_', ' ')} has come for more than {same_for_s:g} s: "
            "the program may hang while its library repeats it.",
            remedy="Send another setpoint, or open the link with same_for_s=0.",
        )

    def _request(self, setpoint: Setpoint) -> StreamRequest:
        options, principal = self._ends.options, self._ends.principal
        on_expiry = OnExpiry(options.on_expiry, HOLD_FOR_S if options.on_expiry == "hold" else 0.0)
        return StreamRequest(setpoint, options.valid_for_s, on_expiry, principal.name, principal.key)

    # --- Offboard -------------------------------------------------------------------------------

    def start(self, program: Program, frame: Frame, vehicle: Vehicle, what: str) -> None:
        """Starts the stream with the program's newest setpoint, and acknowledges once the vehicle reports
        Offboard. A request that is sent again meanwhile is the same one."""
        if START not in program.pending:
            program.pending[START] = Pending(None, b"")
            work = self._start(program, frame, vehicle, what)
            self._ends.supervisor.spawn(f"guard {self._ends.connection.name}: Offboard", work)

    async def _start(self, program: Program, frame: Frame, vehicle: Vehicle, what: str) -> None:
        ends = self._ends
        late: asyncio.TimerHandle | None = None
        try:
            with authorized_command(
                ends.station,
                ends.principal,
                "offboard/start",
                vehicle.id,
                {"message": what, "from": program.source},
                refusal=self.refusal_of(program, "offboard/start"),
            ) as accepted:
                if not (self._streaming is program and vehicle.status.mode == "offboard"):
                    setpoint, ticket = self._fresh_setpoint(program), accepted.ticket
                    ticket.add_condition(lambda: self._stale(program))
                    late = asyncio.get_running_loop().call_later(
                        PROGRESS_AFTER_S, ends.acknowledge, program, frame, d.MAV_RESULT_IN_PROGRESS
                    )
                    self.commanded(ticket.number)
                    self._streaming, self._starting = program, True
                    try:
                        offboard = ends.station.offboard(vehicle.id)
                        await offboard.start(self._request(setpoint), RATE_HZ, ticket=ticket)
                    except BaseException:
                        self._streaming = None
                        raise
                    finally:
                        self._starting = False
            ends.acknowledge(program, frame, d.MAV_RESULT_ACCEPTED)
        except GcsError as error:
            ends.refuse(program, frame, what, error)
        finally:
            if late is not None:
                late.cancel()
            program.pending.pop(START, None)
            waiting, program.after_start = list(program.after_start.values()), {}
            for execute in waiting:
                execute()

    def _fresh_setpoint(self, program: Program) -> Setpoint:
        reason = self._stale(program)
        if reason is not None or program.newest is None:
            raise Refused(
                reason or "There is no setpoint that can be flown.",
                remedy="Send setpoints first, two a second or more, then ask for Offboard.",
            )
        return program.newest[1]

    def _stale(self, program: Program) -> str | None:
        """Why Offboard cannot begin with the program's setpoints; None: it can."""
        if program.newest is None:
            return "There is no setpoint that can be flown."
        age_s = self._ends.now_s() - program.newest[0]
        return None if age_s <= FRESH_S else f"The newest setpoint is {age_s:.1f} s old."


def _moves(setpoint: Setpoint) -> bool:
    """Whether a setpoint keeps the vehicle moving for as long as it is flown. A position does not."""
    if isinstance(setpoint, Attitude | Rates | Acceleration):
        return True
    vectors = (getattr(setpoint, name, ()) for name in ("velocity_ned_m_s", "velocity_frd_m_s"))
    has_position = any(axis is not None for axis in getattr(setpoint, "position_ned_m", ()))
    turns = bool(getattr(setpoint, "yaw_rate_ned_rad_s", None))
    return turns or (not has_position and any(axis for vector in vectors for axis in vector))
