"""Who asks for control of a vehicle, and how many may ask at a time."""

from __future__ import annotations

from dataclasses import dataclass

from gcs_server.control.principal import Principal
from gcs_server.errors import Refused

MOST_REQUESTS = 20
"""Clients that may ask for control of one vehicle at a time."""
MOST_REQUESTS_BY_ADDRESS = 10
REQUEST_LIVES_S = 120.0
"""A request, or the right to force that a denial gives, is forgotten after this [s]."""


@dataclass(slots=True)
class Asking:
    """One client that asks."""

    client: Principal
    reason: str | None
    since_unix_s: float
    asked_s: float
    """When the present holder was asked."""
    first_s: float
    denied: bool = False


def make_room(asking: dict[str, Asking], client: Principal, vehicle_id: str) -> None:
    """Forgets the oldest request that was denied, where there are too many for one more.

    Raises:
        Refused: as many as possible wait for an answer.
    """
    same = [a for a in asking.values() if a.client.address == client.address]
    if client.address and len(same) >= MOST_REQUESTS_BY_ADDRESS:
        crowd, where = same, " at your address"
    elif len(asking) >= MOST_REQUESTS:
        crowd, where = list(asking.values()), ""
    else:
        return
    denied = next((a for a in crowd if a.denied), None)
    if denied is None:
        raise Refused(
            f"{len(crowd)} clients{where} ask for control of vehicle {vehicle_id} already.",
            remedy="Wait until the holder has answered some (control/grant, control/deny); a request is "
            f"forgotten after {REQUEST_LIVES_S:g} s. Hold, Land now and Kill need no control.",
        )
    del asking[denied.client.key]
