"""Dry runs: plans flown in simulation. These routes send nothing to a vehicle."""

from __future__ import annotations

from fastapi import Response

from gcs_server.api import dry_run_models as m
from gcs_server.api.documents import DocumentRoute
from gcs_server.api.operation_routes import OperationModel, operation_view
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.responses import json_bytes, json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import StationDep
from gcs_server.control.accepted import authorized_command
from gcs_server.control.commands import API
from gcs_server.flights.dry_runs import begin_dry_run

SETTINGS = {
    "conditions", "obstacles", "seed", "flights", "spread", "endurance_s", "battery_reserve"
}  # fmt: skip
"""Fields of a request that the simulation gets."""
router = Routes(prefix="/dry_runs", tags=["dry runs"], responses=RESPONSES, route_class=DocumentRoute)


@router.post("", response_model=OperationModel, status_code=202)
async def start_dry_run(body: m.DryRunRequest, station: StationDep, principal: PrincipalDep) -> Response:
    """Flies a plan in simulation, once or many times; changes nothing and commands no vehicle.

    A dry run is an operation with progress; `DELETE /operations/{id}` cancels it. After success, `GET
    /dry_runs/{d}` returns the result; `d` is `result.dry_run` of the operation. At most two run at a time,
    of each client one.
    """
    journal_arguments = body.model_dump(
        include={"plan_id", "version", "vehicle", "flights"}, exclude_none=True
    )
    with authorized_command(station, principal, "dry_runs/start", None, journal_arguments):
        settings = body.model_dump(include=SETTINGS)
        by = (principal.name, principal.key)
        operation = await begin_dry_run(
            station.flights, body.source, body.vehicle, body.vehicles, settings, by
        )
        response = json_response(operation_view(operation), 202)
        response.headers["Location"] = f"{API}/operations/{operation.id}"
        return response


@router.get("/{d}", response_model=m.DryRunView)
async def show_dry_run(d: str, station: StationDep) -> Response:
    """The result of a dry run; the last ten are stored until the server is shut down."""
    return json_bytes(station.flights.dry_runs.body(d))
