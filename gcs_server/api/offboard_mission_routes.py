"""Routes of offboard missions, which the server flies by setpoints: start (with one or several vehicles),
pause, resume, skip, answer, abort; and of missions that are registered with PX4 as flight modes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Annotated

from fastapi import Body, Response

from gcs_server.api import offboard_mission_models as m
from gcs_server.api.authorized import as_operation, progress_reporter
from gcs_server.api.documents import DocumentRoute
from gcs_server.api.group_routes import authorized_commands, tickets_of
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import Station, StationDep, VehicleDep
from gcs_server.control.accepted import authorized_command
from gcs_server.control.commands import BY_NAME
from gcs_server.control.principal import Principal
from gcs_server.flights.mission_flight import MissionFlight
from gcs_server.flights.mission_start import begin_mission, mission_as_mode, wait_for_estimates
from gcs_server.vehicle.endpoint import dds_address

router = Routes(tags=["offboard mission"], responses=RESPONSES, route_class=DocumentRoute)
MISSION, MODES = "/vehicles/{v}/offboard_mission", "/vehicles/{v}/mission_modes"


@router.get(MISSION, response_model=m.OffboardMissionView)
async def show_mission(vehicle: VehicleDep, station: StationDep) -> Response:
    """Status of the newest mission, running or ended."""
    return _view(station, vehicle.id)


@router.get(MISSION + "/flown", response_model=m.FlownMissionView)
async def show_flown(vehicle: VehicleDep, station: StationDep) -> Response:
    """The flight of the newest mission, running or ended, compared with its plan.

    `samples` are the flown positions, and the positions that were sent at the same times.
    """
    return json_response(
        {"vehicle": vehicle.id, "flown": station.flights.missions.flight(vehicle.id).flown()}
    )


@router.post(MISSION + "/start", response_model=m.OffboardMissionView)
async def start(v: str, body: m.StartMission, station: StationDep, principal: PrincipalDep) -> Response:
    """Compiles the mission from the vehicle's position, checks it, and starts it.

    Answers 409 `plan_findings` if the mission has error findings, or comes too near to another vehicle
    (`separation`), unless `despite` lists their codes.
    `if_stream_stops` is the vehicle's own action if the server fails.
    """
    await start_mission(station, principal, "offboard_mission/start", body, {None: v}, vehicle_id=v)
    return _view(station, v)


@router.post("/offboard_missions/start", response_model=m.GroupMissionView)
async def start_group(body: m.StartGroupMission, station: StationDep, principal: PrincipalDep) -> Response:
    """Starts a mission with one vehicle for each role. All vehicles are checked first; if a check fails, none
    starts.

    Answers 409 `plan_findings` if a role or the separation of two vehicles has error findings, unless
    `despite` lists their codes. All vehicles begin together as a group (`/groups`), which ends with the
    mission; `/vehicles/{v}/offboard_mission/pause`, `resume` and `abort` of one vehicle act on all.
    """
    vehicle_ids = await start_mission(
        station, principal, "offboard_mission/start", body, {**body.vehicles}, vehicle_id=None
    )
    views = [{"vehicle": each, "mission": station.flights.missions.status(each)} for each in vehicle_ids]
    return json_response({"vehicles": views})


@router.post(MISSION + "/pause", response_model=m.OffboardMissionView)
async def pause(v: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Pauses on the path in Offboard, or in Hold during take-off and landing. A start that has not begun the
    mission is cancelled.

    In a mission of several vehicles, pause, resume and abort act on all of them.
    """
    return command_mission(
        station, principal, "offboard_mission/pause", v, MissionFlight.pause, ends_start=True
    )


@router.post(MISSION + "/resume", response_model=m.OffboardMissionView)
async def resume(v: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Resumes the mission; the vehicle first flies straight back to the path."""
    return command_mission(station, principal, "offboard_mission/resume", v, MissionFlight.resume)


@router.post(MISSION + "/skip", response_model=m.OffboardMissionView)
async def skip(v: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Skips the current step; a suspended mission resumes at the next step."""
    return command_mission(station, principal, "offboard_mission/skip", v, MissionFlight.skip)


@router.post(MISSION + "/go_on", response_model=m.OffboardMissionView)
async def go_on(v: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Continues after a step that waits for the operator."""
    return command_mission(station, principal, "offboard_mission/go_on", v, MissionFlight.go_on)


@router.post(MISSION + "/abort", response_model=m.OffboardMissionView)
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
        station, principal, "offboard_mission/abort", v, MissionFlight.abort, ends_start=True, then=then
    )


@router.get(MODES, response_model=m.MissionModesView)
async def show_modes(vehicle: VehicleDep, station: StationDep) -> Response:
    """The missions of this server that are registered with PX4 as flight modes."""
    return _modes_view(station, vehicle.id)


@router.post(MODES + "/register", response_model=m.MissionModesView)
async def register(v: str, body: m.RegisterMode, station: StationDep, principal: PrincipalDep) -> Response:
    """Registers a mission with PX4 as a flight mode; answers when PX4 has accepted the mode.

    A mission whose first step is a take-off begins when the vehicle is armed in the mode, any other mission
    when the mode is selected in the air. At registration, the mission is compiled and checked from the
    vehicle's present position: 409 `plan_findings` if it has error findings that `despite` does not list. A
    mission without a take-off is compiled again when it begins. A mission with a take-off is compiled again
    while the vehicle is disarmed, whenever its position or a setting has changed; PX4 arms in the mode only
    while `ready` is true.

    A registration is an operation. A vehicle that has just connected reports its topics' layouts and its
    estimates one after the other: for up to 10 s the registration waits for them, and then refuses with what
    is missing.
    """
    arguments, name = body.model_dump(exclude={"mission"}, exclude_none=True), "mission_modes/register"

    def require_permission() -> None:
        station.authority.admit(principal, BY_NAME[name], v)

    async def work() -> None:
        progress = progress_reporter(vehicle, principal, name)
        await wait_for_estimates(vehicle, progress)
        await station.flights.mission_modes.register(v, mode, require_permission, progress)

    with authorized_command(station, principal, "mission_modes/register", v, arguments):
        vehicle = station.fleet.get(v)
        vehicle.require_commandable()
        mode = await mission_as_mode(
            station.flights, body.source, body.name, principal.name,
            despite=body.despite, defer_failsafes_s=body.defer_failsafes_s,
        )  # fmt: skip
        await as_operation(station, principal, name, (), work, vehicle_id=v)
        return _modes_view(station, v)


@router.post(MODES + "/unregister", response_model=m.MissionModesView)
async def unregister(
    v: str, body: m.UnregisterMode, station: StationDep, principal: PrincipalDep
) -> Response:
    """Removes a mode from PX4; refused while the vehicle flies in it."""
    with authorized_command(station, principal, "mission_modes/unregister", v, body.model_dump()):
        station.flights.mission_modes.unregister(v, body.name)
        return _modes_view(station, v)


# --- helpers ------------------------------------------------------------------------------------------


def command_mission(
    station: Station,
    principal: Principal,
    command: str,
    vehicle_id: str,
    action: Callable[..., None],
    *,
    ends_start: bool = False,
    **arguments: object,
) -> Response:
    """Runs a command on the mission of a vehicle. The caller must control all vehicles of this mission.

    Args:
        station: the running server.
        principal: the caller.
        command: the command's row in `control/commands.py`.
        vehicle_id: the vehicle.
        action: the method of `MissionFlight`; gets the caller's name, and must not wait.
        ends_start: whether the command cancels a start that has not begun the mission, which then is its
            whole effect.
        arguments: more arguments, also for the journal.
    """
    vehicles = (vehicle_id, *station.flights.missions.others_on_mission(vehicle_id))
    with authorized_commands(station, principal, command, {v: arguments for v in vehicles}) as accepted:
        station.fleet.get(vehicle_id).require_commandable()
        flight = station.flights.missions.find_flight(vehicle_id)
        if ends_start and (flight is None or flight.over) and accepted[vehicle_id].ticket.claim():
            return _view(station, vehicle_id)
        flight = station.flights.missions.flight(vehicle_id)
        with ExitStack() as stack:
            for each in (flight, *(() if flight.group is None else flight.group.flights.values())):
                if each.vehicle_id in accepted and (each is flight or each.vehicle_id != vehicle_id):
                    stack.enter_context(each.commanded(accepted[each.vehicle_id].ticket))
            action(flight, principal.name, **arguments)
        return _view(station, vehicle_id)


async def start_mission(
    station: Station,
    principal: Principal,
    command: str,
    body: m.StartMission | m.StartGroupMission,
    vehicle_ids: Mapping[str | None, str],
    vehicle_id: str | None,
) -> list[str]:
    """Starts a mission; returns the ids of its vehicles in the order of the roles.

    Args:
        station: the running server.
        principal: the caller.
        command: the command's row in `control/commands.py`.
        body: the mission.
        vehicle_ids: the vehicle of each role; the role of a mission of one vehicle is None.
        vehicle_id: the vehicle of the operation; None: several.
    """
    arguments = body.model_dump(exclude={"mission"}, exclude_none=True)
    with authorized_commands(
        station, principal, command, {v: arguments for v in vehicle_ids.values()}
    ) as accepted:
        tickets = tickets_of(accepted)

        def progress(text: str, fraction: float | None) -> None:
            for each in tickets:
                progress_reporter(station.fleet.get(each), principal, command)(text, fraction)

        for each, ticket in tickets.items():
            station.flights.missions.require_free(each)
            ticket.claim()
        return await as_operation(
            station,
            principal,
            command,
            tuple(tickets.values()),
            lambda: begin_mission(
                station.flights, body.source, vehicle_ids, tickets, principal.name,
                despite=body.despite, dry_run_id=body.dry_run, progress=progress,
            ),
            vehicle_id=vehicle_id,
        )  # fmt: skip


def _view(station: Station, vehicle_id: str) -> Response:
    return json_response({"vehicle": vehicle_id, "mission": station.flights.missions.status(vehicle_id)})


def _modes_view(station: Station, vehicle_id: str) -> Response:
    vehicle = station.fleet.get(vehicle_id)
    possible = dds_address(vehicle.endpoints) is not None
    modes = station.flights.mission_modes.all(vehicle_id)
    return json_response({"vehicle": vehicle_id, "possible": possible, "modes": modes})
