"""Routes that show vehicles; their commands are in `command_routes.py`."""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import Query, Response

from gcs_server.api import responses
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import StationDep, VehicleDep
from gcs_server.control.accepted import authorized_command
from gcs_server.errors import InvalidRequest
from gcs_server.vehicle.samples import TOPICS, Sample

HISTORY_S = 300.0

router = Routes(prefix="/vehicles", tags=["vehicles"], responses=RESPONSES)


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
