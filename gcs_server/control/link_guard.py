"""Decides who may close a link to a flying vehicle, and who may add a link to another ground station.

Closing a link disconnects a vehicle from its pilot. A link to another ground station (`forward=1`) lets that
station command without control. Both require control.
"""

from __future__ import annotations

from collections.abc import Iterable

from gcs_server.control.authority import Authority
from gcs_server.control.commands import BY_NAME
from gcs_server.control.principal import Principal
from gcs_server.errors import Refused
from gcs_server.mavlink.router import Router
from gcs_server.vehicle.endpoint import NO_DATA_AFTER_S
from gcs_server.vehicle.fleet import Fleet
from gcs_server.vehicle.vehicle import Vehicle

ADD_COMMAND, CLOSE_COMMAND = "links/add", "links/remove"
"""Names of the two commands in `commands.py`."""


class LinkGuard:
    """Checks before a link is closed or added.

    Args:
        router: the links.
        fleet: the vehicles that are connected over the links.
        authority: control of the vehicles.
    """

    def __init__(self, router: Router, fleet: Fleet, authority: Authority) -> None:
        self._router = router
        self._fleet = fleet
        self._authority = authority

    def check_close(self, name: str, principal: Principal, confirm: str | None) -> None:
        """Checks before a link is closed.

        Args:
            name: name of the link.
            principal: the caller.
            confirm: confirmation text, if a flying vehicle would lose its last link.

        Raises:
            UnknownLink: no link has this name.
            NotInControl: another client controls a vehicle that is connected over this link.
            Refused: a flying vehicle would lose its last link, and the confirmation is missing.
        """
        link = self._router.connection(name).link
        if link.replay:
            return
        if link.forward:
            self._require_control(principal, CLOSE_COMMAND, [v for v in self._live_vehicles() if is_flown(v)])
            return
        vehicles_on_link = [v for v in self._live_vehicles() if name in v.known_links]
        self._require_control(principal, CLOSE_COMMAND, vehicles_on_link)
        losing_last_link = [
            v.id for v in vehicles_on_link if is_flown(v) and not self._has_other_link(v, name)
        ]
        if losing_last_link and confirm != (expected := closing_confirmation(name, losing_last_link)):
            is_plural = len(losing_last_link) > 1
            raise Refused(
                f"Vehicle{'s' if is_plural else ''} {', '.join(losing_last_link)} "
                f"{'are' if is_plural else 'is'} armed or flown by setpoints, and link {name!r} is "
                f"{'their' if is_plural else 'its'} last link. The link stays open.",
                remedy=f"To close it anyway, send confirm={expected!r}.",
            )

    def check_forwarding(self, principal: Principal) -> None:
        """Checks before a link to another ground station is added.

        Raises:
            NotInControl: another client controls a vehicle that the other station could command.
        """
        self._require_control(principal, ADD_COMMAND, self._live_vehicles())

    def _live_vehicles(self) -> list[Vehicle]:
        return [v for v in self._fleet.all() if not v.identity.replayed]

    def _require_control(self, principal: Principal, command: str, vehicles: Iterable[Vehicle]) -> None:
        refusal = self._authority.refusal(principal, command, [v.id for v in vehicles])
        if refusal is not None:
            raise refusal

    def _has_other_link(self, vehicle: Vehicle, name: str) -> bool:
        now_s = vehicle.clock.monotonic_s()
        return any(
            endpoint.connection.name != name and now_s - endpoint.received_s <= NO_DATA_AFTER_S
            for endpoint in vehicle.endpoints
        )


def is_flown(vehicle: Vehicle) -> bool:
    """Whether the vehicle is armed or has a setpoint stream, as far as the server knows."""
    return vehicle.status.armed or vehicle.streaming


def closing_confirmation(name: str, vehicle_ids: list[str]) -> str:
    """Confirmation text for closing a flying vehicle's last link."""
    return BY_NAME[CLOSE_COMMAND].confirmation_text(link=name, vehicles=" and ".join(vehicle_ids))
