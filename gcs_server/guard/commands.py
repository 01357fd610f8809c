"""A program's messages other than setpoints: passed to the vehicle, passed with control, or refused."""

from __future__ import annotations

import asyncio
from contextlib import ExitStack
from typing import Any, Final

from gcs_server.control.accepted import authorized_command
from gcs_server.control.commands import BY_NAME
from gcs_server.errors import GcsError, NoReply, Refused, Rejected
from gcs_server.guard import replies, table
from gcs_server.guard.ends import Ends
from gcs_server.guard.flight import START, ProgramFlight
from gcs_server.guard.program import Pending, Program
from gcs_server.guard.rates import ArrivingRates
from gcs_server.guard.table import Rule
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import Frame, decode, full_payload, payload_byte
from gcs_server.mavlink.mailbox import Waiter
from gcs_server.mavlink.tables import NAMES
from gcs_server.vehicle.px4.modes import Mode
from gcs_server.vehicle.tickets import Ticket
from gcs_server.vehicle.vehicle import Vehicle

ACK_S: Final = 3.0
PROGRESS_S: Final = 30.0
"""Wait for the vehicle's answer to a command, and for the next one after an answer *in progress* [s]."""
MAX_PENDING: Final = 20
"""Commands of a program that wait for the vehicle's answer at the same time."""
COMMANDS_OVER_ROS2: Final = (d.MAVLINK_MSG_ID_COMMAND_LONG, d.MAVLINK_MSG_ID_COMMAND_INT)
"""Messages that a vehicle which is connected over ROS 2 only gets, too."""
LINE_S: Final = 10.0
"""Period of the journal's lines about inputs that are sent many times a second [s]."""


class ProgramCommands:
    """The messages of the programs of one link.

    Args:
        ends: the link and the vehicle.
        flight: what the programs fly.
        arriving: the rates at which the vehicle's messages arrive.
    """

    def __init__(self, ends: Ends, flight: ProgramFlight, arriving: ArrivingRates) -> None:
        self._ends, self._flight, self._arriving = ends, flight, arriving

    def handle(self, program: Program, frame: Frame, vehicle: Vehicle) -> None:
        """Handles one message of a program."""
        name = NAMES.get(frame.msg_id, f"message {frame.msg_id}")
        rule = table.MESSAGES.get(name, table.NOT_PASSED) if frame.known else table.NOT_PASSED
        if frame.msg_id in COMMANDS_OVER_ROS2:
            self._command(program, frame, vehicle)
        elif frame.msg_id == d.MAVLINK_MSG_ID_SET_MODE:
            message: Any = decode(frame)
            mode_rule, mode = table.row_of_mode(message.custom_mode)
            self._execute(program, frame, vehicle, mode_rule, name, mode)
        elif rule.way == "read":
            self._read(program, frame)
        elif rule.way == "command":
            self._execute(program, frame, vehicle, rule, name, None)
        elif rule.way in ("input", "part", "sensor"):
            self._input(program, frame, vehicle, rule, name)
        elif rule.way == "refused":
            self._ends.refuse(program, frame, name, Refused(f"{name}: {rule.why}."))

    def _read(self, program: Program, frame: Frame) -> None:
        if frame.msg_id == d.MAVLINK_MSG_ID_TIMESYNC and any(full_payload(frame)[:8]):
            return  # an answer to the vehicle, which gets this server's
        opcode = payload_byte(frame, table.FTP_OPCODE_OFFSET)
        is_file = frame.msg_id == d.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL
        if is_file and opcode not in table.FTP_READING and self._ends.vehicle is not None:
            self._input(program, frame, self._ends.vehicle, table.FTP_WRITING, "FILE_TRANSFER_PROTOCOL")
        else:
            self._ends.pass_on(program, frame)

    def _command(self, program: Program, frame: Frame, vehicle: Vehicle) -> None:
        message: Any = decode(frame)
        command, params = int(message.command), replies.params_of(message)
        rule, mode = table.row_of_command(command, params)
        what = replies.name_of_command(command)
        if command == d.MAV_CMD_SET_MESSAGE_INTERVAL:
            self._set_interval(program, frame, params)
        elif rule.way == "read":
            self._ends.pass_on(program, frame)
        elif rule.way == "refused":
            self._ends.refuse(program, frame, what, Refused(f"{what}: {rule.why}."))
        else:
            self._execute(program, frame, vehicle, rule, what, mode)

    def _set_interval(self, program: Program, frame: Frame, params: tuple[float, ...]) -> None:
        msg_id, interval_us = int(params[0]), params[1]
        program.rates.ask(msg_id, interval_us)
        if self._arriving.is_slower(msg_id, interval_us) and self._ends.options.control != "read":
            self._ends.pass_on(program, frame)
        else:
            self._ends.acknowledge(program, frame, d.MAV_RESULT_ACCEPTED)

    def _execute(
        self, program: Program, frame: Frame, vehicle: Vehicle, rule: Rule, what: str, mode: Mode | None
    ) -> None:
        """Passes a command that needs what its row says; the vehicle answers it."""
        if rule.row == "offboard/start":
            self._flight.start(program, frame, vehicle, what)
            return
        payload = full_payload(frame)
        key = (frame.msg_id, payload[: replies.CONFIRMATION_OFFSET])
        if rule.row == "arm" and START in program.pending:
            # Programs ask for both at once; to PX4 they are two, here the second would interrupt the first.
            program.after_start[key] = lambda: self._execute(program, frame, vehicle, rule, what, mode)
            self._ends.acknowledge(program, frame, d.MAV_RESULT_IN_PROGRESS)
            return
        pending = program.pending.get(key)
        if pending is not None:  # sent again, as the protocol wants
            if pending.ticket is None or pending.ticket.reason is None:
                self._ends.pass_on(program, frame, pending.payload)
            return
        message: Any = decode(frame)
        stack = ExitStack()
        try:
            ticket = self._admit(stack, program, vehicle, rule.row, what, message, mode)
        except GcsError as error:
            self._ends.refuse(program, frame, what, error)
            return
        own_system = vehicle.own_ids[0]
        payload = replies.with_own_ids(payload, message, own_system, program)
        command = getattr(message, "command", None)
        if command is None:
            with stack:
                self._ends.pass_on(program, frame, payload)
            return

        def answers(reply: Any) -> bool:
            target = (reply.target_system, reply.target_component)
            return reply.command == command and target == (own_system, program.own_component)

        waiter = stack.enter_context(vehicle.mailbox.expect(d.MAVLINK_MSG_ID_COMMAND_ACK, matches=answers))
        program.pending[key] = Pending(ticket, payload)
        self._ends.pass_on(program, frame, payload)
        work = self._wait_for_answer(stack, waiter, program, key, f"Vehicle {vehicle.id}", what)
        self._ends.supervisor.spawn(f"guard {self._ends.connection.name}: {what}", work)

    def _admit(
        self,
        stack: ExitStack,
        program: Program,
        vehicle: Vehicle,
        row: str,
        what: str,
        message: Any,
        mode: Mode | None,
    ) -> Ticket | None:
        """Admits a command as one of the guard's client, and opens its ticket, if it acts.

        Raises:
            GcsError: why it may not act; it is in the journal.
        """
        principal = self._ends.principal
        refusal = self._flight.refusal_of(program, row)
        if refusal is None and len(program.pending) >= MAX_PENDING:
            refusal = Refused(f"{MAX_PENDING} commands of this program wait for the vehicle's answer.")
        accepted = stack.enter_context(
            authorized_command(
                self._ends.station,
                principal,
                row,
                vehicle.id,
                {"message": what, "from": program.source, **replies.arguments_of(message)},
                refusal=refusal,
            )
        )
        try:
            if message.get_msgId() not in COMMANDS_OVER_ROS2:
                vehicle.require("raw_messages")
            if BY_NAME[row].acts == "no":
                return None
            begin = vehicle.command.begin(
                BY_NAME[row].label or row, {"ticket": accepted.ticket, "by": principal.name}, mode
            )
            ticket = stack.enter_context(begin)
        except GcsError as error:
            stack.__exit__(type(error), error, error.__traceback__)  # so that the journal has it
            raise
        self._flight.commanded(ticket.number)
        return ticket

    async def _wait_for_answer(
        self,
        stack: ExitStack,
        waiter: Waiter,
        program: Program,
        key: tuple[int, bytes],
        vehicle: str,
        what: str,
    ) -> None:
        """Waits for the vehicle's answer, for the journal; the program has been sent it."""
        try:
            with stack:
                wait_s = ACK_S
                while True:
                    try:
                        async with asyncio.timeout(wait_s):
                            reply = await waiter.next()
                    except TimeoutError:
                        raise NoReply(f"{vehicle} did not answer {what}.", deadline_s=wait_s) from None
                    if reply.result != d.MAV_RESULT_IN_PROGRESS:
                        break
                    wait_s = PROGRESS_S
                if reply.result != d.MAV_RESULT_ACCEPTED:
                    raise Rejected(f"{vehicle} refused {what}.", mav_result=reply.result)
        except GcsError as error:
            program.refuse(self._ends.unix_s(), what, str(error))
        finally:
            program.pending.pop(key, None)

    def _input(self, program: Program, frame: Frame, vehicle: Vehicle, rule: Rule, name: str) -> None:
        """Passes a message without waiting for an answer."""
        ends = self._ends
        try:
            if rule.way == "sensor":
                if ends.options.control == "read":
                    raise Refused("This link only reads: it was opened with guard=read.")
            else:
                refusal = self._flight.refusal_of(program, rule.row)
                if refusal is not None:
                    raise refusal
                vehicle.require("raw_messages")
                ends.station.authority.admit(ends.principal, BY_NAME[rule.row], vehicle.id)
        except GcsError as error:
            ends.refuse(program, frame, name, error)
            return
        if rule.way != "part":
            self._write_line(program, rule.row or table.UNCHECKED, name, vehicle)
        ends.pass_on(program, frame)

    def _write_line(self, program: Program, row: str, name: str, vehicle: Vehicle) -> None:
        """Writes one journal line for many messages of a kind."""
        now_s = self._ends.now_s()
        last_s, count = program.inputs.get(name, (float("-inf"), 0))
        if now_s - last_s < LINE_S:
            program.inputs[name] = (last_s, count + 1)
            return
        program.inputs[name] = (now_s, 0)
        arguments: dict[str, object] = {"message": name, "from": program.source, "messages": count + 1}
        self._ends.station.journal.add(self._ends.principal.name, row, vehicle.id, arguments, "ok", None, 0.0)
