"""Interfaces of the objects that `streamer/` and `control/` attach to each vehicle.

They have only the members that `vehicle/` needs. Other code uses `Streamer.offboard` and `Authority.control`.
"""

from __future__ import annotations

from typing import Protocol


class StreamStatus(Protocol):
    """State of the setpoint stream to a vehicle."""

    @property
    def streaming(self) -> bool:
        """Whether setpoints are being sent to the vehicle."""
        ...


class AttachedStream(Protocol):
    """A vehicle's `offboard`."""

    def status(self) -> StreamStatus:
        """The current state."""
        ...

    def requested_mode(self) -> str | None:
        """The mode that the stream requests from the vehicle before it ends; None: no mode request."""
        ...


class AttachedMission(Protocol):
    """A vehicle's `offboard_mission`."""

    def status(self) -> object | None:
        """Status of the newest mission; None before the first mission."""
        ...

    @property
    def active(self) -> bool:
        """Whether the newest mission has not ended."""
        ...

    @property
    def flown_by_pilot(self) -> bool:
        """Whether the RC pilot or another ground station started the mission that is flown now."""
        ...


class AttachedFlight(Protocol):
    """A vehicle's `waypoint_flight`."""

    def status(self) -> object | None:
        """Status of the newest flight of a waypoint plan; None before the first flight."""
        ...


class HolderStatus(Protocol):
    """Which client controls a vehicle."""

    @property
    def holder(self) -> str | None:
        """Name of the client in control; None: no client has control."""
        ...

    @property
    def holder_key(self) -> str | None:
        """Distinguishes clients with the same name."""
        ...


class AttachedControl(Protocol):
    """A vehicle's `control`."""

    def status(self) -> HolderStatus:
        """The current state."""
        ...
