"""Routes of what happens with a vehicle's log after its flight: nothing, an offer, or a download."""

from __future__ import annotations

from dataclasses import asdict

from fastapi import Response

from gcs_server.api.operation_routes import OperationModel, operation_view
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.reflect import model_of
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import Station, StationDep
from gcs_server.api.strict_body import ResponseBody, StrictBody
from gcs_server.control.accepted import authorized_command
from gcs_server.logbook.after_landing import Choice, LandedLog
from gcs_server.vehicle.services.logs import LogService

router = Routes(tags=["logs"], responses=RESPONSES)

LandedLogView = model_of(LandedLog, "LandedLogView")


class AfterLandingChoice(StrictBody):
    """What happens with a vehicle's log after its flight."""

    choice: Choice
    """`never`: nothing; `offer`: the page offers to download it; `download`: the server downloads it by
    itself, also without a page."""


class AfterLandingView(ResponseBody):
    """What happens with vehicles' logs after their flights."""

    choice: Choice
    """What happens: `never`, `offer` or `download`."""
    landed: dict[str, LandedLogView]  # pyright: ignore[reportInvalidTypeForm]
    """By vehicle id: the log of its newest flight, as `landed_log` in the telemetry."""


@router.get("/logs_after_landing", response_model=AfterLandingView)
async def read_choice(station: StationDep) -> Response:
    """What happens with a vehicle's log after its flight, and the logs of the newest flights."""
    return _view(station)


@router.post("/logs_after_landing", response_model=AfterLandingView)
async def choose(body: AfterLandingChoice, station: StationDep, principal: PrincipalDep) -> Response:
    """Sets what happens with vehicles' logs after their flights; open offers follow it."""
    with authorized_command(station, principal, "logs/after_landing", None, {"choice": body.choice}):
        await station.after_landing.choose(body.choice)
    return _view(station)


@router.post("/vehicles/{v}/logs/after_landing", status_code=202, response_model=OperationModel)
async def download_landed(v: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Downloads the log of the vehicle's newest flight, once the vehicle has closed it: an operation as that
    of `POST …/logs/{number}/download`. Refused if this server has seen no flight since the last offer was
    declined, or while the vehicle is armed."""
    with authorized_command(station, principal, "logs/download", v, {}):
        station.fleet.get(v).service(LogService).require_disarmed()
        operation = station.after_landing.download(v, (principal.name, principal.key))
    return json_response(operation_view(operation), 202)


@router.delete("/vehicles/{v}/logs/after_landing", status_code=204)
async def decline(v: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Declines the offer to download the log of the vehicle's newest flight, for all pages. Cancels the
    download if it runs; what has arrived stays."""
    with authorized_command(station, principal, "logs/decline", v, {}):
        await station.after_landing.drop(station.fleet.get(v).id)
    return Response(status_code=204)


def _view(station: Station) -> Response:
    logs = {vehicle.id: station.after_landing.of(vehicle) for vehicle in station.fleet.all()}
    landed = {vehicle: asdict(log) for vehicle, log in logs.items() if log is not None}
    return json_response({"choice": station.after_landing.choice, "landed": landed})
