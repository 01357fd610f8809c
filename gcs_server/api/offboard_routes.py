"""The setpoint stream of a vehicle."""

from __future__ import annotations

from typing import Any

from fastapi import Response

from gcs_server.api import offboard_models as models
from gcs_server.api.authorized import as_operation, progress_reporter
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.responses import fields_of, json_response
from gcs_server.api.routes import Routes
from gcs_server.api.setpoints import SetpointRequest, StartRequest, apply_setpoint
from gcs_server.api.station import OffboardDep, StationDep
from gcs_server.control.accepted import authorized_command

router = Routes(prefix="/vehicles/{v}/offboard", tags=["offboard"], responses=RESPONSES)


@router.get("", response_model=models.OffboardView)
async def show(offboard: OffboardDep) -> Response:
    """The stream and its health, available setpoint types, limits, and the vehicle's failsafe."""
    await offboard.ensure_parameters()
    view: dict[str, Any] = fields_of(offboard.status())
    view |= {
        "available": offboard.available(),
        "limits": offboard.limits(),
        "failsafe": offboard.failsafe(),
    }
    return json_response(view)


@router.post("/start", response_model=models.OffboardStarted)
async def start(v: str, body: StartRequest, station: StationDep, principal: PrincipalDep) -> Response:
    """Streams the setpoint, requests Offboard, and answers once the vehicle reports it.

    Over ROS 2, a vehicle that has just connected reports its topics' layouts and its estimates one after the
    other: for up to 10 s the start waits for them, and then refuses with what is missing.

    In the response, `if_stream_stops` is the vehicle's own action if the stream stops. `limits` contains the
    limits, and whether the operator's limits were restored after a restart.
    """
    with authorized_command(station, principal, "offboard/start", v, body.arguments()) as accepted:
        offboard = station.offboard(v)
        ticket, request = accepted.ticket, body.to_stream_request(principal)
        progress = progress_reporter(offboard.vehicle, principal, "offboard/start")
        status = await as_operation(
            station,
            principal,
            "offboard/start",
            (ticket,),
            lambda: offboard.start(request, body.rate_hz, ticket=ticket, progress=progress),
            vehicle_id=v,
        )
        return json_response(fields_of(status) | {"limits": offboard.limits()})


@router.post("/setpoint", response_model=models.OffboardModel)
async def setpoint(v: str, body: SetpointRequest, station: StationDep, principal: PrincipalDep) -> Response:
    """Replaces the setpoint of a running stream and sends the new one immediately; refused (409) if no stream
    is running."""
    return json_response(await apply_setpoint(station, principal, v, body))


@router.post("/stop", response_model=models.OffboardModel)
async def stop(v: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Puts the vehicle into Hold, waits for its confirmation, then stops the stream. Does nothing if no
    stream is running."""
    with authorized_command(station, principal, "offboard/stop", v, {}) as accepted:
        return json_response(await station.offboard(v).stop(accepted.ticket))


@router.get("/limits", response_model=models.LimitsModel)
async def show_limits(offboard: OffboardDep) -> Response:
    """Limits of setpoints: the vehicle's own, and the operator's."""
    await offboard.ensure_parameters()
    return json_response(offboard.limits())


@router.put("/limits", response_model=models.LimitsModel)
async def set_limits(
    v: str, body: models.LimitsRequest, station: StationDep, principal: PrincipalDep
) -> Response:
    """Replaces the operator's limits, also for a running stream; an omitted field means no limit. The server
    stores them for this vehicle across restarts; `origin.kept` and `origin.warning` say whether this worked.
    """
    with authorized_command(station, principal, "offboard/limits", v, body.model_dump(exclude_none=True)):
        offboard = station.offboard(v)
        # The limits apply before they are stored.
        await offboard.operator_limits.set(body.to_limits(), by=principal.name)
        await offboard.ensure_parameters()
        return json_response(offboard.limits())


@router.put("/avoidance", response_model=models.OffboardModel)
async def set_avoidance(
    v: str, body: models.AvoidanceRequest, station: StationDep, principal: PrincipalDep
) -> Response:
    """Switches obstacle avoidance on or off, also in flight; refused (409) if no sensor measures obstacles.

    Avoidance acts on setpoints with a position (position, trajectory, path, follow). It stays on until it is
    switched off or the server is shut down. The obstacle brake is a separate limit.
    """
    with authorized_command(station, principal, "offboard/avoidance", v, body.model_dump()):
        offboard = station.offboard(v)
        if body.on:
            await offboard.avoidance.switch_on(body.way)
        else:
            offboard.avoidance.switch_off()
        return json_response(offboard.status())


@router.put("/failsafe", response_model=models.FailsafeModel)
async def set_failsafe(
    v: str, body: models.FailsafeRequest, station: StationDep, principal: PrincipalDep
) -> Response:
    """Sets the vehicle's own action when the stream stops; each parameter is verified."""
    with authorized_command(station, principal, "offboard/failsafe", v, body.model_dump(exclude_none=True)):
        offboard = station.offboard(v)
        offboard.vehicle.require_commandable()
        return json_response(await offboard.set_failsafe(body.action, body.after_s))
