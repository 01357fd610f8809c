"""How many vehicles there may be, and who makes room for another.

Whoever can send datagrams can claim any system id from any port. So vehicles are bounded in number, and one
more is refused where there is no room: those that are known stay. Room is made by vehicles that have never
answered a request of ours and have long been silent, which no vehicle does that anybody flies.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gcs_server.vehicle.endpoint import Endpoint
    from gcs_server.vehicle.vehicle import Vehicle

MAX_VEHICLES = 200
MAX_ON_LINK = 120
MAX_OF_ONE_ID = 6
"""Vehicles that claim one system id; two are a mistake already."""
MAX_ENDPOINTS_ON_LINK = 400
"""(peer, system id); those without a vehicle included."""
TRY_AGAIN_S = 5.0
"""A refused endpoint is looked at again so seldom."""
FORGETTABLE_AFTER_S = 60.0
TOLD_FOR_S = 60.0
"""A refusal stands in the warnings for so long."""


def no_room(endpoint: Endpoint, vehicles: list[Vehicle]) -> tuple[str, list[Vehicle]] | None:
    """Why another vehicle cannot be added, and who stands in its way; None where it can.

    Args:
        endpoint: where the newcomer is heard.
        vehicles: all there are.
    """
    system_id, replayed = endpoint.system_id, endpoint.connection.link.replay
    alike = [v for v in vehicles if v.identity.system_id == system_id and v.identity.replayed == replayed]
    if len(alike) >= MAX_OF_ONE_ID:
        return f"{len(alike)} vehicles claim system id {system_id} already", alike
    on_link = [v for v in vehicles if any(e.connection is endpoint.connection for e in v.endpoints)]
    if len(on_link) >= MAX_ON_LINK:
        return f"{len(on_link)} vehicles are heard on this link already", on_link
    if len(vehicles) >= MAX_VEHICLES:
        return f"the server knows {len(vehicles)} vehicles already", vehicles
    return None


def forgettable(vehicles: Iterable[Vehicle], now_s: float) -> Vehicle | None:
    """The longest silent of those that may make room; None where none may."""
    silent = [
        v
        for v in vehicles
        if not v.identity.replayed
        and v.identity.firmware is None  # it never answered
        and not v.facts.armed
        and now_s - last_heard_s(v) > FORGETTABLE_AFTER_S
        and not v.in_use
    ]
    return min(silent, key=last_heard_s, default=None)


def last_heard_s(vehicle: Vehicle) -> float:
    """When anything was last heard of it [s, monotonic]."""
    return max((e.heard_s for e in vehicle.endpoints), default=vehicle.facts.heartbeat_s)


class Refusals:
    """Vehicles for which there was no room, told once a link."""

    def __init__(self) -> None:
        self._last: dict[str, tuple[float, str]] = {}

    def refuse(self, endpoint: Endpoint, why: str, now_s: float) -> str | None:
        """Notes it; the sentence to tell, unless this link's was told lately."""
        endpoint.refused_until_s = now_s + TRY_AGAIN_S
        link = endpoint.connection.name
        told = now_s - self._last.get(link, (float("-inf"), ""))[0] <= TOLD_FOR_S
        text = (
            f"Link {link}: a vehicle with system id {endpoint.system_id} is not shown: {why}. Remove those "
            "that are silent. If somebody sends heartbeats of vehicles that do not exist, close the link."
        )
        self._last[link] = (now_s, text)
        return None if told else text

    def standing(self, now_s: float) -> list[tuple[str, str]]:
        """(link, sentence) of the last minute."""
        self._last = {link: said for link, said in self._last.items() if now_s - said[0] <= TOLD_FOR_S}
        return [(link, text) for link, (_, text) in self._last.items()]
