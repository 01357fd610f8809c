"""Routes of offboard missions that are registered with PX4 as flight modes: list, register, unregister."""

from __future__ import annotations

from fastapi import APIRouter, Response

from gcs_server.api import mission_mode_models as m
from gcs_server.api.authorized import authorized_command
from gcs_server.api.documents import DocumentRoute, UnreadDocument
from gcs_server.api.offboard_mission_routes import chosen_mission, prepared_start, start_conditions
from gcs_server.api.plan_checks import plan_context_of
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.responses import json_response
from gcs_server.api.station import Station, StationDep, VehicleDep
from gcs_server.errors import Refused
from gcs_server.streamer.missions.mode_status import MissionAsMode
from gcs_server.streamer.missions.modes import dds_address
from gcs_server.streamer.missions.preparation import CompileInputs
from gcs_server.streamer.missions.start import Start
from gcs_server.vehicle.samples import GlobalPosition
from gcs_server.vehicle.vehicle import Vehicle

router = APIRouter(
    prefix="/vehicles/{v}/mission_modes",
    tags=["offboard mission"],
    responses=RESPONSES,
    route_class=DocumentRoute,
)


@router.get("", response_model=m.MissionModesView)
async def show_modes(vehicle: VehicleDep, station: StationDep) -> Response:
    """The missions of this server that are registered with PX4 as flight modes."""
    return _view(station, vehicle.id)


@router.post("/register", response_model=m.MissionModesView)
async def register(v: str, body: m.RegisterMode, station: StationDep, principal: PrincipalDep) -> Response:
    """Registers a mission with PX4 as a flight mode; answers when PX4 has accepted the mode.

    A mission whose first step is a take-off begins when the vehicle is armed in the mode, any other mission
    when the mode is selected in the air. At registration, the mission is compiled and checked from the
    vehicle's present position: 409 `plan_findings` if it has error findings that `despite` does not list. A
    mission without a take-off is compiled again when it begins. A mission with a take-off is compiled again
    while the vehicle is disarmed, whenever its position or a setting has changed; PX4 arms in the mode only
    while `ready` is true.
    """
    arguments = body.model_dump(exclude={"mission"}, exclude_none=True)
    with authorized_command(station, principal, "mission_modes/register", v, arguments):
        vehicle = station.fleet.get(v)
        vehicle.require_commandable()
        mission_name, text = await chosen_mission(station, body)
        head = (await UnreadDocument(text).read(station.plan_work, field="mission")).head
        takes_off, despite = head.takes_off, tuple(body.despite)
        deferral_s = body.defer_failsafes_s
        mode = MissionAsMode(body.name, mission_name, text, despite, principal.name, deferral_s, takes_off)
        await station.mission_modes.register(v, mode)
        return _view(station, v)


@router.post("/unregister", response_model=m.MissionModesView)
async def unregister(
    v: str, body: m.UnregisterMode, station: StationDep, principal: PrincipalDep
) -> Response:
    """Removes a mode from PX4; refused while the vehicle flies in it."""
    with authorized_command(station, principal, "mission_modes/unregister", v, body.model_dump()):
        station.mission_modes.unregister(v, body.name)
        return _view(station, v)


async def prepare_mode(station: Station, vehicle_id: str, mode: MissionAsMode) -> Start:
    """The mission of a mode, compiled and checked for the vehicle's present position.

    Raises:
        GcsError: the mission cannot be flown from the present position.
    """
    vehicle = station.fleet.get(vehicle_id)
    overrides = _home_when_armed(vehicle) if mode.takes_off else {"in_air": True}
    return await prepared_start(
        station, vehicle_id, mode.mission, mode.text, mode.despite, mode.client, overrides
    )


def compile_inputs_of(station: Station, vehicle_id: str) -> CompileInputs | None:
    """Position, yaw and settings for a mission that is compiled now; None: no valid position."""
    vehicle = station.fleet.get(vehicle_id)
    try:
        start = start_conditions(vehicle)
    except Refused:
        return None
    context = plan_context_of(station, vehicle)
    settings = (start["origin"], context.parameters, context.reported, context.operator)
    return CompileInputs(start["position_ned_m"], start["yaw_ned_rad"], settings)


def _home_when_armed(vehicle: Vehicle) -> dict[str, float]:
    """The home altitude that PX4 sets when the vehicle is armed: the vehicle's present altitude."""
    position = vehicle.topic("global_position")
    if vehicle.topic("home") is None or position is None or not isinstance(position.value, GlobalPosition):
        return {}
    return {"home_alt_amsl_m": position.value.alt_amsl_m}


def _view(station: Station, vehicle_id: str) -> Response:
    vehicle = station.fleet.get(vehicle_id)
    possible = dds_address(vehicle) is not None
    modes = station.mission_modes.all(vehicle_id)
    return json_response({"vehicle": vehicle_id, "possible": possible, "modes": modes})
