"""Requests for control of a vehicle, and their limits."""

from __future__ import annotations

from dataclasses import dataclass

from gcs_server.control.principal import Principal
from gcs_server.errors import Refused

MAX_REQUESTS = 20
"""Maximum number of clients that request control of one vehicle."""
MAX_REQUESTS_PER_ADDRESS = 10
REQUEST_LIFETIME_S = 120.0
"""Lifetime of a request, and of the right to take control by force after a denial [s]."""


@dataclass(slots=True)
class PendingRequest:
    """A client's request for control of a vehicle."""

    client: Principal
    reason: str | None
    since_unix_s: float
    holder_asked_s: float
    """Time when the current holder was asked [s, monotonic]."""
    lifetime_start_s: float
    """Start of the request's lifetime: its arrival, or its denial."""
    denied: bool = False


def remove_oldest_denied(pending: dict[str, PendingRequest], client: Principal, vehicle_id: str) -> None:
    """Removes the oldest denied request if a limit of requests is reached.

    Raises:
        Refused: a limit is reached, and no request is denied.
    """
    from_address = [request for request in pending.values() if request.client.address == client.address]
    if client.address and len(from_address) >= MAX_REQUESTS_PER_ADDRESS:
        counted, location_text = from_address, " at your address"
    elif len(pending) >= MAX_REQUESTS:
        counted, location_text = list(pending.values()), ""
    else:
        return
    denied = next((request for request in counted if request.denied), None)
    if denied is None:
        raise Refused(
            f"{len(counted)} clients{location_text} already request control of vehicle {vehicle_id}.",
            remedy="Wait until the client in control has answered some of them (control/grant, "
            f"control/deny); a request expires after {REQUEST_LIFETIME_S:g} s. Hold, Land now and Stop "
            "motors need no control.",
        )
    del pending[denied.client.key]
