"""Receives and acknowledges COMMAND_LONG, COMMAND_INT and SET_MODE."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from vehicle_sim.autopilot.own_commands import GIMBAL_CONFIGURE, PARACHUTE, OwnCommand
from vehicle_sim.commands.command import ACCEPTED, Command, Handler, execute
from vehicle_sim.commands.flight import SET_MODE
from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import Message
from vehicle_sim.mavlink.link import Link

LOCAL_FRAMES = frozenset({1, 2, 7, 8, 9, 12, 20, 21})
"""MAV_FRAME in which x and y of COMMAND_INT are not in 1e-7 degrees."""
INT32_MAX = 0x7FFFFFFF


class CommandService:
    """Passes each command to its handler.

    Args:
        context: context of the vehicle's MAVLink services.
        commands: handlers by command number.
    """

    def __init__(self, context: Context, commands: Mapping[int, Handler]) -> None:
        self._context = context
        self._commands = commands
        self._queue: list[Callable[[], None]] = []
        """Mode changes, which run before the next tick, and commands received after a waiting mode change."""
        self.handlers = {
            "COMMAND_LONG": self.command_long,
            "COMMAND_INT": self.command_int,
            "SET_MODE": self.set_mode_message,
        }

    def command_long(self, link: Link, m: Message) -> None:
        """Handles COMMAND_LONG; a command for another target gets no reply."""
        if self._context.addresses_autopilot(m):
            self._run(
                Command(m.command, m.param1, m.param2, m.param3, m.param4, m.param5, m.param6, m.param7,
                        m.sender, link.name)
            )  # fmt: skip

    def command_int(self, link: Link, m: Message) -> None:
        """Handles COMMAND_INT; converts 1e-7 degrees to degrees. As in PX4, altitudes are AMSL in every
        frame."""
        if not self._context.addresses_autopilot(m):
            return
        scale = 1.0 if m.frame in LOCAL_FRAMES else 1e-7
        x = math.nan if m.x == INT32_MAX else m.x * scale
        y = math.nan if m.y == INT32_MAX else m.y * scale
        self._run(Command(m.command, m.param1, m.param2, m.param3, m.param4, x, y, m.z, m.sender, link.name))

    def set_mode_message(self, link: Link, m: Message) -> None:
        """Handles the deprecated SET_MODE; PX4 acknowledges it independently of the result."""
        if m.target_system != self._context.system_id:
            return
        main_mode, sub_mode = m.custom_mode >> 16 & 0xFF, m.custom_mode >> 24 & 0xFF
        command = Command(SET_MODE, float(m.base_mode), float(main_mode), float(sub_mode), 0, 0, 0, 0,
                          m.sender, link.name)  # fmt: skip
        self._context.send_ack(command, ACCEPTED)
        self._defer(lambda: self._run_unacknowledged(command))

    def _run_unacknowledged(self, command: Command) -> None:
        self._commands[SET_MODE](command)

    def _defer(self, action: Callable[[], None]) -> None:
        if not self._queue:
            self._context.call_soon(self._run_deferred)
        self._queue.append(action)

    def _run_deferred(self) -> None:
        queue, self._queue = self._queue, []
        for action in queue:
            action()

    def _run(self, command: Command) -> None:
        if command.number == SET_MODE:
            # PX4's MAVLink receiver acknowledges at once. The commander acknowledges later, with the actual
            # result.
            self._context.acknowledge(command, ACCEPTED)
            self._defer(lambda: self._execute(command))
        elif self._queue:
            self._defer(lambda: self._execute(command))
        else:
            self._execute(command)

    def _execute(self, command: Command) -> None:
        execute(self._context, self._commands, command)


REPEATS = 3
FIRST_REPEAT_S = 1.0
REPEAT_INTERVAL_S = 0.51
"""Measured interval of repetitions. PX4 sends a command four times if no component acknowledges it."""
TAKE_CONTROL = -2.0
"""param1 of DO_GIMBAL_MANAGER_CONFIGURE: the sender takes control."""
PARACHUTE_COMPONENT = 161


class OwnCommandService:
    """Sends the autopilot's commands as COMMAND_LONG: parachute commands to the parachute, others to all
    components."""

    def __init__(self, context: Context, commands: Mapping[int, Handler]) -> None:
        self._context = context
        self._commands = commands
        self._send_numbers: dict[int, int] = {}
        """Count of sends of each repeated command; a newer send ends the repetitions of the previous send."""
        context.autopilot.own_commands.add_listener(self._send)

    def _send(self, command: OwnCommand) -> None:
        parameters = list(command.parameters)
        if command.number == GIMBAL_CONFIGURE and parameters[0] == TAKE_CONTROL:
            parameters[:2] = map(float, self._context.autopilot_id)
        handler = self._commands.get(command.number)
        if handler is not None:
            p1, p2, p3, p4, p5, p6, p7 = parameters
            handler(Command(command.number, p1, p2, p3, p4, p5, p6, p7, self._context.autopilot_id, ""))
        self._broadcast(command.number, parameters, 0)
        if command.repeated:
            send_number = self._send_numbers.get(command.number, 0) + 1
            self._send_numbers[command.number] = send_number
            for repeat in range(REPEATS):
                self._context.call_later(
                    FIRST_REPEAT_S + repeat * REPEAT_INTERVAL_S,
                    lambda confirmation=repeat + 1: self._repeat(
                        command.number, parameters, confirmation, send_number
                    ),
                )

    def _repeat(self, number: int, parameters: list[float], confirmation: int, send_number: int) -> None:
        if self._send_numbers[number] == send_number:
            self._broadcast(number, parameters, confirmation)

    def _broadcast(self, number: int, parameters: list[float], confirmation: int) -> None:
        fields = {f"param{n + 1}": value for n, value in enumerate(parameters)}
        self._context.broadcast(
            "COMMAND_LONG", target_system=self._context.system_id,
            target_component=PARACHUTE_COMPONENT if number == PARACHUTE else 0, command=number,
            confirmation=confirmation, **fields,
        )  # fmt: skip
