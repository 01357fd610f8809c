"""Routes of groups of vehicles in Offboard; commanding a group needs control of every member."""

from __future__ import annotations

from collections.abc import Generator, Iterable
from contextlib import ExitStack, contextmanager, suppress
from typing import Any

from fastapi import Response

from gcs_server.api import group_models as models
from gcs_server.api.authorized import as_operation
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.responses import fields_of, json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import Station, StationDep
from gcs_server.control.accepted import AcceptedCommand, authorized_command
from gcs_server.control.principal import Principal
from gcs_server.errors import GcsError, InvalidRequest, UnknownVehicle
from gcs_server.vehicle.tickets import Ticket

router = Routes(prefix="/groups", tags=["groups"], responses=RESPONSES)


@router.post("", response_model=models.GroupStarted, status_code=201)
async def start(body: models.StartGroup, station: StationDep, principal: PrincipalDep) -> Response:
    """Switches all flying members to Offboard at their positions, then starts them together.

    Answers with the common start time (`start_unix_s`) when all have confirmed. If a member refuses, does not
    confirm, or would come too close to another, no member moves and all are put into Hold (409 `not_together`
    with their ids). `limits` contains each member's limits, and whether the operator's limits were restored
    after a restart.
    """
    shared = body.model_dump(exclude={"members"}, exclude_none=True)
    arguments = {member.vehicle: {**member.arguments(), **shared} for member in body.members}
    with authorized_commands(station, principal, "group/start", arguments) as accepted:
        tickets = tickets_of(accepted)
        status = await as_operation(
            station,
            principal,
            "group/start",
            tuple(tickets.values()),
            lambda: station.flights.groups.start(body.to_group_request(principal), tickets),
            vehicle_id=None,
        )
        limits = {vehicle: station.offboard(vehicle).limits() for vehicle in arguments}
        return json_response(fields_of(status) | {"limits": limits}, status_code=201)


@router.get("", response_model=models.GroupList)
async def show_all(station: StationDep) -> Response:
    """All groups, including groups that ended recently."""
    return json_response({"groups": station.flights.groups.all()})


@router.get("/{g}", response_model=models.GroupModel)
async def show(g: str, station: StationDep) -> Response:
    """State of a group: its members, the closest pair, and its findings."""
    return json_response(station.flights.groups.get(g))


@router.post("/{g}/setpoints", response_model=models.GroupModel)
async def setpoints(
    g: str, body: models.GroupSetpoints, station: StationDep, principal: PrincipalDep
) -> Response:
    """Sends new setpoints to some or all members at the same time; refused if two members would come too
    close."""
    members = station.flights.groups.members(g)
    for index, member in enumerate(body.setpoints):
        if member.vehicle not in members:
            field = f"setpoints.{index}.vehicle"
            raise InvalidRequest(field, f"{field}: vehicle {member.vehicle} is not in group {g}.")
    setpoint_arguments = {member.vehicle: member.arguments() for member in body.setpoints}
    arguments: dict[str, dict[str, Any]] = {
        vehicle: {"group": g, "valid_for_s": body.valid_for_s, **setpoint_arguments.get(vehicle, {})}
        for vehicle in members
    }
    with authorized_commands(station, principal, "offboard/setpoint", arguments):
        setpoints_by_vehicle = {member.vehicle: member.setpoint for member in body.setpoints}
        status = await station.flights.groups.setpoints(
            g, setpoints_by_vehicle, body.valid_for_s, body.expiry(), principal.name, principal.key
        )
        return json_response(status)


@router.post("/{g}/hold", response_model=models.GroupModel)
async def hold(g: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Puts all members into Hold immediately; does not require control. A vehicle that has left the group is
    not affected."""
    with authorized_commands(
        station, principal, "hold", {v: {"group": g} for v in station.flights.groups.members(g)}
    ) as accepted:
        return json_response(await station.flights.groups.hold(g, principal.name, tickets_of(accepted)))


def tickets_of(accepted: dict[str, AcceptedCommand]) -> dict[str, Ticket]:
    """The ticket of each vehicle."""
    return {vehicle_id: each.ticket for vehicle_id, each in accepted.items()}


@contextmanager
def authorized_commands(
    station: Station, principal: Principal, command: str, arguments: dict[str, dict[str, Any]]
) -> Generator[dict[str, AcceptedCommand]]:
    """Wraps a command to several vehicles and writes a journal line for each vehicle; yields the accepted
    command of each. If the command is refused for one vehicle, it is refused for all, and the client does not
    take control of any.

    Raises:
        NotInControl: another client has control of a member; the error names the member.
        UnknownVehicle: a member is not known.
    """
    refusal = _unknown_vehicle(station, arguments) or station.authority.refusal(principal, command, arguments)
    accepted: dict[str, AcceptedCommand] = {}
    with ExitStack() as stack:
        for vehicle_id, vehicle_arguments in arguments.items():
            vehicle_command = authorized_command(
                station, principal, command, vehicle_id, vehicle_arguments, refusal=refusal
            )
            if refusal is None:
                accepted[vehicle_id] = stack.enter_context(vehicle_command)
            else:
                with suppress(GcsError), vehicle_command:
                    pass
        if refusal is not None:
            raise refusal
        yield accepted


def _unknown_vehicle(station: Station, vehicle_ids: Iterable[str]) -> UnknownVehicle | None:
    for vehicle_id in vehicle_ids:
        try:
            station.fleet.get(vehicle_id)
        except UnknownVehicle as error:
            return error
    return None
