"""Limits the number of vehicles, and selects a vehicle to remove for a new one. Any sender of datagrams can
claim any system id from any port, so the number of vehicles is limited. At the limit, a new vehicle is
refused, unless a known vehicle can be removed: one that has never answered a request, has sent nothing for a
long time and is not in use.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gcs_server.vehicle.endpoint import Endpoint
    from gcs_server.vehicle.vehicle import Vehicle

MAX_VEHICLES = 200
MAX_VEHICLES_ON_LINK = 120
MAX_WITH_SAME_ID = 6
"""Maximum number of vehicles with the same system id; even two are a configuration error."""
MAX_ENDPOINTS_ON_LINK = 400
"""Maximum number of endpoints (peer, system id), including those without a vehicle."""
TRY_AGAIN_S = 5.0
"""Time after which a refused endpoint is tried again [s]."""
REMOVABLE_AFTER_S = 60.0
WARNED_FOR_S = 60.0
"""Time for which a refusal is shown in the warnings [s]."""


def limit_reached(endpoint: Endpoint, vehicles: list[Vehicle]) -> tuple[str, list[Vehicle]] | None:
    """Why another vehicle cannot be added, and the vehicles that count towards the limit; None if it can be
    added.

    Args:
        endpoint: endpoint of the new vehicle.
        vehicles: all vehicles.
    """
    system_id, replayed = endpoint.system_id, endpoint.connection.link.replay
    same_id = [v for v in vehicles if v.identity.system_id == system_id and v.identity.replayed == replayed]
    if len(same_id) >= MAX_WITH_SAME_ID:
        return f"{len(same_id)} vehicles already use system id {system_id}", same_id
    on_link = [v for v in vehicles if any(e.connection is endpoint.connection for e in v.endpoints)]
    if len(on_link) >= MAX_VEHICLES_ON_LINK:
        return f"{len(on_link)} vehicles are already connected on this link", on_link
    if len(vehicles) >= MAX_VEHICLES:
        return f"the server already has {len(vehicles)} vehicles", vehicles
    return None


def removable_vehicle(vehicles: Iterable[Vehicle], now_s: float) -> Vehicle | None:
    """The vehicle that may be removed and has sent nothing for the longest time; None: no such vehicle."""
    inactive = [
        v
        for v in vehicles
        if not v.identity.replayed
        and v.identity.firmware is None  # the vehicle has never answered
        and not v.flight_state.armed
        and now_s - last_received_s(v) > REMOVABLE_AFTER_S
        and not v.in_use
    ]
    return min(inactive, key=last_received_s, default=None)


def last_received_s(vehicle: Vehicle) -> float:
    """Time of the vehicle's last message [s, monotonic]."""
    return max((e.received_s for e in vehicle.endpoints), default=vehicle.flight_state.heartbeat_s)


class Refusals:
    """Refused vehicles; a link is reported again only after `WARNED_FOR_S`."""

    def __init__(self) -> None:
        self._last: dict[str, tuple[float, str]] = {}

    def refuse(self, endpoint: Endpoint, why: str, now_s: float) -> str | None:
        """Records a refusal; returns the sentence to report, or None if this link was reported recently."""
        endpoint.refused_until_s = now_s + TRY_AGAIN_S
        link = endpoint.connection.name
        recently_reported = now_s - self._last.get(link, (float("-inf"), ""))[0] <= WARNED_FOR_S
        text = (
            f"Link {link}: a vehicle with system id {endpoint.system_id} is not shown: {why}. "
            "Remove vehicles that are no longer connected. If a program sends heartbeats of vehicles that do "
            "not exist, close the link."
        )
        self._last[link] = (now_s, text)
        return None if recently_reported else text

    def recent(self, now_s: float) -> list[tuple[str, str]]:
        """(link, sentence) of recent refusals."""
        self._last = {
            link: refusal for link, refusal in self._last.items() if now_s - refusal[0] <= WARNED_FOR_S
        }
        return [(link, text) for link, (_, text) in self._last.items()]
