"""All vehicles, and who has joined or gone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from gcs_server.clock import Clock
from gcs_server.mavlink.router import Router
from gcs_server.supervise import Supervisor
from gcs_server.vehicle.events import Event, EventFeed
from gcs_server.vehicle.vehicle import Vehicle


@dataclass(frozen=True, slots=True)
class Notice:
    """One line of `GET /warnings`: stands until its cause has gone."""

    kind: str
    """link, recording, duplicate_id."""
    text: str
    link: str | None = None
    vehicle: str | None = None


class Fleet:
    """Sorts frames to vehicles.

    Args:
        router: whose frames to take; the fleet hooks itself in.
    """

    events: EventFeed
    """Of the whole server: vehicles and links come and gone, warnings."""

    def __init__(self, clock: Clock, supervisor: Supervisor, router: Router) -> None:
        raise NotImplementedError

    def start(self) -> None:
        """Begins the once-a-second work: heartbeat ages, identities asked for."""
        raise NotImplementedError

    def get(self, vehicle_id: str) -> Vehicle:
        """Raises UnknownVehicle."""
        raise NotImplementedError

    def all(self) -> list[Vehicle]:
        """By id."""
        raise NotImplementedError

    def subscribe(self, callback: Callable[[Event], None]) -> Callable[[], None]:
        """Events of all vehicles and of the fleet; returns what ends that."""
        raise NotImplementedError

    def on_vehicle_added(self, callback: Callable[[Vehicle], None]) -> None:
        """Calls back for each vehicle known and to come (to attach the offboard control)."""
        raise NotImplementedError

    def warnings(self) -> list[Notice]:
        """What stands now."""
        raise NotImplementedError

    async def close(self) -> None:
        """Fails everything pending with Disconnected."""
        raise NotImplementedError
