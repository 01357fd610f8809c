"""Sends the autopilot's commands to the vehicle's components, and executes the gimbal commands."""

from __future__ import annotations

from collections.abc import Mapping

from vehicle_sim.autopilot.own_commands import GIMBAL_CONFIGURE, PARACHUTE, OwnCommand
from vehicle_sim.commands.command import Command, Handler
from vehicle_sim.mavlink.context import Context

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
