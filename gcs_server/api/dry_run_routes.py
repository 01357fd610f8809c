"""Dry runs: plans flown in simulation. Nothing here reaches a vehicle."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Response

from gcs_server.api import dry_run_models as m
from gcs_server.api.authorized import authorized_command
from gcs_server.api.dry_run_aircraft import aircraft_of
from gcs_server.api.operation_routes import OperationModel, operation_view
from gcs_server.api.plan_checks import text_of
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.responses import answer
from gcs_server.api.station import Station, StationDep
from gcs_server.control.commands import API
from gcs_server.errors import Refused
from gcs_server.operations.operations import ReportProgress
from missions import documents
from missions.documents import Document
from missions.errors import PlanError

router = APIRouter(prefix="/dry_runs", tags=["dry runs"], responses=RESPONSES)


@router.post("", response_model=OperationModel, status_code=202)
async def start_dry_run(body: m.DryRunRequest, station: StationDep, principal: PrincipalDep) -> Response:
    """Flies a plan in simulation, once or many times; changes nothing and commands no vehicle.

    An operation with progress, to be cancelled by `DELETE /operations/{id}`; when it has succeeded,
    `GET /dry_runs/{d}` returns the result; `d` is `result.dry_run`. Two run at once at most.
    """
    about_body = body.model_dump(include={"plan_id", "version", "vehicle", "flights"}, exclude_none=True)
    with authorized_command(station, principal, "dry_runs/start", None, about_body):
        kept, document = await _chosen(station, body)
        vehicle = None if body.vehicle is None else station.fleet.get(body.vehicle)
        aircraft, origin, assumed = aircraft_of(vehicle, document)
        kind = documents.kind_of(document)
        request = {
            "kind": kind,
            "plan": text_of(document),
            "origin": origin,
            "aircraft": {
                **aircraft, "endurance_s": body.endurance_s, "battery_reserve": body.battery_reserve
            },
            "conditions": body.conditions.model_dump(),
            "obstacles": [each.model_dump() for each in body.obstacles],
            "seed": body.seed,
            "flights": body.flights,
            "spread": body.spread.model_dump(),
        }  # fmt: skip
        about = {"kind": kind, **kept, "vehicle": body.vehicle, "assumed": assumed}
        dry_run_id = station.dry_runs.next_id()

        async def work(report: ReportProgress) -> dict[str, object]:
            return await station.dry_runs.run(dry_run_id, request, about, report)

        operation = station.operations.start(
            "dry_run", work, text="The simulated vehicles start.", subject=dry_run_id,
            by=(principal.name, principal.key),
        )  # fmt: skip
        response = answer(operation_view(operation), 202)
        response.headers["Location"] = f"{API}/operations/{operation.id}"
        return response


@router.get("/{d}", response_model=m.DryRunView)
async def show_dry_run(d: str, station: StationDep) -> Response:
    """The result of a dry run; the last ten are kept until the server is shut down."""
    return answer(station.dry_runs.get(d))


async def _chosen(station: Station, body: m.DryRunRequest) -> tuple[dict[str, Any], Document]:
    """The chosen plan: its name, and its document."""
    if body.plan is not None:
        return {"name": None, "plan_id": None, "version": None}, body.plan
    assert body.plan_id is not None
    head, text = await station.plans.get(body.plan_id, body.version)
    try:
        return {"name": head.name, "plan_id": head.id, "version": head.version}, documents.read(text)
    except PlanError as error:
        raise Refused(f"Plan {head.name!r} cannot be read: {error}") from error
