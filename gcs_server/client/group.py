"""Several vehicles that fly setpoints together: `async with gcs.group({...}) as group`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from gcs_server.client.setpoints import Body

Setpoints = Mapping[str, Body]
"""By vehicle's id, each a body of `gcs_server.client.setpoints`."""


class Requester(Protocol):
    """The part of the client that is needed here."""

    async def request(self, method: str, path: str, body: Body | None = None) -> Any: ...


class Group:
    """A group that flies.

    Args:
        gcs: the client.
        started: what the server answered to its start.
        life: how long setpoints count, and what follows.
    """

    def __init__(self, gcs: Requester, started: dict[str, Any], life: Body) -> None:
        self._gcs = gcs
        self._life = life
        self.id: str = started["id"]
        self.started = started
        """As `status`; `start_unix_s` is the common start."""

    async def send(self, setpoints: Setpoints) -> dict[str, Any]:
        """New setpoints for some members or all, sent at one instant; those of the others are renewed.

        Raises:
            Invalid: a value is not acceptable, or a vehicle is not in the group.
            Refused: one cannot be flown, two would come too near, or the group has ended.
        """
        return await self._gcs.request(
            "POST", f"/groups/{self.id}/setpoints", {"setpoints": members_of(setpoints), **self._life}
        )

    async def renew(self) -> dict[str, Any]:
        """Renews all setpoints for another `valid_for_s`; raises as `send`."""
        return await self.send({})

    async def status(self) -> dict[str, Any]:
        """State, members, the two that are nearest, findings, why it ended."""
        return await self._gcs.request("GET", f"/groups/{self.id}")

    async def hold(self) -> dict[str, Any]:
        """Puts all members that still fly it into Hold; nothing happens where it has ended."""
        return await self._gcs.request("POST", f"/groups/{self.id}/hold")


def members_of(setpoints: Setpoints) -> list[Body]:
    """As the API takes them."""
    return [{"vehicle": vehicle, "setpoint": dict(setpoint)} for vehicle, setpoint in setpoints.items()]
