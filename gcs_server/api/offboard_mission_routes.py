"""Routes of offboard missions, which the server flies by setpoints: start, pause, resume, skip, answer,
abort."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, replace
from typing import Annotated, Any

from fastapi import APIRouter, Body, Response

from gcs_server.api import offboard_mission_models as m
from gcs_server.api.authorized import as_operation, authorized_command
from gcs_server.api.documents import DocumentRoute
from gcs_server.api.group_routes import authorized_commands
from gcs_server.api.plan_checks import plan_context_of
from gcs_server.api.plan_traffic import mission_separation_findings
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.responses import json_response
from gcs_server.api.station import Station, StationDep, VehicleDep
from gcs_server.control.principal import Principal
from gcs_server.errors import InvalidRequest, PlanFindings, Refused
from gcs_server.plans.compiled import compiled_mission
from gcs_server.plans.dry_run_corridor import corridor_of
from gcs_server.plans.dry_runs import DryRunResult
from gcs_server.streamer.missions.flight import MissionFlight
from gcs_server.streamer.missions.missions import low_battery_share
from gcs_server.streamer.missions.start import Start
from gcs_server.streamer.missions.status import MissionName
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.vehicle.vehicle import Vehicle
from missions.runner.corridor import Corridor

router = APIRouter(
    prefix="/vehicles/{v}/offboard_mission",
    tags=["offboard mission"],
    responses=RESPONSES,
    route_class=DocumentRoute,
)


@router.get("", response_model=m.OffboardMissionView)
async def show_mission(vehicle: VehicleDep, station: StationDep) -> Response:
    """Status of the newest mission, running or ended."""
    return _view(station, vehicle.id)


@router.get("/flown", response_model=m.FlownMissionView)
async def show_flown(vehicle: VehicleDep, station: StationDep) -> Response:
    """The flight of the newest mission, running or ended, compared with its plan.

    `samples` are the flown positions, and the positions that were sent at the same times.
    """
    return json_response({"vehicle": vehicle.id, "flown": station.missions.flight(vehicle.id).flown()})


@router.post("/start", response_model=m.OffboardMissionView)
async def start(v: str, body: m.StartMission, station: StationDep, principal: PrincipalDep) -> Response:
    """Compiles the mission from the vehicle's position, checks it, and starts it.

    Answers 409 `plan_findings` if the mission has error findings, or comes too near to another vehicle
    (`separation`), unless `despite` lists their codes.
    `if_stream_stops` is the vehicle's own action if the server fails.
    """
    arguments = body.model_dump(exclude={"mission"}, exclude_none=True)
    with authorized_command(station, principal, "offboard_mission/start", v, arguments) as accepted:
        ticket, vehicle = accepted.ticket, station.fleet.get(v)
        station.missions.require_free(v)
        ticket.claim()

        async def work() -> None:
            mission_name, text = await chosen_mission(station, body)
            prepared, findings = await _compiled_start(station, v, mission_name, text, principal.name)
            corridor = corridor_for(vehicle, await dry_run_result(station, body.dry_run))
            async with station.waypoint_flights.comparison_lock:
                findings += await mission_separation_findings(station, vehicle, prepared.timeline)
                check_findings(mission_name.name, findings, body.despite)
                await _wait_for_sensor(station, v, prepared)
                prepared = replace(prepared, corridor=corridor, dry_run=body.dry_run)
                station.missions.begin(v, prepared, ticket)

        await as_operation(station, principal, "offboard_mission/start", (ticket,), work, vehicle_id=v)
        return _view(station, v)


@router.post("/pause", response_model=m.OffboardMissionView)
async def pause(v: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Pauses on the path in Offboard, or in Hold during take-off and landing. A start that has not begun the
    mission is cancelled.

    In a mission of several vehicles, pause, resume and abort act on all of them.
    """
    return command_mission(
        station,
        principal,
        "offboard_mission/pause",
        v,
        lambda flight: flight.pause(principal.name),
        ends_start=True,
    )


@router.post("/resume", response_model=m.OffboardMissionView)
async def resume(v: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Resumes the mission; the vehicle first flies straight back to the path."""
    return command_mission(
        station, principal, "offboard_mission/resume", v, lambda flight: flight.resume(principal.name)
    )


@router.post("/skip", response_model=m.OffboardMissionView)
async def skip(v: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Skips the current step; a suspended mission resumes at the next step."""
    return command_mission(
        station, principal, "offboard_mission/skip", v, lambda flight: flight.skip(principal.name)
    )


@router.post("/go_on", response_model=m.OffboardMissionView)
async def go_on(v: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Continues after a step that waits for the operator."""
    return command_mission(
        station, principal, "offboard_mission/go_on", v, lambda flight: flight.go_on(principal.name)
    )


@router.post("/abort", response_model=m.OffboardMissionView)
async def abort(
    v: str,
    station: StationDep,
    principal: PrincipalDep,
    body: Annotated[m.AbortMission | None, Body()] = None,
) -> Response:
    """Ends the mission; the vehicle holds, returns or lands. If the mission does not control the vehicle, no
    command is sent. A start that has not begun the mission is cancelled."""
    then = (body or m.AbortMission()).then
    return command_mission(
        station,
        principal,
        "offboard_mission/abort",
        v,
        lambda flight: flight.abort(principal.name, then),
        {"then": then},
        ends_start=True,
    )


# --- helpers ------------------------------------------------------------------------------------------


def command_mission(
    station: Station,
    principal: Principal,
    command: str,
    vehicle_id: str,
    action: Callable[[MissionFlight], None],
    arguments: dict[str, object] | None = None,
    *,
    ends_start: bool = False,
) -> Response:
    """Runs a command on the mission of a vehicle. The caller must control all vehicles of this mission.

    Args:
        station: the running server.
        principal: the caller.
        command: the command's row in `control/commands.py`.
        vehicle_id: the vehicle.
        action: the command; must not wait.
        arguments: arguments for the journal.
        ends_start: whether the command cancels a start that has not begun the mission, which then is its
            whole effect.
    """
    vehicles = (vehicle_id, *station.missions.others_on_mission(vehicle_id))
    with authorized_commands(station, principal, command, {v: arguments or {} for v in vehicles}) as accepted:
        station.fleet.get(vehicle_id).require_commandable()
        flight = station.missions.find_flight(vehicle_id)
        if ends_start and (flight is None or flight.over) and accepted[vehicle_id].ticket.claim():
            return _view(station, vehicle_id)
        flight = station.missions.flight(vehicle_id)
        with ExitStack() as stack:
            for each in (flight, *(() if flight.joint is None else flight.joint.flights.values())):
                if each.vehicle_id in accepted and (each is flight or each.vehicle_id != vehicle_id):
                    stack.enter_context(each.commanded(accepted[each.vehicle_id].ticket))
            action(flight)
        return _view(station, vehicle_id)


def _view(station: Station, vehicle_id: str) -> Response:
    return json_response({"vehicle": vehicle_id, "mission": station.missions.status(vehicle_id)})


async def prepared_start(
    station: Station,
    vehicle_id: str,
    mission_name: MissionName,
    text: bytes,
    despite: Sequence[str],
    client: str,
    overrides: Mapping[str, Any] | None = None,
) -> Start:
    """Compiles a mission from the vehicle's present position, and checks it.

    Args:
        station: the running server.
        vehicle_id: the vehicle.
        mission_name: name, id and version of the mission.
        text: the mission as JSON.
        despite: codes of the error findings that the client accepts.
        client: name of the client that starts the mission.
        overrides: values of `start_conditions` that will be different when the mission begins.

    Raises:
        PlanFindings: the mission has error findings whose codes are not in `despite`.
        Refused: the vehicle's position is unknown, or a needed sensor is missing.
    """
    prepared, findings = await _compiled_start(station, vehicle_id, mission_name, text, client, overrides)
    check_findings(mission_name.name, findings, despite)
    await _wait_for_sensor(station, vehicle_id, prepared)
    return prepared


async def _compiled_start(
    station: Station,
    vehicle_id: str,
    mission_name: MissionName,
    text: bytes,
    client: str,
    overrides: Mapping[str, Any] | None = None,
) -> tuple[Start, list[dict[str, Any]]]:
    """Compiles a mission; returns it with its findings."""
    vehicle = station.fleet.get(vehicle_id)
    await station.offboard(vehicle_id).ensure_parameters()
    context = plan_context_of(station, vehicle)
    compiled = await station.plan_work.run(
        "compile",
        {
            "plan": text,
            "parameters": context.parameters,
            "reported": context.reported,
            "operator": context.operator.to_json(),
            "start": {**start_conditions(vehicle), **(overrides or {})},
        },
        small=False,
        field="mission",
    )
    timeline, motion = await compiled_mission(compiled)
    start = Start(mission_name, timeline, motion, client, low_battery_share(vehicle))
    return start, list(compiled.values["findings"])


async def _wait_for_sensor(station: Station, vehicle_id: str, prepared: Start) -> None:
    """Waits for the distance sensor that obstacle avoidance needs; raises Refused if there is none."""
    if prepared.timeline.avoidance:
        await station.offboard(vehicle_id).avoidance.wait_for_sensor()


async def chosen_mission(station: Station, body: m.MissionSource) -> tuple[MissionName, bytes]:
    """Name, id and version of the mission in the request, and the mission as JSON."""
    if body.mission is not None:
        mission = await body.mission.read(station.plan_work, field="mission")
        return MissionName(mission.head.name or "", None, None), mission.text
    assert body.plan_id is not None
    stored, document = await station.plans.get(body.plan_id, body.version)
    if stored.kind != "offboard_mission":
        raise InvalidRequest(
            "plan_id",
            f"{stored.name!r} is a waypoint plan, which the vehicle flies itself.",
            remedy="Upload it and start it (…/mission/start), or convert it to an offboard mission "
            "(POST /plans/convert).",
        )
    return MissionName(stored.name, stored.id, stored.version), document


def start_conditions(vehicle: Vehicle) -> dict[str, Any]:
    """Conditions for a mission that starts now: the vehicle's position and yaw, its local origin, the
    altitude of home, and whether the vehicle is in the air.

    Raises:
        Refused: the position is unknown.
    """
    estimates = VehicleEstimates(vehicle)
    local, attitude, home = estimates.local(), estimates.attitude(), estimates.home()
    if local is None or attitude is None or not estimates.has_position():
        raise Refused(
            f"Vehicle {vehicle.id} has no valid position estimate, which a mission needs.",
            remedy="Wait for GPS and the estimator (see the vehicle's messages), then try again.",
        )
    origin = estimates.origin()
    return {
        "position_ned_m": local.position_ned_m,
        "yaw_ned_rad": attitude.yaw_ned_rad,
        "origin": None if origin is None else asdict(origin),
        "home_alt_amsl_m": None if home is None else home.alt_amsl_m,
        "in_air": vehicle.status.armed and vehicle.status.landed_state not in ("on_ground", "unknown"),
    }


async def dry_run_result(station: Station, dry_run_id: str | None) -> DryRunResult | None:
    """The result of a dry run; None: no dry run is named. Raises UnknownDryRun."""
    return None if dry_run_id is None else await station.dry_runs.result(dry_run_id)


def corridor_for(vehicle: Vehicle, dry_run: DryRunResult | None, role: str | None = None) -> Corridor | None:
    """The corridor of a dry run for a vehicle that flies the mission, or one role of it; None: no dry run is
    named.

    Raises:
        Refused: the dry run has no corridor for this vehicle.
    """
    if dry_run is None:
        return None
    estimates = VehicleEstimates(vehicle)
    local = estimates.local()
    position = (0.0, 0.0, 0.0) if local is None else local.position_ned_m
    return corridor_of(dry_run, position, estimates.origin(), role)


def check_findings(name: str, findings: list[dict[str, Any]], despite: Sequence[str]) -> None:
    """Raises PlanFindings if the mission has error findings whose codes are not in `despite`."""
    unaccepted = [each for each in findings if each["severity"] == "error" and each["code"] not in despite]
    if unaccepted:
        reasons = tuple(f"{each['step'] or 'The mission'}: {each['text']}" for each in unaccepted)
        raise PlanFindings(
            f"The mission {name!r} has errors. {reasons[0]}",
            codes=tuple(dict.fromkeys(each["code"] for each in unaccepted)),
            reasons=reasons,
            remedy="Correct the mission, or name the codes in `despite` if you accept them.",
        )
