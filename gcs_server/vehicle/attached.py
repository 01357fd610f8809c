"""Interfaces of the objects that `streamer/` and `control/` attach to each vehicle.

Code that needs more uses those packages: `Streamer.offboard`, `Authority.control`.
"""

from __future__ import annotations

from typing import Protocol


class StreamStatus(Protocol):
    """State of the setpoint stream to a vehicle."""

    @property
    def streaming(self) -> bool:
        """Whether setpoints go out to the vehicle now."""
        ...


class AttachedStream(Protocol):
    """A vehicle's `offboard`."""

    def status(self) -> StreamStatus:
        """Now."""
        ...

    def asks_for(self) -> str | None:
        """The mode that an ending stream asks the vehicle for just now; None while it asks for none."""
        ...


class AttachedMission(Protocol):
    """A vehicle's `offboard_mission`."""

    def status(self) -> object | None:
        """Now; None before its first mission."""
        ...


class HolderStatus(Protocol):
    """State of control of a vehicle."""

    @property
    def holder(self) -> str | None:
        """None: nobody has control."""
        ...

    @property
    def holder_key(self) -> str | None:
        """Tells clients of one name apart."""
        ...


class AttachedControl(Protocol):
    """A vehicle's `control`."""

    def status(self) -> HolderStatus:
        """Now."""
        ...
