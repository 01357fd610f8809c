"""Several vehicles that fly setpoints together: `async with gcs.group({...}) as group`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from gcs_server.client.setpoints import Body

Setpoints = Mapping[str, Body]
"""Setpoint bodies (`gcs_server.client.setpoints`) by vehicle id."""


class GcsApi(Protocol):
    """The part of `Gcs` that this module uses."""

    async def request(self, method: str, path: str, body: Body | None = None) -> Any: ...


class Group:
    """A flying group.

    Args:
        gcs: the client.
        started: the server's response to the start.
        validity: validity of the setpoints, and the action on expiry.
    """

    def __init__(self, gcs: GcsApi, started: dict[str, Any], validity: Body) -> None:
        self._gcs = gcs
        self._validity = validity
        self.id: str = started["id"]
        self.started = started
        """The server's response to the start, in the form of `status`; `start_unix_s` is the time of the
        common start."""

    async def send(self, setpoints: Setpoints) -> dict[str, Any]:
        """Sends new setpoints to some or all members at the same time, and renews the setpoints of the other
        members.

        Raises:
            Invalid: a value is invalid, or a vehicle is not in the group.
            Refused: a setpoint cannot be flown, two vehicles would come too close, or the group has ended.
        """
        return await self._gcs.request(
            "POST", f"/groups/{self.id}/setpoints", {"setpoints": members_of(setpoints), **self._validity}
        )

    async def renew(self) -> dict[str, Any]:
        """Renews all setpoints for another `valid_for_s`; raises the same errors as `send`."""
        return await self.send({})

    async def status(self) -> dict[str, Any]:
        """State, members, the two closest members, findings, and the reason for the end."""
        return await self._gcs.request("GET", f"/groups/{self.id}")

    async def hold(self) -> dict[str, Any]:
        """Puts all current members into Hold; does nothing if the group has ended."""
        return await self._gcs.request("POST", f"/groups/{self.id}/hold")


def members_of(setpoints: Setpoints) -> list[Body]:
    """The members in the format of the API."""
    return [{"vehicle": vehicle, "setpoint": dict(setpoint)} for vehicle, setpoint in setpoints.items()]
