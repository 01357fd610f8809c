"""Missions of a vehicle: upload, download, compare, start."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gcs_server.client.control import VehicleApi
from gcs_server.client.operations import Operations
from gcs_server.client.plans import Plan
from gcs_server.client.setpoints import Body

TRANSFER_TIMEOUT_S = 600.0
"""Maximum wait [s]; a thousand items take a few minutes on a link that loses every third packet."""


class Mission:
    """The mission, geofence and rally points of a vehicle."""

    def __init__(self, vehicle: VehicleApi, operations: Operations) -> None:
        self._vehicle = vehicle
        self._operations = operations

    async def state(self) -> dict[str, Any]:
        """Progress of the vehicle's mission, the plan on the vehicle (`holds`), and where an interrupted
        flight can be resumed (`resume`)."""
        return await self._vehicle.request("GET", "/mission")

    async def upload(
        self,
        plan: Plan | None = None,
        *,
        plan_id: str | None = None,
        version: int | None = None,
        hold_first: bool = False,
        despite: Sequence[str] = (),
        timeout_s: float = TRANSFER_TIMEOUT_S,
    ) -> dict[str, Any]:
        """Uploads a plan (a document, or one stored on the server), verifies it, and returns the result.

        A vehicle in Mission mode flies to the first item of a changed mission at once: either `hold_first`
        puts it into Hold before, or `despite` names `flies_new_plan_at_once`.

        Raises:
            Refused: the vehicle refuses an item, or has different items afterwards; the text names the items.
        """
        options = {"hold_first": hold_first, "despite": list(despite)}
        body = {**_chosen_plan(plan, plan_id, version), **options}
        operation = await self._vehicle.request("POST", "/mission/upload", body)
        return (await self._operations.wait(operation["id"], timeout_s=timeout_s))["result"]

    async def download(self, *, timeout_s: float = TRANSFER_TIMEOUT_S) -> dict[str, Any]:
        """Reads the vehicle's items; returns the same result as `plan()`."""
        operation = await self._vehicle.request("POST", "/mission/download")
        await self._operations.wait(operation["id"], timeout_s=timeout_s)
        return await self.plan()

    async def plan(self) -> dict[str, Any]:
        """The last downloaded or verified plan: `plan`, `read_unix_s`, `still_held` (by the vehicle)."""
        return await self._vehicle.request("GET", "/mission/plan")

    async def compare(
        self, plan: Plan | None = None, *, plan_id: str | None = None, version: int | None = None
    ) -> dict[str, Any]:
        """Compares a plan with the last downloaded one: whether it is `equal`, and the `differences`."""
        return await self._vehicle.request("POST", "/mission/compare", _chosen_plan(plan, plan_id, version))

    async def clear(self) -> None:
        """Clears mission, geofence and rally points on the vehicle; refused while the vehicle is in Mission
        mode."""
        await self._vehicle.request("DELETE", "/mission")

    async def start(
        self,
        item: int | None = None,
        *,
        despite: Sequence[str] = (),
        dry_run: str | None = None,
        mission_id: int | None = None,
    ) -> None:
        """Starts the mission at an item (counted from 0) or at the current item; arms the vehicle if needed.

        `dry_run` is the id of a dry run of the plan on the vehicle; the server compares the two flights.
        To resume an interrupted flight, give `item` and `mission_id` of `state()["resume"]`.

        Raises:
            Refused: the plan is unknown or has errors, and `despite` does not list the codes; the dry run
                was made for another plan or position; or the vehicle has another mission than `mission_id`.
        """
        options = {"item": item, "dry_run": dry_run, "mission_id": mission_id}
        body: Body = {"despite": list(despite), **{k: v for k, v in options.items() if v is not None}}
        await self._vehicle.request("POST", "/mission/start", body)

    async def flown(self) -> dict[str, Any]:
        """The newest flight of a plan, compared with the plan: `samples`, `planned_legs`,
        `deviation_max_m`."""
        return (await self._vehicle.request("GET", "/mission/flown"))["flown"]

    async def resume(self) -> None:
        """Resumes the mission in flight at the current item; `vehicle.hold()` pauses a mission. After a
        landing, use `start`."""
        await self._vehicle.request("POST", "/mission/resume")


def _chosen_plan(plan: Plan | None, plan_id: str | None, version: int | None) -> Body:
    options = {"plan": None if plan is None else dict(plan), "plan_id": plan_id, "version": version}
    return {name: value for name, value in options.items() if value is not None}
