"""Plans flown in simulation by the server before a vehicle flies them."""

from __future__ import annotations

from typing import Any, Protocol

from gcs_server.client.operations import Operations
from gcs_server.client.plans import Plan
from gcs_server.client.setpoints import Body

RUN_TIMEOUT_S = 900.0


class GcsApi(Protocol):
    """The part of `Gcs` that this module uses."""

    async def request(self, method: str, path: str, body: Body | None = None) -> Any: ...


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
