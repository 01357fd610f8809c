"""A vehicle's setpoint stream as its group uses it; `offboard/control.py` is one."""

from __future__ import annotations

from typing import Protocol

from gcs_server.streamer.values.order import Order
from gcs_server.streamer.values.snapshot import Snapshot
from gcs_server.vehicle.vehicle import Vehicle


class Member(Protocol):
    """One vehicle of a group, and its stream."""

    @property
    def vehicle(self) -> Vehicle:
        """Whose stream it is."""
        ...

    def check(self, order: Order) -> None:
        """Raises Refused where the order cannot be flown now, InvalidRequest where it never can."""
        ...

    def snapshot(self, order: Order | None = None) -> Snapshot:
        """The vehicle as its stream is to know it (for an order that is about to be taken)."""
        ...

    async def start(self, order: Order, rate_hz: float) -> object:
        """Returns once the vehicle flies Offboard; raises GcsError where it does not."""
        ...

    async def stop(self) -> object:
        """Puts the vehicle into Hold; raises GcsError where it does not confirm it."""
        ...
