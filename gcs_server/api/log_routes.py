"""Routes of the flight logs on a vehicle: list, download as an operation, and the downloaded file."""

from __future__ import annotations

import asyncio
import contextlib
from dataclasses import asdict
from pathlib import Path

from fastapi import Response
from fastapi.responses import FileResponse

from gcs_server.api.authorized import authorized_command
from gcs_server.api.operation_routes import OperationModel, operation_view
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import Station, StationDep, VehicleDep
from gcs_server.api.strict_body import ResponseBody
from gcs_server.errors import InvalidRequest, LogUnusable
from gcs_server.operations.operations import ReportProgress
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
    downloaded: DownloadedLog | None
    """The file on the server; null: not downloaded."""


class LogList(ResponseBody):
    """The logs on a vehicle."""

    logs: list[LogView]
    """The oldest first; numbers are in another order, that of the vehicle's files."""


def _file_name(vehicle: Vehicle, log: FlightLog) -> str:
    vehicle_id = vehicle.id.replace("~", "-")
    return f"vehicle-{vehicle_id}-{log.ended_unix_s or 0:.0f}-{log.number}-{log.size_bytes}.ulg"


async def _found(station: Station, vehicle: Vehicle, log: FlightLog) -> dict[str, str] | None:
    name = _file_name(vehicle, log)
    path = await asyncio.to_thread(station.logbook.library.downloaded_path, name)
    return None if path is None else await _downloaded(station, path)


async def _downloaded(station: Station, path: Path) -> dict[str, str]:
    return {"file": path.name, "flight": await station.logbook.id_of(path)}


@router.get("", response_model=LogList)
async def list_logs(vehicle: VehicleDep, station: StationDep) -> Response:
    """Asks the vehicle for its logs; refused while it is armed."""
    logs = await vehicle.service(LogService).list()
    return json_response(
        {"logs": [asdict(log) | {"downloaded": await _found(station, vehicle, log)} for log in logs]}
    )


@router.post(
    "/{number}/download",
    status_code=202,
    response_model=OperationModel,
    responses={202: {"model": OperationModel, "description": "The log is being downloaded."}},
)
async def download(v: str, number: int, station: StationDep, principal: PrincipalDep) -> Response:
    """Downloads a log to the server, and reads it: an operation, which can be followed and cancelled. Its
    result has the `file` for `GET …/logs/{file}` and the id `flight` for `GET /flights/{f}`. Refused while
    the vehicle is armed; ends when it is armed."""
    with authorized_command(station, principal, "logs/download", v, {"number": number}):
        vehicle = station.fleet.get(v)
        service = vehicle.service(LogService)
        vehicle.require("files")

        async def work(report: ReportProgress) -> dict[str, object]:
            logs = {log.number: log for log in await service.list()}
            if (log := logs.get(number)) is None:
                raise InvalidRequest("number", f"Vehicle {v} has no log {number}.", remedy="List its logs.")

            def progress(received: int, size: int) -> None:
                report(
                    f"{received / 1e6:.1f} of {size / 1e6:.1f} MB received.", received / size if size else 1.0
                )

            content = await service.download(log, progress)
            name = _file_name(vehicle, log)
            path = await asyncio.to_thread(station.logbook.library.write_downloaded, name, content)
            downloaded = await _downloaded(station, path)
            report("Received. The log is being read.", 1.0)
            with contextlib.suppress(LogUnusable):  # the list of flights then says why
                await station.logbook.overview(downloaded["flight"])
            return {**downloaded, "size_bytes": len(content)}

        operation = station.operations.start(
            "logs/download",
            work,
            text=f"Downloading log {number} of vehicle {v}.",
            vehicle=v,
            subject=str(number),
            by=(principal.name, principal.key),
            needs_vehicle=True,
        )
    return json_response(operation_view(operation), 202)


@router.get("/{file}", response_class=FileResponse)
async def log_file(v: str, file: str, station: StationDep) -> Response:
    """A downloaded log (ULog)."""
    path = await asyncio.to_thread(station.logbook.library.downloaded_path, file)
    if path is None:
        raise InvalidRequest("file", f"The server has no log {file!r}.", remedy="Download it first.")
    return FileResponse(path, media_type="application/octet-stream", filename=file)
