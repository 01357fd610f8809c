"""Dry runs: plans flown in simulation. These routes send nothing to a vehicle."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Response

from gcs_server.api import dry_run_models as m
from gcs_server.api.authorized import authorized_command
from gcs_server.api.documents import DocumentRoute, UnreadDocument
from gcs_server.api.dry_run_aircraft import aircraft_from_vehicle, merged_assumptions
from gcs_server.api.joint_mission_routes import require_roles
from gcs_server.api.operation_routes import OperationModel, operation_view
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.responses import json_bytes, json_response
from gcs_server.api.station import Station, StationDep
from gcs_server.control.commands import API
from gcs_server.errors import InvalidRequest
from gcs_server.operations.operations import ReportProgress
from gcs_server.plans.tasks import DocumentHead, ReadDocument
from missions.dry_run.spread import MAX_VEHICLES

SimulatedVehicles = tuple[dict[str, Any], list[str]]
"""The simulated vehicles, and the assumptions about them."""

router = APIRouter(prefix="/dry_runs", tags=["dry runs"], responses=RESPONSES, route_class=DocumentRoute)


@router.post("", response_model=OperationModel, status_code=202)
async def start_dry_run(body: m.DryRunRequest, station: StationDep, principal: PrincipalDep) -> Response:
    """Flies a plan in simulation, once or many times; changes nothing and commands no vehicle.

    A dry run is an operation with progress; `DELETE /operations/{id}` cancels it. After success, `GET
    /dry_runs/{d}` returns the result; `d` is `result.dry_run` of the operation. At most two run at a time.
    """
    journal_arguments = body.model_dump(
        include={"plan_id", "version", "vehicle", "flights"}, exclude_none=True
    )
    with authorized_command(station, principal, "dry_runs/start", None, journal_arguments):
        plan_reference, document = await _chosen_plan(station, body)
        simulated, assumptions = _role_vehicles(station, body, document.head) or _single_vehicle(
            station, body, document.head
        )
        kind = document.head.kind
        request = {
            "kind": kind,
            **simulated,
            "conditions": body.conditions.model_dump(),
            "obstacles": [each.model_dump() for each in body.obstacles],
            "seed": body.seed,
            "flights": body.flights,
            "spread": body.spread.model_dump(),
            "elevation": await station.plan_work.elevation_paths(),
        }  # fmt: skip
        details = {
            "kind": kind, **plan_reference, "vehicle": body.vehicle, "vehicles": body.vehicles,
            "assumed": assumptions,
        }  # fmt: skip
        dry_run_id = station.dry_runs.next_id()

        async def work(report: ReportProgress) -> dict[str, object]:
            return await station.dry_runs.run(dry_run_id, document.text, request, details, report)

        operation = station.operations.start(
            "dry_run", work, text="The simulated vehicles start.", subject=dry_run_id,
            by=(principal.name, principal.key),
        )  # fmt: skip
        response = json_response(operation_view(operation), 202)
        response.headers["Location"] = f"{API}/operations/{operation.id}"
        return response


@router.get("/{d}", response_model=m.DryRunView)
async def show_dry_run(d: str, station: StationDep) -> Response:
    """The result of a dry run; the last ten are stored until the server is shut down."""
    return json_bytes(station.dry_runs.body(d))


def _single_vehicle(station: Station, body: m.DryRunRequest, document: DocumentHead) -> SimulatedVehicles:
    if body.vehicles is not None:
        raise InvalidRequest(
            "vehicles", "The plan has no roles: one vehicle flies it.", remedy="Name it in `vehicle`."
        )
    vehicle = None if body.vehicle is None else station.fleet.get(body.vehicle)
    aircraft, origin, assumptions = aircraft_from_vehicle(vehicle, document)
    return {"roles": None, "aircraft": {**aircraft, **_battery(body)}, "origin": origin}, assumptions


def _role_vehicles(
    station: Station, body: m.DryRunRequest, document: DocumentHead
) -> SimulatedVehicles | None:
    """The vehicles of a mission with roles; None for other plans."""
    if not document.roles:
        return None
    if body.vehicle is not None:
        raise InvalidRequest(
            "vehicle",
            "The mission has roles, each flown by one vehicle.",
            remedy="Leave `vehicle` out, and name a vehicle for each role in `vehicles`.",
        )
    max_flights = MAX_VEHICLES // len(document.roles)
    if body.flights is not None and body.flights > max_flights:
        raise InvalidRequest(
            "flights",
            f"{body.flights} flights of {len(document.roles)} vehicles are too many.",
            remedy=f"Give at most {max_flights}.",
        )
    if body.vehicles is not None:
        require_roles(document, body.vehicles)
    elif any(start_ned_m is None for start_ned_m in document.roles.values()):
        raise InvalidRequest(
            "vehicles",
            "The start positions are not known: no vehicle is named, and some roles have no `start_ned_m`.",
            remedy="Name a vehicle for each role, or give each role `start_ned_m`.",
        )
    roles: dict[str, dict[str, Any]] = {}
    assumptions: dict[str, list[str]] = {}
    for role in document.roles:
        vehicle = None if body.vehicles is None else station.fleet.get(body.vehicles[role])
        aircraft, origin, assumptions[role] = aircraft_from_vehicle(vehicle, document, role)
        roles[role] = {"aircraft": {**aircraft, **_battery(body)}, "origin": origin}
    return {"roles": roles}, merged_assumptions(assumptions)


def _battery(body: m.DryRunRequest) -> dict[str, Any]:
    return {"endurance_s": body.endurance_s, "battery_reserve": body.battery_reserve}


async def _chosen_plan(station: Station, body: m.DryRunRequest) -> tuple[dict[str, Any], ReadDocument]:
    """Name, id and version of the plan in the request, and its document."""
    if body.plan is not None:
        return {"name": None, "plan_id": None, "version": None}, await body.plan.read(station.plan_work)
    assert body.plan_id is not None
    stored, text = await station.plans.get(body.plan_id, body.version)
    document = await UnreadDocument(text).read(station.plan_work, field="plan_id")
    return {"name": stored.name, "plan_id": stored.id, "version": stored.version}, document
