"""Routes of the flight logs on a vehicle: list, download as an operation, erase; and the downloaded file."""

from __future__ import annotations

import asyncio
from dataclasses import asdict
from functools import partial

from fastapi import Response
from fastapi.responses import FileResponse
from pydantic import Field

from gcs_server.api.operation_routes import OperationModel, operation_view
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import Station, StationDep, VehicleDep
from gcs_server.api.strict_body import ResponseBody, StrictBody
from gcs_server.control.accepted import authorized_command
from gcs_server.control.commands import BY_NAME
from gcs_server.errors import InvalidRequest
from gcs_server.vehicle.services.logs import FlightLog, LogService
from gcs_server.vehicle.vehicle import Vehicle

router = Routes(prefix="/vehicles/{v}/logs", tags=["logs"], responses=RESPONSES)


class DownloadedLog(ResponseBody):
    """A log that was downloaded to the server."""

    file: str
    """Name of the file, for `GET …/logs/{file}`."""
    flight: str
    """Id of the file, for `GET /flights/{f}`."""


class LogView(ResponseBody):
    """A flight log on the vehicle."""

    number: int
    """Number by which the vehicle knows the log; changes when logs are added or deleted."""
    ended_unix_s: float | None
    """Its last change, normally its end [s since 1970 UTC]; null: the vehicle did not know the time."""
    size_bytes: int
    """Size [bytes]."""
    received_bytes: int
    """Size of what an interrupted download has received [bytes]; the next one continues there."""
    downloaded: DownloadedLog | None
    """The file on the server; null: not downloaded."""


class LogList(ResponseBody):
    """The logs on a vehicle."""

    logs: list[LogView]
    """The oldest first; numbers are in another order, that of the vehicle's files."""


class EraseLogs(StrictBody):
    """Confirmation that all logs of a vehicle are erased."""

    confirm: str = Field(max_length=100)
    """Exactly `all logs of vehicle {vehicle} are erased`, with the id of the vehicle."""


async def _found(station: Station, vehicle: Vehicle, log: FlightLog) -> dict[str, object]:
    """What the server has of a log."""
    downloads = station.log_downloads
    path = await asyncio.to_thread(downloads.path_of, vehicle.id, log)
    if path is None:
        received = await asyncio.to_thread(downloads.received_bytes, vehicle.id, log)
        return {"received_bytes": received, "downloaded": None}
    downloaded = {"file": path.name, "flight": await station.logbook.id_of(path)}
    return {"received_bytes": 0, "downloaded": downloaded}


@router.get("", response_model=LogList)
async def list_logs(vehicle: VehicleDep, station: StationDep) -> Response:
    """Asks the vehicle for its logs; refused while it is armed."""
    logs = await vehicle.service(LogService).list()
    return json_response({"logs": [asdict(log) | await _found(station, vehicle, log) for log in logs]})


@router.post(
    "/{number}/download",
    status_code=202,
    response_model=OperationModel,
    responses={202: {"model": OperationModel, "description": "The log is being downloaded."}},
)
async def download(v: str, number: int, station: StationDep, principal: PrincipalDep) -> Response:
    """Downloads a log to the server, and reads it: an operation, which can be followed and cancelled.

    It reads by FTP or LOG_DATA, whichever is faster; waits while another log is downloaded, or up to ten
    minutes for a lost vehicle; and continues what an earlier one has received. Its result has the `file` for
    `GET …/logs/{file}`, the id `flight` for `GET /flights/{f}`, `verified` (`crc32`: the vehicle's checksum
    is equal; `size`: it gave none), and what arrived in each way. Refused while the vehicle is armed; pauses
    while it is armed later, or takes a plan."""
    with authorized_command(station, principal, "logs/download", v, {"number": number}):
        station.fleet.get(v).service(LogService).require_disarmed()
        operation = station.operations.start(
            "logs/download",
            partial(station.log_downloads.run, v, number),
            text=f"Downloading log {number} of vehicle {v}.",
            vehicle=v,
            subject=str(number),
            by=(principal.name, principal.key),
        )
    return json_response(operation_view(operation), 202)


@router.post(
    "/stream",
    status_code=202,
    response_model=OperationModel,
    responses={202: {"model": OperationModel, "description": "The log is being streamed."}},
)
async def start_stream(v: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Streams the vehicle's log while it is written, also in flight: an operation, which says size, rate and
    loss. Needs control.

    The log grows as a file of the flights, which can be opened meanwhile. What is lost on the way is a gap
    (`dropouts`); a lost link is waited for up to two minutes. Ends by `DELETE …/logs/stream`, when it is
    cancelled, or when the vehicle ends it (`ended` in the result says why), and what was received stays. PX4
    streams to one client at a time."""
    with authorized_command(station, principal, "logs/stream", v, {}):
        station.fleet.get(v).require("files")
        operation = station.operations.start(
            "logs/stream",
            partial(station.log_streams.run, v),
            text=f"Asking vehicle {v} to stream its log.",
            vehicle=v,
            by=(principal.name, principal.key),
        )
    return json_response(operation_view(operation), 202)


@router.delete("/stream", status_code=204)
async def stop_stream(v: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Stops the log stream; the operation then ends with its result. If this server streams none, the vehicle
    is told to stop the stream of whoever gets it. Needs control."""
    with authorized_command(station, principal, "logs/stop_stream", v, {}):
        await station.log_streams.stop(v)
    return Response(status_code=204)


@router.post("/erase", status_code=204)
async def erase(v: str, body: EraseLogs, station: StationDep, principal: PrincipalDep) -> Response:
    """Erases all logs on the vehicle. Needs control; refused while the vehicle is armed."""
    with authorized_command(station, principal, "logs/erase", v, {"confirm": body.confirm}):
        BY_NAME["logs/erase"].require_confirmation(body.confirm, vehicle=v)
        await station.fleet.get(v).service(LogService).erase()
    return Response(status_code=204)


@router.get("/{file}", response_class=FileResponse)
async def log_file(v: str, file: str, station: StationDep) -> Response:
    """A downloaded log (ULog)."""
    path = await asyncio.to_thread(station.logbook.library.downloaded_path, file)
    if path is None:
        raise InvalidRequest("file", f"The server has no log {file!r}.", remedy="Download it first.")
    return FileResponse(path, media_type="application/octet-stream", filename=file)
