"""The server's operations, plans (versions, checks, import and export of files) and dry runs."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Mapping, Sequence
from typing import Any, Protocol
from urllib.parse import quote, urlencode

from gcs_server.client.errors import Timeout, raise_problem
from gcs_server.client.setpoints import Body

POLL_S = 0.25


class GcsApi(Protocol):
    """The part of `Gcs` that this module uses."""

    async def request(self, method: str, path: str, body: Body | None = None) -> Any: ...
    async def raw(
        self, method: str, path: str, *, body: Body | None = None, content: bytes | None = None
    ) -> bytes: ...


class Operations:
    """The server's operations, running or recently ended, each in the form of `GET /operations/{o}`."""

    def __init__(self, gcs: GcsApi) -> None:
        self._gcs = gcs

    async def all(self, vehicle_id: str | None = None) -> list[dict[str, Any]]:
        """The operations of one vehicle, or all; oldest first."""
        operations = (await self._gcs.request("GET", "/operations"))["operations"]
        return [operation for operation in operations if vehicle_id in (None, operation["vehicle"])]

    async def get(self, operation_id: str) -> dict[str, Any]:
        """One operation: `state`, `progress`, `text`, and at the end `result` or `error`."""
        return await self._gcs.request("GET", f"/operations/{operation_id}")

    async def wait(self, operation_id: str, *, timeout_s: float = 60.0) -> dict[str, Any]:
        """Waits for the end and returns the operation; its `state` is `succeeded` or `cancelled`.

        Raises:
            ApiError: the operation failed; the error contains the reason.
            Timeout: the operation is still running, and continues without this program.
        """
        loop = asyncio.get_running_loop()
        end_s = loop.time() + timeout_s
        while (operation := await self.get(operation_id))["state"] == "running":
            if loop.time() > end_s:
                raise Timeout(
                    f"Operation {operation_id} is still running after {timeout_s:g} s: {operation['text']}"
                )
            await asyncio.sleep(POLL_S)
        if operation["error"] is not None:
            raise_problem(operation["error"])
        return operation

    async def cancel(self, operation_id: str) -> dict[str, Any]:
        """Cancels an operation and returns its final state; an ended operation is not changed."""
        return await self._gcs.request("DELETE", f"/operations/{operation_id}")


Plan = Mapping[str, Any]
"""The document of a waypoint plan or of an offboard mission (docs/missions.md)."""


class Plans:
    """The plans of the server, each in the form of `GET /plans/{plan}`: `id`, `version`, `plan`, …"""

    def __init__(self, gcs: GcsApi) -> None:
        self._gcs = gcs

    async def all(self) -> list[dict[str, Any]]:
        """The newest version of each plan, by name, without the documents."""
        return (await self._gcs.request("GET", "/plans"))["plans"]

    async def get(self, plan_id: str, version: int | None = None) -> dict[str, Any]:
        """A plan with its document; default: the newest version."""
        query = "" if version is None else f"?version={version}"
        return await self._gcs.request("GET", f"/plans/{quote(plan_id, safe='')}{query}")

    async def versions(self, plan_id: str) -> list[dict[str, Any]]:
        """The stored versions of a plan, newest first."""
        return (await self._gcs.request("GET", f"/plans/{quote(plan_id, safe='')}/versions"))["versions"]

    async def create(self, name: str, plan: Plan) -> dict[str, Any]:
        """Stores a new plan."""
        return await self._gcs.request("POST", "/plans", {"name": name, "plan": dict(plan)})

    async def save(self, plan_id: str, name: str, plan: Plan, *, base_version: int) -> dict[str, Any]:
        """Adds a version, based on `base_version`.

        Raises:
            Refused: another client has saved a newer version (`conflict`); nothing is overwritten.
        """
        body: Body = {"name": name, "plan": dict(plan), "base_version": base_version}
        return await self._gcs.request("PUT", f"/plans/{quote(plan_id, safe='')}", body)

    async def delete(self, plan_id: str, *, base_version: int) -> None:
        """Deletes a plan with all its versions; raises the same errors as `save`."""
        path = f"/plans/{quote(plan_id, safe='')}?base_version={base_version}"
        await self._gcs.request("DELETE", path)

    async def check(
        self, plan: Plan, *, vehicle_id: str | None = None, power: Mapping[str, float] | None = None
    ) -> dict[str, Any]:
        """Checks a plan: `findings` and `estimates`, and for an offboard mission `flight` with its path and
        the duration of each step.

        With `vehicle_id`, the vehicle's parameters and home are used if they are known. With `power`
        (`hover_power_w`, `battery_wh`, `mass_kg`), the energy is checked as well.
        """
        body: dict[str, Any] = {"plan": dict(plan)}
        if vehicle_id is not None:
            body["vehicle"] = vehicle_id
        if power is not None:
            body["power"] = dict(power)
        return await self._gcs.request("POST", "/plans/check", body)

    async def convert(self, plan: Plan, name: str, *, vehicle_id: str | None = None) -> dict[str, Any]:
        """Converts a waypoint plan to an offboard mission: `plan` and `notes`. Saves nothing."""
        body: dict[str, Any] = {"plan": dict(plan), "name": name}
        if vehicle_id is not None:
            body["vehicle"] = vehicle_id
        return await self._gcs.request("POST", "/plans/convert", body)

    async def insert(
        self,
        plan: Plan,
        at: Sequence[str | int],
        *,
        plan_id: str | None = None,
        version: int | None = None,
        mission: Plan | None = None,
        in_air: bool = False,
        positions: str | None = None,
    ) -> dict[str, Any]:
        """Inserts a stored offboard mission (`plan_id`) or the document `mission` into the offboard mission
        `plan`. Returns the result as `plan`, the name of the `called` list, and `notes`; saves nothing.

        `at` is the place of the new call step, such as `["steps", 2]`. With `in_air`, the inserted take-off
        and last landing are left out. If the planned starts differ, `positions` states whether positions
        relative to start or home refer to the start of `plan` ("from_start"), or are converted so that they
        stay at the same places ("same_places").
        """
        body: Body = {"plan": dict(plan), "at": list(at), "in_air": in_air}
        options: Body = {"plan_id": plan_id, "version": version, "mission": mission, "positions": positions}
        body |= {name: value for name, value in options.items() if value is not None}
        return await self._gcs.request("POST", "/plans/insert", body)

    async def divide(
        self,
        plan: Plan,
        name: str,
        *,
        item: int | None = None,
        vehicle_ids: Sequence[str] | None = None,
        count: int | None = None,
        minimum_separation_m: float = 5.0,
    ) -> dict[str, Any]:
        """Divides a survey of a waypoint plan over several vehicles: `plan` (a mission with a role for each),
        `parts` (`role`, `vehicle`, `lines`, `layer_m`) and `notes`. Saves nothing.

        Give the `vehicle_ids`, at their present places, or only their number (`count`). `check` of the
        mission gives the time of each role and the smallest distances; `start_together` flies it.
        """
        body: Body = {"plan": dict(plan), "name": name, "minimum_separation_m": minimum_separation_m}
        vehicles = None if vehicle_ids is None else list(vehicle_ids)
        options: Body = {"item": item, "vehicles": vehicles, "count": count}
        body |= {key: value for key, value in options.items() if value is not None}
        return await self._gcs.request("POST", "/plans/divide", body)

    async def follow_ground(self, plan: Plan, *, tolerance_m: float | None = None) -> dict[str, Any]:
        """Converts a waypoint plan's altitudes above the ground to AMSL with the elevation files. Returns
        `plan`; saves nothing.

        With `tolerance_m`, waypoints are added until the height above the ground is within this tolerance.
        """
        body: dict[str, Any] = {"plan": dict(plan), "tolerance_m": tolerance_m}
        return await self._gcs.request("POST", "/plans/ground", body)

    async def elevation_files(self) -> dict[str, Any]:
        """The server's elevation files (`files`), their `folder`, and the files that cannot be used
        (`unreadable`)."""
        return await self._gcs.request("GET", "/elevation")

    async def schema(self, kind: str = "offboard_mission") -> dict[str, Any]:
        """The JSON Schema of `offboard_mission` or `waypoint_plan` documents."""
        return await self._gcs.request("GET", f"/plans/schema/{quote(kind, safe='')}")

    async def read_file(self, data: bytes, filename: str = "", **altitude: str | float) -> dict[str, Any]:
        """Converts a file to a plan (`plan`, `areas`, `notes`); saves nothing.

        Points without an altitude get `altitude_m` with `altitude_reference`. Altitudes in a file that does
        not state their reference get `altitude_reference`. A file for which one of them is missing is refused
        (`field` of the error).
        """
        query = urlencode({"filename": filename, **altitude})
        return json.loads(await self._gcs.raw("POST", f"/plans/import?{query}", content=data))

    async def read_table(self, data: bytes, filename: str = "") -> dict[str, Any]:
        """Converts a trajectory from a CSV or NumPy file (.npy) to CSV `text` for `tables` of an offboard
        mission, with a `name`; saves nothing."""
        path = f"/plans/table?{urlencode({'filename': filename})}"
        return json.loads(await self._gcs.raw("POST", path, content=data))

    async def write_file(self, plan: Plan, format: str) -> bytes:
        """Converts a plan to a file. Formats of waypoint plans: `json`, `plan`, `waypoints`, `csv`,
        `geojson`, `kml`, `kmz`; of offboard missions: `yaml`, `json`.
        """
        path = f"/plans/export?{urlencode({'format': format})}"
        return await self._gcs.raw("POST", path, body={"plan": dict(plan)})

    async def pattern(
        self,
        kind: str,
        *,
        document: str = "waypoint_plan",
        vehicle_id: str | None = None,
        tolerance_m: float | None = None,
        **fields: Any,
    ) -> dict[str, Any]:
        """Generates a survey, corridor, perimeter, orbit or structure scan: `plan`, `lines`, `path`,
        `figures`, `notes`. Saves nothing.

        `plan` is a waypoint plan with the pattern as its only item: change the values of its `pattern`, and
        its `items` follow when the plan is read. With `document="offboard_mission"` it is a mission with the
        steps; the steps begin in the air, so insert them after a take-off. With `vehicle_id`, the vehicle's
        parameters are used. With `tolerance_m`, altitudes above the ground are converted, as in
        `follow_ground`.
        """
        options = {"document": document, "vehicle": vehicle_id, "tolerance_m": tolerance_m}
        query = urlencode({name: value for name, value in options.items() if value is not None})
        return await self._gcs.request("POST", f"/plans/pattern?{query}", {"kind": kind, **fields})


RUN_TIMEOUT_S = 900.0


class DryRuns:
    """Dry runs of the server; they command no vehicle."""

    def __init__(self, gcs: GcsApi) -> None:
        self._gcs = gcs

    async def start(
        self,
        plan: Plan | None = None,
        *,
        plan_id: str | None = None,
        version: int | None = None,
        vehicle_id: str | None = None,
        flights: int | None = None,
        settings: Body | None = None,
    ) -> dict[str, Any]:
        """Starts a dry run and returns its operation.

        Args:
            plan: the document of a waypoint plan or an offboard mission.
            plan_id: id of a stored plan, instead of `plan`.
            version: version of the stored plan; default: the newest.
            vehicle_id: the vehicle whose parameters, position and battery charge are used.
            flights: number of additional flights in varied conditions (Monte Carlo).
            settings: `conditions`, `spread`, `obstacles`, `seed`, `endurance_s`, `battery_reserve`;
                `vehicles` by role, for a mission of several vehicles.
        """
        options = {
            "plan": None if plan is None else dict(plan), "plan_id": plan_id, "version": version,
            "vehicle": vehicle_id, "flights": flights,
        }  # fmt: skip
        body = {**(settings or {}), **{name: value for name, value in options.items() if value is not None}}
        return await self._gcs.request("POST", "/dry_runs", body)

    async def get(self, dry_run_id: str) -> dict[str, Any]:
        """The result of a dry run: `nominal` (path, steps, findings, …) and `monte_carlo`."""
        return await self._gcs.request("GET", f"/dry_runs/{dry_run_id}")

    async def run(
        self,
        plan: Plan | None = None,
        *,
        plan_id: str | None = None,
        version: int | None = None,
        vehicle_id: str | None = None,
        flights: int | None = None,
        settings: Body | None = None,
        timeout_s: float = RUN_TIMEOUT_S,
    ) -> dict[str, Any]:
        """Starts a dry run as `start` does, waits for its end, and returns the result.

        Raises:
            ApiError: the dry run failed; the error contains the reason.
            Timeout: the dry run is still running, and continues without this program.
        """
        operation = await self.start(
            plan, plan_id=plan_id, version=version, vehicle_id=vehicle_id, flights=flights, settings=settings
        )
        operation = await Operations(self._gcs).wait(operation["id"], timeout_s=timeout_s)
        return await self.get(operation["result"]["dry_run"])
