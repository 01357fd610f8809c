"""Routes of control: take, request, grant, deny, release; and the caller's identity."""

from __future__ import annotations

from fastapi import Response

from gcs_server.api import control_models as models
from gcs_server.api import responses
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import StationDep
from gcs_server.control.accepted import authorized_command
from gcs_server.control.authority import ControlStatus, VehicleControl
from gcs_server.control.principal import Principal

router = Routes(tags=["control"], responses=RESPONSES)


@router.get("/me", response_model=responses.Me)
async def me(station: StationDep, principal: PrincipalDep) -> Response:
    """The caller's identity on this server, and the vehicles that it controls."""
    return json_response(
        {"name": principal.name, "key": principal.key, "controls": station.authority.controlled_by(principal)}
    )


@router.post("/me/leave", response_model=responses.Me)
async def leave(station: StationDep, principal: PrincipalDep) -> Response:
    """Releases control of all vehicles; their flight does not change."""
    for vehicle_id in station.authority.controlled_by(principal):
        with authorized_command(station, principal, "control/release", vehicle_id, {}):
            station.authority.control(vehicle_id).lease.release(principal)
    return await me(station, principal)


@router.get("/vehicles/{v}/control", response_model=responses.ControlView)
async def show(v: str, station: StationDep, principal: PrincipalDep) -> Response:
    """The client in control and since when, the requests for control, and who set the vehicle's current
    mode."""
    return _view(station.authority.control(v), principal)


@router.post("/vehicles/{v}/control/take", response_model=responses.ControlView)
async def take(
    v: str, station: StationDep, principal: PrincipalDep, body: models.TakeControl | None = None
) -> Response:
    """Takes control if no client has it, or with `force` from the client that has it. A client that can
    answer requests must first be sent a request. The first command to a vehicle without a client in control
    takes control, too.
    """
    options = body or models.TakeControl()
    with authorized_command(station, principal, "control/take", v, options.model_dump(exclude_none=True)):
        control = station.authority.control(v)
        control.lease.take(principal, force=options.force, on_expiry=options.on_expiry)
        return _view(control, principal)


@router.post("/vehicles/{v}/control/request", response_model=responses.ControlView)
async def request(
    v: str, station: StationDep, principal: PrincipalDep, body: models.RequestControl | None = None
) -> Response:
    """Requests control from the client in control; the server shows that client the caller's name and the
    reason. If no client has control, the caller takes control immediately."""
    reason = body.reason if body is not None else None
    with authorized_command(station, principal, "control/request", v, {"reason": reason} if reason else {}):
        control = station.authority.control(v)
        control.lease.request(principal, reason)
        return _view(control, principal)


@router.post("/vehicles/{v}/control/grant", response_model=responses.ControlView)
async def grant(v: str, body: models.AnswerControl, station: StationDep, principal: PrincipalDep) -> Response:
    """Gives control to a client that requested it; the flight does not change."""
    with authorized_command(station, principal, "control/grant", v, body.model_dump(exclude_none=True)):
        control = station.authority.control(v)
        control.lease.grant(principal, body.client)
        return _view(control, principal)


@router.post("/vehicles/{v}/control/deny", response_model=responses.ControlView)
async def deny(v: str, body: models.DenyControl, station: StationDep, principal: PrincipalDep) -> Response:
    """Denies a request for control; the denied client may then take control by force."""
    with authorized_command(station, principal, "control/deny", v, body.model_dump(exclude_none=True)):
        control = station.authority.control(v)
        control.lease.deny(principal, body.client, body.reason)
        return _view(control, principal)


@router.post("/vehicles/{v}/control/release", response_model=responses.ControlView)
async def release(v: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Releases control, or withdraws a request for it. Does nothing if the caller has neither."""
    with authorized_command(station, principal, "control/release", v, {}):
        control = station.authority.control(v)
        control.lease.release(principal)
        return _view(control, principal)


@router.post("/vehicles/{v}/control/renew", response_model=responses.ControlView)
async def renew(v: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Renews the caller's control for another `lease_s`, as every other request does. Does not take
    control."""
    return _view(station.authority.control(v), principal)


def _view(control: VehicleControl, principal: Principal) -> Response:
    status: ControlStatus = control.status()
    return json_response(
        {
            **responses.fields_of(status),
            "yours": status.holder_key == principal.key,
            "your_key": principal.key,
        }
    )
