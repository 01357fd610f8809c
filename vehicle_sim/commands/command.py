"""A command and its results as the vehicle sees them, whatever carried it (MAVLink, the console)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from vehicle_sim.autopilot.autopilot import Autopilot
from vehicle_sim.vehicle_view import VehicleView

ROS2 = "ros2"
"""`Command.link` of a VehicleCommand that came over ROS 2."""
ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED, IN_PROGRESS, CANCELLED = range(7)
"""MAV_RESULT."""


@dataclass(frozen=True, slots=True)
class Command:
    """Number and parameters; p5 and p6 are degrees also where COMMAND_INT carried 1e7 degrees."""

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


Handler = Callable[[Command], int | None]
"""Carries a command out; answers a MAV_RESULT, or None where PX4 stays silent."""


class CommandHost(Protocol):
    """What those who carry commands out are given: the vehicle, its time, and a way to answer once more."""

    autopilot: Autopilot
    view: VehicleView

    @property
    def own(self) -> tuple[int, int]:
        """(system id, component id) of the vehicle."""
        ...

    def later(self, action: Callable[[], None]) -> None:
        """Run before the next tick."""
        ...

    def after(self, seconds: float, action: Callable[[], None]) -> None:
        """Run once, this much simulated time from now."""
        ...

    def acknowledge(self, command: Command, result: int, *, progress: int = 0) -> None:
        """Answer a command; `progress` in percent, 255 where it is not known."""
        ...


def execute(host: CommandHost, handlers: Mapping[int, Handler], command: Command) -> None:
    """Carry a command out and answer it; texts about it go out after the answer."""
    handler = handlers.get(command.number)
    announcer = host.autopilot.announcer
    announcer.hold()
    result = UNSUPPORTED if handler is None else handler(command)
    if result is not None:
        host.acknowledge(command, result)
    announcer.release()
