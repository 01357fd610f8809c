"""Routes that show vehicles and command them."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import nullcontext, suppress
from typing import Annotated

from fastapi import APIRouter, Body, Query, Response

from gcs_server.api import control_models, models, responses
from gcs_server.api.authorized import AcceptedCommand, as_operation, authorized_command, progress_reporter
from gcs_server.api.mission_models import StartRequest
from gcs_server.api.mission_start import checked_start
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.responses import json_response
from gcs_server.api.station import Station, StationDep, VehicleDep
from gcs_server.control.commands import BY_NAME
from gcs_server.control.principal import Principal
from gcs_server.errors import InvalidRequest, UnknownVehicle
from gcs_server.vehicle.samples import TOPICS, Sample
from gcs_server.vehicle.services.command import ARMING_STARTS_FLIGHT, GOTO_MAX_DISTANCE_M
from gcs_server.vehicle.tickets import Ticket
from gcs_server.vehicle.vehicle import Vehicle

HISTORY_S = 300.0
ENDING_MODES = frozenset({"hold", "land", "rtl"})
"""Modes that end a flight: the command is completed, even if its caller closes the connection."""

router = APIRouter(prefix="/vehicles", tags=["vehicles"], responses=RESPONSES)


async def run_command(
    station: Station,
    principal: Principal,
    command: str,
    vehicle_id: str,
    arguments: dict[str, object],
    work: Callable[[Vehicle], Awaitable[object]],
    *,
    result_as: str | None = None,
) -> Response:
    """Runs `work` as a command and writes it to the journal; answers once the vehicle's own state shows the
    result. `result_as` is the name of the response's field for the result of `work`.
    """
    with authorized_command(station, principal, command, vehicle_id, arguments) as accepted:
        vehicle = station.fleet.get(vehicle_id)
        result = await work(vehicle)
    body = _command_done(command, vehicle, accepted)
    if result_as is not None:
        body[result_as] = result
    return json_response(body)


async def run_flight_command(
    station: Station,
    principal: Principal,
    command: str,
    vehicle_id: str,
    arguments: dict[str, object],
    work: Callable[[Vehicle, Ticket], Awaitable[object]],
    *,
    ends_with_caller: bool = True,
) -> Response:
    """Runs `work` as a command that moves or stops a vehicle, like `run_command`. A command that moves the
    vehicle is an operation; it ends with its caller's connection unless `ends_with_caller` is False.
    """
    with authorized_command(station, principal, command, vehicle_id, arguments) as accepted:
        vehicle = station.fleet.get(vehicle_id)
        if BY_NAME[command].acts == "moves":
            await as_operation(
                station,
                principal,
                command,
                (accepted.ticket,),
                lambda: work(vehicle, accepted.ticket),
                vehicle_id=vehicle_id,
                ends_with_caller=ends_with_caller,
            )
        else:
            await work(vehicle, accepted.ticket)
    return json_response(_command_done(command, vehicle, accepted))


def _command_done(command: str, vehicle: Vehicle, accepted: AcceptedCommand) -> dict[str, object]:
    return {
        "vehicle": vehicle.id,
        "command": command,
        "duration_s": accepted.duration_s,
        "status": vehicle.status,
    }


@router.get("", response_model=list[responses.VehicleModel])
async def list_vehicles(station: StationDep) -> Response:
    """All vehicles with all their data."""
    return json_response([responses.vehicle_view(vehicle) for vehicle in station.fleet.all()])


@router.get("/{v}", response_model=responses.VehicleModel)
async def show_vehicle(vehicle: VehicleDep) -> Response:
    """Identity, status and every topic's newest sample."""
    return json_response(responses.vehicle_view(vehicle))


@router.delete("/{v}", status_code=204)
async def remove_vehicle(v: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Removes a vehicle that is no longer connected. Answers 409 while it is connected, has a setpoint
    stream, or is controlled by another client. If it connects again, it is listed as a new vehicle.
    """
    with authorized_command(station, principal, "vehicles/remove", None, {"vehicle": v}):
        refusal = station.authority.refusal(principal, "vehicles/remove", [v])
        if refusal is not None:
            raise refusal
        station.fleet.remove(v, principal.name)
    return Response(status_code=204)


@router.get("/{v}/history", response_model=responses.History)
async def history(
    vehicle: VehicleDep,
    topics: Annotated[str, Query(description="Names of topics, separated by commas; default: all.")] = "",
    since_unix_s: Annotated[
        float | None,
        Query(
            allow_inf_nan=False,
            description="Only samples since this time [s since 1970]; the last 5 minutes are kept.",
        ),
    ] = None,
) -> Response:
    """The samples of the last minutes at up to 4 Hz, oldest first."""
    topic_names = tuple(dict.fromkeys(name for name in topics.split(",") if name)) or tuple(TOPICS)
    unknown = [name for name in topic_names if name not in TOPICS]
    if unknown:
        raise InvalidRequest(
            "topics", f"Unknown: {', '.join(unknown)}.", remedy=f"Known topics: {', '.join(TOPICS)}."
        )
    since = vehicle.clock.unix_s() - HISTORY_S if since_unix_s is None else since_unix_s
    samples: list[Sample] = []
    for topic in topic_names:
        samples += vehicle.history((topic,), since)
        # Between two topics with thousands of samples, the event loop can do other work.
        await asyncio.sleep(0)
    samples.sort(key=lambda sample: sample.received_monotonic_s)
    pieces: list[bytes] = []
    for piece in responses.history_pieces(vehicle, samples):
        pieces.append(piece)
        await asyncio.sleep(0)
    return json_response(responses.history_view(pieces))


@router.get("/{v}/messages", response_model=responses.Messages)
async def messages(
    vehicle: VehicleDep, since: Annotated[int, Query(ge=0, description="Only messages after this index.")] = 0
) -> Response:
    """Status texts of the vehicle, and events of vehicle and server."""
    return json_response({"messages": [responses.message_view(e) for e in vehicle.events.since(since)]})


@router.post("/{v}/arm", response_model=responses.CommandDone, tags=["commands"])
async def arm(
    v: str,
    station: StationDep,
    principal: PrincipalDep,
    body: Annotated[models.ArmRequest | None, Body()] = None,
) -> Response:
    """Starts the motors.

    Answers 409 `plan_findings` with the code `arming_starts_flight` if the vehicle is in a mode in which
    arming starts a flight (Take off, Mission), unless `despite` names it.
    """
    despite = [] if body is None else body.despite

    async def work(vehicle: Vehicle, ticket: Ticket) -> None:
        starts_flight = ARMING_STARTS_FLIGHT in despite
        in_mission = starts_flight and not vehicle.status.armed and vehicle.status.mode == "mission"
        request = StartRequest(despite=[code for code in despite if code != ARMING_STARTS_FLIGHT])
        check = checked_start(station, vehicle, request, ticket, principal.name)
        async with check if in_mission else nullcontext():
            await vehicle.command.arm(
                starts_flight=starts_flight,
                progress=progress_reporter(vehicle, principal, "arm"),
                ticket=ticket,
            )

    arguments: dict[str, object] = {"despite": despite} if despite else {}
    return await run_flight_command(station, principal, "arm", v, arguments, work)


@router.post("/{v}/disarm", response_model=responses.CommandDone, tags=["commands"])
async def disarm(v: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Stops the motors on the ground."""
    return await run_flight_command(
        station,
        principal,
        "disarm",
        v,
        {},
        lambda vehicle, ticket: vehicle.command.disarm(
            progress=progress_reporter(vehicle, principal, "disarm"), ticket=ticket
        ),
    )


@router.post("/{v}/hold", response_model=responses.CommandDone, tags=["commands"])
async def hold(v: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Switches to Hold, even if another client has control; ends a setpoint stream. While the connection to
    the vehicle is lost, the command is sent for 6 s, because the vehicle may still receive it.
    """
    return await run_flight_command(
        station,
        principal,
        "hold",
        v,
        {},
        lambda vehicle, ticket: vehicle.command.hold(
            by=principal.name,
            progress=progress_reporter(vehicle, principal, "hold"),
            ticket=ticket,
            on_lost_link=True,
        ),
    )


@router.post("/{v}/land", response_model=responses.CommandDone, tags=["commands"])
async def land(v: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Lands at the current position; answers once the vehicle is landing."""
    return await run_flight_command(
        station,
        principal,
        "land",
        v,
        {},
        lambda vehicle, ticket: vehicle.command.land(
            by=principal.name, progress=progress_reporter(vehicle, principal, "land"), ticket=ticket
        ),
    )


@router.post("/{v}/rtl", response_model=responses.CommandDone, tags=["commands"])
async def rtl(v: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Returns to the launch position; answers once the vehicle is returning."""
    return await run_flight_command(
        station,
        principal,
        "rtl",
        v,
        {},
        lambda vehicle, ticket: vehicle.command.rtl(
            by=principal.name, progress=progress_reporter(vehicle, principal, "rtl"), ticket=ticket
        ),
    )


@router.post("/{v}/takeoff", response_model=responses.CommandDone, tags=["commands"])
async def takeoff(
    v: str, body: models.TakeoffRequest, station: StationDep, principal: PrincipalDep
) -> Response:
    """Arms if needed and takes off; answers once the vehicle is taking off."""
    return await run_flight_command(
        station,
        principal,
        "takeoff",
        v,
        body.model_dump(),
        lambda vehicle, ticket: vehicle.command.takeoff(
            body.alt_home_m,
            by=principal.name,
            progress=progress_reporter(vehicle, principal, "takeoff"),
            ticket=ticket,
        ),
    )


@router.post("/{v}/mode", response_model=responses.CommandDone, tags=["commands"])
async def mode(v: str, body: models.ModeRequest, station: StationDep, principal: PrincipalDep) -> Response:
    """Changes the flight mode; answers once the vehicle reports the new mode. The mode Mission is checked as
    `mission/start`: 409 `plan_findings`, unless `despite` names the codes."""

    async def work(vehicle: Vehicle, ticket: Ticket) -> None:
        request = StartRequest(despite=body.despite)
        check = checked_start(station, vehicle, request, ticket, principal.name)
        async with check if body.mode == "mission" else nullcontext():
            await vehicle.command.set_mode(
                body.mode,
                by=principal.name,
                progress=progress_reporter(vehicle, principal, "mode"),
                ticket=ticket,
            )

    arguments = body.model_dump(exclude_defaults=True)
    ends_with_caller = body.mode not in ENDING_MODES
    return await run_flight_command(
        station, principal, "mode", v, arguments, work, ends_with_caller=ends_with_caller
    )


@router.post("/{v}/goto", response_model=responses.CommandDone, tags=["commands"])
async def goto(v: str, body: models.GotoRequest, station: StationDep, principal: PrincipalDep) -> Response:
    """In Hold mode, flies to a position; answers once the vehicle has accepted the target.

    A target below home, or where elevation data show the ground, below that ground, by more than the
    vehicle's landing height (MPC_LAND_ALT3) is refused.
    """
    with suppress(UnknownVehicle):  # reported by the command
        await station.known_ground.read_around(station.fleet.get(v), body.lat_deg, body.lon_deg)

    async def work(vehicle: Vehicle, ticket: Ticket) -> None:
        await vehicle.command.goto(
            body.lat_deg,
            body.lon_deg,
            alt_amsl_m=body.alt_amsl_m,
            alt_home_m=body.alt_home_m,
            yaw_ned_deg=body.yaw_ned_deg,
            max_distance_m=GOTO_MAX_DISTANCE_M if body.max_distance_m is None else body.max_distance_m,
            by=principal.name,
            progress=progress_reporter(vehicle, principal, "goto"),
            ticket=ticket,
        )

    return await run_flight_command(station, principal, "goto", v, body.model_dump(exclude_none=True), work)


@router.post("/{v}/land_now", response_model=responses.CommandDone, tags=["commands"])
async def land_now(
    v: str, body: control_models.LandNowRequest, station: StationDep, principal: PrincipalDep
) -> Response:
    """Lands at the current position, even if another client has control; answers once the vehicle is landing.
    Control does not change. While the connection to the vehicle is lost, the command is sent for 6 s, because
    the vehicle may still receive it.
    """

    async def work(vehicle: Vehicle, ticket: Ticket) -> None:
        BY_NAME["land_now"].require_confirmation(body.confirm, vehicle=v)
        await vehicle.command.land(
            by=principal.name,
            progress=progress_reporter(vehicle, principal, "land_now"),
            ticket=ticket,
            on_lost_link=True,
        )

    return await run_flight_command(station, principal, "land_now", v, body.model_dump(), work)


@router.post("/{v}/kill", response_model=responses.CommandDone, tags=["commands"])
async def kill(v: str, body: models.KillRequest, station: StationDep, principal: PrincipalDep) -> Response:
    """Stops the motors immediately, even in flight and even if another client has control: the vehicle falls.
    The command is repeated until the vehicle reports that it is disarmed, for at most 6 s. All other commands
    are refused during this time.
    """

    async def work(vehicle: Vehicle, ticket: Ticket) -> None:
        BY_NAME["kill"].require_confirmation(body.confirm, vehicle=v)
        await vehicle.command.kill(
            by=principal.name, progress=progress_reporter(vehicle, principal, "kill"), ticket=ticket
        )

    return await run_flight_command(station, principal, "kill", v, body.model_dump(), work)
