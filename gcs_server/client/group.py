"""Several vehicles that fly setpoints together: `async with gcs.group({...}) as group`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from gcs_server.client.setpoints import Body

Setpoints = Mapping[str, Body]
"""Setpoint bodies (`gcs_server.client.setpoints`) by vehicle id."""


class Requester(Protocol):
    """The part of the client that is needed here."""

    async def request(self, method: str, path: str, body: Body | None = None) -> Any: ...


class Group:
    """A flying group.

    Args:
        gcs: the client.
        started: the server's answer to the start.
        life: validity of setpoints, and the action on expiry.
    """

    def __init__(self, gcs: Requester, started: dict[str, Any], life: Body) -> None:
        self._gcs = gcs
        self._life = life
        self.id: str = started["id"]
        self.started = started
        """As `status`; `start_unix_s` is the common start."""

    async def send(self, setpoints: Setpoints) -> dict[str, Any]:
        """New setpoints for some or all members, sent at the same instant; the others' setpoints are renewed.

        Raises:
            Invalid: a value is invalid, or a vehicle is not in the group.
            Refused: a setpoint cannot be flown, two vehicles would come too near, or the group has ended.
        """
        return await self._gcs.request(
            "POST", f"/groups/{self.id}/setpoints", {"setpoints": members_of(setpoints), **self._life}
        )

    async def renew(self) -> dict[str, Any]:
        """Renews all setpoints for another `valid_for_s`; raises as `send`."""
        return await self.send({})

    async def status(self) -> dict[str, Any]:
        """State, members, the two nearest members, findings, and why it ended."""
        return await self._gcs.request("GET", f"/groups/{self.id}")

    async def hold(self) -> dict[str, Any]:
        """Puts all members that still follow the group into Hold; does nothing if it has ended."""
        return await self._gcs.request("POST", f"/groups/{self.id}/hold")


def members_of(setpoints: Setpoints) -> list[Body]:
    """The members as in the API."""
    return [{"vehicle": vehicle, "setpoint": dict(setpoint)} for vehicle, setpoint in setpoints.items()]
