"""Routes of commands to a vehicle. A command that only calls one function of the vehicle is a row of `PLAIN`;
those that check more have a route of their own."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from enum import Enum
from inspect import Parameter, Signature
from types import MappingProxyType, NoneType
from typing import Annotated, Any, Generic, TypeVar

from fastapi import Body, Query, Response

from gcs_server.api import control_models, models, responses
from gcs_server.api.authorized import as_operation, progress_reporter
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import Station, StationDep, VehicleDep
from gcs_server.control.accepted import AcceptedCommand, authorized_command
from gcs_server.control.commands import BY_NAME
from gcs_server.control.principal import Principal
from gcs_server.errors import UnknownVehicle
from gcs_server.flights.waypoint_start import WaypointStart, checked_start
from gcs_server.vehicle.services.camera import CameraService
from gcs_server.vehicle.services.command import ARMING_STARTS_FLIGHT, CommandOptions
from gcs_server.vehicle.services.gimbal import GimbalService
from gcs_server.vehicle.services.guided import MAX_DISTANCE_M
from gcs_server.vehicle.tickets import Ticket
from gcs_server.vehicle.vehicle import Vehicle

ENDING_MODES = frozenset({"hold", "land", "rtl"})
"""Modes that end a flight: the command is completed, even if its caller closes the connection."""

router = Routes(prefix="/vehicles", responses=RESPONSES)
TAGS: list[str | Enum] = ["vehicles", "commands"]


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


def command_options(
    vehicle: Vehicle, principal: Principal, command: str, ticket: Ticket | None
) -> CommandOptions:
    """The caller, the progress for all telemetry clients, and the ticket of a command."""
    progress = progress_reporter(vehicle, principal, command)
    return {"by": principal.name, "progress": progress, "ticket": ticket}


@router.post("/{v}/arm", response_model=responses.CommandDone, tags=TAGS)
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
        choice = WaypointStart(despite=[code for code in despite if code != ARMING_STARTS_FLIGHT])
        check = checked_start(station.flights, vehicle, choice, ticket, principal.name)
        async with check if in_mission else nullcontext():
            await vehicle.command.arm(
                starts_flight=starts_flight, **command_options(vehicle, principal, "arm", ticket)
            )

    arguments: dict[str, object] = {"despite": despite} if despite else {}
    return await run_flight_command(station, principal, "arm", v, arguments, work)


@router.post("/{v}/mode", response_model=responses.CommandDone, tags=TAGS)
async def mode(v: str, body: models.ModeRequest, station: StationDep, principal: PrincipalDep) -> Response:
    """Changes the flight mode; answers once the vehicle reports the new mode. The mode Mission is checked as
    `mission/start`: 409 `plan_findings`, unless `despite` names the codes."""

    async def work(vehicle: Vehicle, ticket: Ticket) -> None:
        choice = WaypointStart(despite=body.despite)
        check = checked_start(station.flights, vehicle, choice, ticket, principal.name)
        async with check if body.mode == "mission" else nullcontext():
            await vehicle.command.set_mode(body.mode, **command_options(vehicle, principal, "mode", ticket))

    arguments = body.model_dump(exclude_defaults=True)
    ends_with_caller = body.mode not in ENDING_MODES
    return await run_flight_command(
        station, principal, "mode", v, arguments, work, ends_with_caller=ends_with_caller
    )


async def read_ground(station: Station, v: str, lat_deg: float, lon_deg: float) -> None:
    """Reads the ground around a target, with which the command compares it."""
    with suppress(UnknownVehicle):  # reported by the command
        await station.flights.known_ground.read_around(station.fleet.get(v), lat_deg, lon_deg)


@router.post("/{v}/goto", response_model=responses.CommandDone, tags=TAGS)
async def goto(v: str, body: models.GotoRequest, station: StationDep, principal: PrincipalDep) -> Response:
    """In Hold mode, flies to a position; answers once the vehicle has accepted the target.

    A target below home, or where elevation data show the ground, below that ground, by more than the
    vehicle's landing height (MPC_LAND_ALT3) is refused; so is a speed above MPC_XY_VEL_MAX.
    """
    await read_ground(station, v, body.lat_deg, body.lon_deg)

    async def work(vehicle: Vehicle, ticket: Ticket) -> None:
        options = command_options(vehicle, principal, "goto", ticket)
        await vehicle.guided.goto(**body.model_dump(exclude_none=True), **options)

    return await run_flight_command(station, principal, "goto", v, body.model_dump(exclude_none=True), work)


@router.post("/{v}/orbit", response_model=responses.CommandDone, tags=TAGS)
async def orbit(v: str, body: models.OrbitRequest, station: StationDep, principal: PrincipalDep) -> Response:
    """Circles around a point until another command; answers once the vehicle reports this circle, before it
    has reached it. The topic `orbit` shows the circle.

    Refused are a radius beyond MC_ORBIT_RAD_MAX, a speed that PX4 would limit, and a circle below home or the
    known ground.
    """
    await read_ground(station, v, body.lat_deg, body.lon_deg)

    async def work(vehicle: Vehicle, ticket: Ticket) -> None:
        options = command_options(vehicle, principal, "orbit", ticket)
        await vehicle.guided.orbit(**body.model_dump(exclude_none=True), **options)

    return await run_flight_command(station, principal, "orbit", v, body.model_dump(exclude_none=True), work)


@router.post("/{v}/home", response_model=responses.CommandDone, tags=TAGS)
async def home(v: str, body: models.HomeRequest, station: StationDep, principal: PrincipalDep) -> Response:
    """Sets home, to which Return flies and to which altitudes above home refer; answers once the vehicle
    reports it. PX4 sets home again at the next arming.

    Refused while the server streams setpoints or flies a mission, and in Mission and Return: their altitudes
    and target would move.
    """
    if body.lat_deg is not None and body.lon_deg is not None:
        await read_ground(station, v, body.lat_deg, body.lon_deg)

    async def work(vehicle: Vehicle) -> None:
        place = None
        if body.lat_deg is not None and body.lon_deg is not None:
            place = (body.lat_deg, body.lon_deg, body.alt_amsl_m)
        await vehicle.guided.set_home(
            place,
            max_distance_m=MAX_DISTANCE_M if body.max_distance_m is None else body.max_distance_m,
            progress=progress_reporter(vehicle, principal, "home"),
        )

    arguments = body.model_dump(exclude_defaults=True)
    return await run_command(station, principal, "home", v, arguments, work)


# --- the table of plain commands ----------------------------------------------------------------------


GimbalComponent = Annotated[
    int | None,
    Query(
        ge=1,
        le=255,
        description="MAVLink component id of the gimbal manager; default: the first gimbal manager.",
    ),
]
GimbalDevice = Annotated[
    int | None,
    Query(ge=1, le=255, description="Gimbal device id, if the gimbal manager has several gimbals."),
]
CameraComponent = Annotated[
    int | None,
    Query(
        ge=1, le=255, description="MAVLink component id of the camera; default: the lowest that is connected."
    ),
]


@router.get("/{v}/gimbal", response_model=responses.GimbalView, tags=["gimbal"])
async def show(
    vehicle: VehicleDep,
    station: StationDep,
    component: GimbalComponent = None,
    device: GimbalDevice = None,
) -> Response:
    """State and limits of the gimbal, and the component that controls it."""
    service = vehicle.gimbals.service_for(component, device)
    gimbal = service.reading()
    return json_response(
        {
            "vehicle": vehicle.id,
            "available": gimbal is not None,
            "in_control": gimbal is not None and gimbal.primary_control == station.mavlink_ids,
            "roi": service.roi,
            "gimbal": gimbal,
        }
    )


GIMBAL = {"component": GimbalComponent, "device": GimbalDevice}
CAMERA = {"component": CameraComponent}
B = TypeVar("B")


@dataclass(frozen=True, slots=True)
class Given(Generic[B]):
    """What a plain command is called with."""

    vehicle: Vehicle
    body: B
    component: int | None
    """MAVLink component id that the query selects; None: the first."""
    device: int | None
    options: CommandOptions

    @property
    def options_on_lost_link(self) -> CommandOptions:
        """`options`, for a command that is also sent while the connection is lost."""
        return {**self.options, "on_lost_link": True}

    @property
    def gimbal(self) -> GimbalService:
        """The selected gimbal.

        Raises:
            InvalidRequest: the vehicle has no such gimbal.
        """
        return self.vehicle.gimbals.service_for(self.component, self.device)


CALLED_EITHER_WAY = Parameter.POSITIONAL_OR_KEYWORD
COMMAND_OF: dict[Callable[..., object], str] = {}
"""Name of the command of each route made by `plain_command`."""


def plain_command(
    name: str,
    body_type: type[B],
    run: Callable[[Given[B]], Awaitable[object]],
    doc: str,
    *,
    part: Mapping[str, Any] = MappingProxyType({}),
    result_as: str | None = None,
    response: type = responses.CommandDone,
) -> Callable[..., Awaitable[Response]]:
    """Adds and returns the route of a command that only calls one function: `POST /vehicles/{v}/{name}`.

    Args:
        name: the command's row in `control/commands.py`, which also says whether `body.confirm` is checked.
        body_type: of the request's body; NoneType: no body.
        run: calls the function.
        doc: for the API reference.
        part: types of the query's optional parameters, which select a part of the vehicle.
        result_as: name of the response's field for the result of `run`.
        response: model of the response.
    """
    command = BY_NAME[name]
    body = {} if body_type is NoneType else {"body": body_type}
    types: dict[str, Any] = {"v": str, **body, "station": StationDep, "principal": PrincipalDep}
    parameters = [Parameter(key, CALLED_EITHER_WAY, annotation=value) for key, value in types.items()]
    parameters += [Parameter(key, CALLED_EITHER_WAY, annotation=part[key], default=None) for key in part]
    signature = Signature(parameters)

    async def route(*positional: Any, **by_name: Any) -> Response:
        given = signature.bind(*positional, **by_name).arguments
        v: str = given["v"]
        station: Station = given["station"]
        principal: Principal = given["principal"]
        body: Any = given.get("body")

        async def work(vehicle: Vehicle, ticket: Ticket | None = None) -> object:
            if command.confirm_text is not None:
                command.require_confirmation(body.confirm, vehicle=v)
            options = command_options(vehicle, principal, name, ticket)
            return await run(Given(vehicle, body, given.get("component"), given.get("device"), options))

        arguments: dict[str, object] = {} if body is None else body.model_dump(exclude_none=True)
        arguments |= {key: given[key] for key in part if given.get(key) is not None}
        if command.acts == "no":
            return await run_command(station, principal, name, v, arguments, work, result_as=result_as)
        return await run_flight_command(station, principal, name, v, arguments, work)

    route.__signature__ = signature  # pyright: ignore[reportFunctionMemberAccess]
    route.__name__ = "_".join(reversed(name.split("/")[1:])) or name
    route.__doc__ = doc
    tags: list[str | Enum] = [name.split("/")[0]] if "/" in name else TAGS
    COMMAND_OF[route] = name
    return router.post(f"/{{v}}/{name}", response_model=response, tags=tags)(route)


disarm = plain_command(
    "disarm", NoneType, lambda g: g.vehicle.command.disarm(**g.options), "Stops the motors on the ground."
)
hold = plain_command(
    "hold",
    NoneType,
    lambda g: g.vehicle.command.hold(**g.options_on_lost_link),
    """Switches to Hold, even if another client has control; ends a setpoint stream. While the connection
    to the vehicle is lost, the command is sent for 6 s, because the vehicle may still receive it.""",
)
land = plain_command(
    "land",
    NoneType,
    lambda g: g.vehicle.command.land(**g.options),
    "Lands at the current position; answers once the vehicle is landing.",
)
rtl = plain_command(
    "rtl",
    NoneType,
    lambda g: g.vehicle.command.rtl(**g.options),
    "Returns to the launch position; answers once the vehicle is returning.",
)
altitude = plain_command(
    "altitude",
    models.AltitudeRequest,
    lambda g: g.vehicle.guided.change_altitude(**g.body.model_dump(exclude_none=True), **g.options),
    """Climbs or descends in Hold; a go-to continues at the new altitude. In another mode the vehicle first
    switches to Hold. Answers once the vehicle has the target, before it arrives.""",
)
heading = plain_command(
    "heading",
    models.HeadingRequest,
    lambda g: g.vehicle.guided.change_heading(g.body.yaw_ned_deg, **g.options),
    """Turns to a heading in Hold; in another mode the vehicle first switches to Hold. Answers once the
    vehicle has turned.""",
)
speed = plain_command(
    "speed",
    models.SpeedRequest,
    lambda g: g.vehicle.guided.change_speed(g.body.speed_m_s, **g.options),
    """Changes the ground speed in Hold (go-to) or Mission, until the next change of mode. Answers once the
    vehicle has acknowledged it; PX4 reports no speed.""",
)
takeoff = plain_command(
    "takeoff",
    models.TakeoffRequest,
    lambda g: g.vehicle.command.takeoff(g.body.alt_home_m, **g.options),
    "Arms if needed and takes off; answers once the vehicle is taking off.",
)
land_now = plain_command(
    "land_now",
    control_models.LandNowRequest,
    lambda g: g.vehicle.command.land(**g.options_on_lost_link),
    """Lands at the current position, even if another client has control; answers once the vehicle is
    landing. Control does not change. While the connection to the vehicle is lost, the command is sent for
    6 s, because the vehicle may still receive it.""",
)
kill = plain_command(
    "kill",
    models.KillRequest,
    lambda g: g.vehicle.command.kill(**g.options),
    """Stops the motors immediately, even in flight and even if another client has control: the vehicle
    falls. The command is repeated until the vehicle reports that it is disarmed, for at most 6 s. All
    other commands are refused during this time.""",
)
take_gimbal = plain_command(
    "gimbal/take",
    NoneType,
    lambda g: g.gimbal.take_control(),
    "Takes primary control of the gimbal.",
    part=GIMBAL,
)
release_gimbal = plain_command(
    "gimbal/release",
    NoneType,
    lambda g: g.gimbal.release_control(),
    "Releases gimbal control if this server has it.",
    part=GIMBAL,
)
gimbal_angles = plain_command(
    "gimbal/angles",
    models.GimbalAngles,
    lambda g: g.gimbal.set_angles(
        g.body.pitch_deg,
        g.body.yaw_deg,
        roll_deg=g.body.roll_deg,
        yaw_lock=g.body.yaw_lock,
        wait=g.body.wait,
    ),
    """Points the camera. Answers once the gimbal has reached the angles or stopped; `limited` is the
    angle at which a limit stopped the gimbal.

    Without `wait`, answers once the vehicle has acknowledged.""",
    part=GIMBAL,
    result_as="limited",
    response=responses.GimbalPointed,
)
gimbal_rates = plain_command(
    "gimbal/rates",
    models.GimbalRates,
    lambda g: g.gimbal.set_rates(g.body.pitch_rate_deg_s, g.body.yaw_rate_deg_s, yaw_lock=g.body.yaw_lock),
    "Turns the camera at constant rates; zero stops both axes.",
    part=GIMBAL,
)
gimbal_roi = plain_command(
    "gimbal/roi",
    models.GimbalRoi,
    lambda g: g.gimbal.set_roi(g.body.lat_deg, g.body.lon_deg, g.body.alt_amsl_m),
    "Keeps the camera pointed at a location (ROI).",
    part=GIMBAL,
)
clear_gimbal_roi = plain_command(
    "gimbal/roi/clear",
    NoneType,
    lambda g: g.gimbal.clear_roi(),
    "Clears the location (ROI) at which the camera is pointed.",
    part=GIMBAL,
)
picture = plain_command(
    "camera/picture",
    NoneType,
    lambda g: g.vehicle.service(CameraService).take_picture(g.component),
    "Takes one photo; answers once the camera has acknowledged it.",
    part=CAMERA,
)
