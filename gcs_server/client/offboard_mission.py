"""A mission that the server flies by setpoints, in a program's hands."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gcs_server.client.control import Requester
from gcs_server.client.plans import Plan
from gcs_server.client.setpoints import Body


class OffboardMission:
    """The offboard mission of a vehicle: started, watched, steered. `then` of `abort`: hold, return or land.

    It goes on while the program is away; what it does when nobody has control any more stands in its
    document (`actions.control_lost`, `hold` unless given).
    """

    def __init__(self, vehicle: Requester) -> None:
        self._vehicle = vehicle

    async def state(self) -> dict[str, Any] | None:
        """How the newest one stands (as the topic `offboard_mission`); None: there has been none."""
        return (await self._vehicle.request("GET", "/offboard_mission"))["mission"]

    async def flown(self) -> dict[str, Any]:
        """The newest one as it was flown: `samples` with place and sent place, `deviation_mean_m`, …"""
        return (await self._vehicle.request("GET", "/offboard_mission/flown"))["flown"]

    async def start(
        self,
        mission: Plan | None = None,
        *,
        plan_id: str | None = None,
        version: int | None = None,
        dry_run: str | None = None,
        despite: Sequence[str] = (),
    ) -> dict[str, Any]:
        """Flies a mission's document, or one that the server keeps; arms and takes off where it says so.

        With the id of a dry run of several flights the server tells when the vehicle leaves its corridor.

        Raises:
            Refused: it has errors that `despite` does not name, or an estimate is missing.
        """
        return await self._do("start", start_body(mission, plan_id, version, despite, dry_run=dry_run))

    async def pause(self) -> dict[str, Any]:
        """Stands still on its path."""
        return await self._do("pause")

    async def resume(self) -> dict[str, Any]:
        """Goes on, from wherever the vehicle is."""
        return await self._do("resume")

    async def skip(self) -> dict[str, Any]:
        """Leaves the present step out."""
        return await self._do("skip")

    async def go_on(self) -> dict[str, Any]:
        """Answers a wait for a person."""
        return await self._do("go_on")

    async def abort(self, then: str = "hold") -> dict[str, Any]:
        """Ends it; the vehicle holds, returns or lands."""
        return await self._do("abort", {"then": then})

    async def _do(self, action: str, body: Body | None = None) -> dict[str, Any]:
        return (await self._vehicle.request("POST", f"/offboard_mission/{action}", body))["mission"]


def start_body(
    mission: Plan | None, plan_id: str | None, version: int | None, despite: Sequence[str], **more: Any
) -> dict[str, Any]:
    """As the API takes it; what is None is left out."""
    given = {"mission": mission, "plan_id": plan_id, "version": version, **more}
    return {"despite": list(despite), **{name: each for name, each in given.items() if each is not None}}
