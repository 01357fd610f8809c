"""The setpoint stream of a vehicle."""

from __future__ import annotations

from fastapi import APIRouter, Response

from gcs_server.api import models, responses
from gcs_server.api.problems import RESPONSES
from gcs_server.api.responses import answer
from gcs_server.api.station import ClientDep, StationDep, VehicleDep, journaled

router = APIRouter(prefix="/vehicles/{v}/offboard", tags=["offboard"], responses=RESPONSES)


@router.get("", response_model=responses.OffboardModel)
async def show(vehicle: VehicleDep) -> Response:
    """State, rate achieved, setpoint, validity left, and what the vehicle does if the stream stops."""
    return answer(await vehicle.offboard.status_with_failsafe())


@router.post("/start", response_model=responses.OffboardModel)
async def start(v: str, body: models.StartRequest, station: StationDep, client: ClientDep) -> Response:
    """Streams the setpoint, asks for Offboard, and answers once the vehicle reports it.

    `if_stream_stops` of the answer says what the vehicle will do by itself should the stream stop.
    """
    arguments = body.model_dump(exclude_none=True)
    with journaled(station, client, "offboard/start", v, arguments):
        vehicle = station.fleet.get(v)
        order = models.to_order(body.setpoint, body.valid_for_s, body.on_expiry, client)
        return answer(await vehicle.offboard.start(order, body.rate_hz))


@router.post("/setpoint", response_model=responses.OffboardModel)
async def setpoint(v: str, body: models.AnyOrder, station: StationDep, client: ClientDep) -> Response:
    """A new target, sent at once; refused (409) where no stream runs."""
    arguments = body.model_dump(exclude_none=True)
    with journaled(station, client, "offboard/setpoint", v, arguments):
        vehicle = station.fleet.get(v)
        order = models.to_order(body, body.valid_for_s, body.on_expiry, client)
        return answer(vehicle.offboard.setpoint(order))


@router.post("/stop", response_model=responses.OffboardModel)
async def stop(v: str, station: StationDep, client: ClientDep) -> Response:
    """Puts the vehicle into Hold, waits for its own word, then stops; without a stream it does nothing."""
    with journaled(station, client, "offboard/stop", v, {}):
        return answer(await station.fleet.get(v).offboard.stop())
