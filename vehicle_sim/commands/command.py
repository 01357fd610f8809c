"""A command and its results, independent of the transport (MAVLink, ROS 2, console)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from vehicle_sim.autopilot.autopilot import Autopilot
from vehicle_sim.vehicle_view import VehicleView

ROS2 = "ros2"
"""`Command.link` of a VehicleCommand received over ROS 2."""
ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED, IN_PROGRESS, CANCELLED = range(7)
"""MAV_RESULT."""


@dataclass(frozen=True, slots=True)
class Command:
    """A command; p5 and p6 are in degrees, even if it was received as a COMMAND_INT."""

    number: int
    p1: float
    p2: float
    p3: float
    p4: float
    p5: float
    p6: float
    p7: float
    sender: tuple[int, int]
    link: str
    """Name of the MAVLink connection, or `ROS2`."""
    external: bool = True
    """`VehicleCommand.from_external`: whether the command comes from outside the autopilot."""


Handler = Callable[[Command], int | None]
"""Executes a command; returns a MAV_RESULT, or None if PX4 sends no acknowledgement."""


class CommandHost(Protocol):
    """What a command handler needs from its vehicle."""

    autopilot: Autopilot
    view: VehicleView

    @property
    def autopilot_id(self) -> tuple[int, int]:
        """(system id, component id) of the vehicle's autopilot."""
        ...

    def call_soon(self, action: Callable[[], None]) -> None:
        """Runs an action before the next tick."""
        ...

    def call_later(self, seconds: float, action: Callable[[], None]) -> None:
        """Runs an action once, after `seconds` of simulated time."""
        ...

    def acknowledge(self, command: Command, result: int, *, progress: int = 0) -> None:
        """Acknowledges a command; `progress` in percent, 255: unknown."""
        ...


def execute(host: CommandHost, handlers: Mapping[int, Handler], command: Command) -> None:
    """Executes and acknowledges a command; status texts of the handler follow the acknowledgement."""
    handler = handlers.get(command.number)
    announcer = host.autopilot.announcer
    announcer.pause()
    result = UNSUPPORTED if handler is None else handler(command)
    if result is not None:
        host.acknowledge(command, result)
    announcer.resume()
