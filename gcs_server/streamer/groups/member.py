"""The interface to a vehicle's setpoint stream that groups use; implemented by `offboard/control.py`."""

from __future__ import annotations

from typing import Protocol

from gcs_server.streamer.values.snapshot import Snapshot
from gcs_server.streamer.values.stream_request import StreamRequest
from gcs_server.vehicle.tickets import Ticket
from gcs_server.vehicle.vehicle import Vehicle


class Member(Protocol):
    """One vehicle of a group, and its stream."""

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle of the stream."""
        ...

    def check(self, request: StreamRequest) -> object:
        """Raises Refused if the setpoint cannot be flown now, InvalidRequest if it can never be flown."""
        ...

    def snapshot(self, request: StreamRequest | None = None) -> Snapshot:
        """Snapshot of the vehicle for its stream, or for a new request that is not accepted yet."""
        ...

    async def start(
        self, request: StreamRequest, rate_hz: float, select: None = None, ticket: Ticket | None = None
    ) -> object:
        """Starts the stream; returns once the vehicle is in Offboard. Raises GcsError if it does not
        switch."""
        ...

    async def stop(self, ticket: Ticket | None = None) -> object:
        """Puts the vehicle into Hold; raises GcsError if it does not confirm."""
        ...
