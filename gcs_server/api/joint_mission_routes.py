"""Starts an offboard mission of several vehicles. Pause, resume and abort of one vehicle act on all."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fastapi import APIRouter, Response

from gcs_server.api import offboard_mission_models as m
from gcs_server.api.authorized import as_operation
from gcs_server.api.documents import DocumentRoute, UnreadDocument
from gcs_server.api.group_routes import authorized_commands, tickets_of
from gcs_server.api.offboard_mission_routes import (
    check_findings,
    chosen_mission,
    corridor_for,
    dry_run_result,
    start_conditions,
)
from gcs_server.api.plan_checks import plan_context_of
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.responses import json_response
from gcs_server.api.station import Station, StationDep
from gcs_server.control.principal import Principal
from gcs_server.errors import InvalidRequest, Refused
from gcs_server.plans.compiled import compiled_roles
from gcs_server.plans.tasks import DocumentHead
from gcs_server.streamer.missions.missions import low_battery_share
from gcs_server.streamer.missions.start import Start
from gcs_server.vehicle.samples import Health
from gcs_server.vehicle.tickets import Ticket
from gcs_server.vehicle.vehicle import Vehicle

router = APIRouter(
    prefix="/offboard_missions", tags=["offboard mission"], responses=RESPONSES, route_class=DocumentRoute
)


@router.post("/start", response_model=m.JointMissionView)
async def start_joint_mission(
    body: m.StartJointMission, station: StationDep, principal: PrincipalDep
) -> Response:
    """Starts a mission with one vehicle for each role. All vehicles are checked first; if a check fails, none
    starts.

    Answers 409 `plan_findings` if a role or the separation of two vehicles has error findings, unless
    `despite` lists their codes. All vehicles begin together; `/vehicles/{v}/offboard_mission/pause`, `resume`
    and `abort` of one vehicle act on all.
    """
    shared = body.model_dump(exclude={"mission"}, exclude_none=True)
    with authorized_commands(
        station, principal, "offboard_mission/start", {v: shared for v in body.vehicles.values()}
    ) as accepted:
        tickets = tickets_of(accepted)
        for vehicle_id, ticket in tickets.items():
            station.missions.require_free(vehicle_id)
            ticket.claim()
        vehicle_ids = await as_operation(
            station,
            principal,
            "offboard_mission/start",
            tuple(tickets.values()),
            lambda: _prepare_and_begin(station, principal, body, tickets),
            vehicle_id=None,
        )
        views = [{"vehicle": each, "mission": station.missions.status(each)} for each in vehicle_ids]
        return json_response({"vehicles": views})


async def _prepare_and_begin(
    station: Station, principal: Principal, body: m.StartJointMission, tickets: Mapping[str, Ticket]
) -> list[str]:
    """Compiles and checks the mission, and begins it; returns the vehicles' ids in the order of the roles."""
    mission_name, text = await chosen_mission(station, body)
    mission = (await UnreadDocument(text).read(station.plan_work, field="mission")).head
    vehicles = _vehicles_of(station, mission, body.vehicles)
    for vehicle in vehicles.values():
        await station.offboard(vehicle.id).ensure_parameters()
    compiled = await station.plan_work.run(
        "compile_roles",
        {
            "plan": text,
            "vehicles": {role: _compile_context(station, vehicle) for role, vehicle in vehicles.items()},
        },
        small=False,
        field="mission",
    )
    check_findings(mission_name.name, compiled.values["findings"], body.despite)
    timelines = await compiled_roles(compiled)
    if any(timeline.avoidance for timeline, _ in timelines.values()):
        for role, vehicle in vehicles.items():
            if timelines[role][0].avoidance:
                await station.offboard(vehicle.id).avoidance.wait_for_sensor()
    dry_run = await dry_run_result(station, body.dry_run)
    await station.missions.ready()
    for vehicle in vehicles.values():
        _require_ready(vehicle)  # checked again, because the compilation takes seconds
    starts: dict[str, tuple[str, Start]] = {}
    for role, vehicle in vehicles.items():
        timeline, motion = timelines[role]
        starts[role] = vehicle.id, Start(
            mission_name, timeline, motion, principal.name, low_battery_share(vehicle),
            corridor_for(vehicle, dry_run, role), role=role, dry_run=body.dry_run,
        )  # fmt: skip
    assert mission.separation_m is not None
    station.missions.begin_together(starts, mission.separation_m, tickets)
    return [vehicle.id for vehicle in vehicles.values()]


def _vehicles_of(station: Station, mission: DocumentHead, vehicle_ids: dict[str, str]) -> dict[str, Vehicle]:
    """The vehicles by role, in the order of the document; all of them can be armed or are flying.

    Raises:
        InvalidRequest: the mission has no roles, or `vehicle_ids` has other roles.
    """
    if not mission.roles:
        raise InvalidRequest(
            "mission",
            f"{mission.name!r} has no roles: one vehicle flies it.",
            remedy="Start it with that vehicle (POST /vehicles/{v}/offboard_mission/start).",
        )
    require_roles(mission, vehicle_ids)
    vehicles = {role: station.fleet.get(vehicle_ids[role]) for role in mission.roles}
    for vehicle in vehicles.values():
        vehicle.require_commandable()
        _require_ready(vehicle)
    return vehicles


def require_roles(mission: DocumentHead, vehicle_ids: Mapping[str, str]) -> None:
    """Raises InvalidRequest unless `vehicle_ids` has exactly the roles of the mission."""
    missing = [role for role in mission.roles if role not in vehicle_ids]
    unknown = [role for role in vehicle_ids if role not in mission.roles]
    if missing or unknown:
        problem = f"role {missing[0]!r} has no vehicle" if missing else f"there is no role {unknown[0]!r}"
        raise InvalidRequest(
            "vehicles",
            f"vehicles: {problem}.",
            remedy=f"Name a vehicle for each role: {', '.join(mission.roles)}.",
        )


def _require_ready(vehicle: Vehicle) -> None:
    """Raises Refused if the vehicle is on the ground and reports that it cannot be armed."""
    status, health = vehicle.status, vehicle.topic("health")
    if status.armed or health is None or not isinstance(health.value, Health):
        return
    if health.value.ready_to_arm is False:
        raise Refused(
            f"Vehicle {vehicle.id} cannot be armed now, so none of the vehicles starts.",
            remedy=f"See its report (GET /vehicles/{vehicle.id}/readiness), then start all again.",
        )


def _compile_context(station: Station, vehicle: Vehicle) -> dict[str, Any]:
    context = plan_context_of(station, vehicle)
    return {
        "parameters": context.parameters,
        "reported": context.reported,
        "operator": context.operator.to_json(),
        "start": start_conditions(vehicle),
    }
