"""Routes of the files on a vehicle: list, get and put as operations, remove, make a folder; and the
downloaded file."""

from __future__ import annotations

import asyncio
import base64
import binascii

from fastapi import Response
from fastapi.responses import FileResponse
from pydantic import Field

from gcs_server.api.operation_routes import OperationModel, operation_view
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.reflect import model_of
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import Station, StationDep, VehicleDep
from gcs_server.api.strict_body import StrictBody
from gcs_server.control.accepted import authorized_command
from gcs_server.control.commands import BY_NAME
from gcs_server.errors import InvalidRequest, Refused
from gcs_server.operations.operations import ReportProgress
from gcs_server.vehicle.services.files import (
    MAX_PATH_BYTES,
    MAX_WRITTEN_BYTES,
    MAX_WRITTEN_PATH_BYTES,
    FileEntry,
    Folder,
    VehicleFiles,
)

router = Routes(prefix="/vehicles/{v}/files", tags=["files"], responses=RESPONSES)

FileEntryModel = model_of(FileEntry, "VehicleFileEntry")
FolderModel = model_of(Folder, "VehicleFolder", entries=tuple[FileEntryModel, ...])
MAX_CONFIRM = MAX_PATH_BYTES + 100


class FilePath(StrictBody):
    """A file or folder on a vehicle."""

    path: str = Field("/", max_length=MAX_PATH_BYTES, examples=["/fs/microsd/etc"])
    """Path as the vehicle's list shows it, at most 200 bytes, without `.` and `..`."""


class RemovedFile(StrictBody):
    """A file or empty folder that is removed from a vehicle."""

    path: str = Field(max_length=MAX_WRITTEN_PATH_BYTES)
    """Its path, at most 110 bytes."""
    confirm: str = Field(max_length=MAX_CONFIRM)
    """Exactly `{path} is removed from vehicle {vehicle}`."""


class WrittenFile(StrictBody):
    """A file that is written to a vehicle."""

    path: str = Field(max_length=MAX_WRITTEN_PATH_BYTES)
    """Its path, at most 110 bytes; the folder exists."""
    content_base64: str = Field(max_length=-(-MAX_WRITTEN_BYTES // 3) * 4)
    """Content, at most 700,000 bytes, as base64."""
    confirm: str = Field(max_length=MAX_CONFIRM)
    """Exactly `{path} is written on vehicle {vehicle}`."""


class NewFolder(StrictBody):
    """A folder that is made on a vehicle."""

    path: str = Field(max_length=MAX_WRITTEN_PATH_BYTES)
    """Its path, at most 110 bytes."""


@router.post("/list", response_model=FolderModel)
async def list_folder(vehicle: VehicleDep, body: FilePath) -> Response:
    """Lists a folder on the vehicle. `danger` says what hangs on a file: `startup` (PX4 runs or reads it as
    it starts), `parameters`, `missions` (mission, fence, rally points), `log`, `firmware` (flashed onto other
    devices), `device` (no file; refused)."""
    return json_response(await vehicle.service(VehicleFiles).list(body.path))


@router.post("/get", status_code=202, response_model=OperationModel)
async def get_file(v: str, body: FilePath, station: StationDep, principal: PrincipalDep) -> Response:
    """Downloads a file to the server: an operation, which can be followed and cancelled.

    It waits while another file or log is downloaded, or up to ten minutes for a lost vehicle; the next one
    continues what an earlier one has received. Its result has the id `file` for `GET …/files/{file}`,
    `name`, `size_bytes` and `verified` (`crc32`: the vehicle's checksum is equal; `size`: it gave none).
    The server keeps the newest hundred files, at most 1 GB. Refused while the vehicle is armed; pauses while
    it is armed later, or takes a plan."""
    with authorized_command(station, principal, "files/get", v, {"path": body.path}):
        station.fleet.get(v).service(VehicleFiles).require_disarmed()

        async def work(report: ReportProgress) -> dict[str, object]:
            return await station.file_downloads.run(v, body.path, report)

        operation = station.operations.start(
            "files/get",
            work,
            text=f"Downloading {body.path} of vehicle {v}.",
            vehicle=v,
            subject=body.path,
            by=(principal.name, principal.key),
        )
    return json_response(operation_view(operation), 202)


@router.post("/put", status_code=202, response_model=OperationModel)
async def put_file(v: str, body: WrittenFile, station: StationDep, principal: PrincipalDep) -> Response:
    """Writes a file to the vehicle: an operation, which can be followed and cancelled. Needs control; refused
    while the vehicle is armed, and ends when it is armed.

    The content is written beside an existing file, compared by its checksum, and then takes its place; what
    ends early leaves the existing file as it was."""
    content = _decoded(body.content_base64)
    arguments: dict[str, object] = {"path": body.path, "size_bytes": len(content), "confirm": body.confirm}
    with authorized_command(station, principal, "files/put", v, arguments):
        BY_NAME["files/put"].require_confirmation(body.confirm, path=body.path, vehicle=v)
        vehicle = station.fleet.get(v)
        files = vehicle.service(VehicleFiles)
        path = files.writable(body.path)
        files.require_disarmed()
        _require_no_other_write(station, v)

        async def work(report: ReportProgress) -> dict[str, object]:
            began_s = vehicle.clock.monotonic_s()

            def progress(written: int, total: int) -> None:
                rate = written / max(vehicle.clock.monotonic_s() - began_s, 0.1)
                text = f"{written / 1e3:.0f} of {total / 1e3:.0f} kB written, {rate / 1e3:.1f} kB/s."
                report(text, written / total if total else 1.0)

            await files.put(path, content, progress)
            return {"path": path, "size_bytes": len(content)}

        operation = station.operations.start(
            "files/put",
            work,
            text=f"Writing {path} to vehicle {v}.",
            vehicle=v,
            subject=path,
            by=(principal.name, principal.key),
            needs_vehicle=True,
        )
    return json_response(operation_view(operation), 202)


@router.post("/remove", status_code=204)
async def remove_file(v: str, body: RemovedFile, station: StationDep, principal: PrincipalDep) -> Response:
    """Removes a file, or an empty folder, from the vehicle. Needs control; refused while the vehicle is
    armed."""
    with authorized_command(
        station, principal, "files/remove", v, {"path": body.path, "confirm": body.confirm}
    ):
        BY_NAME["files/remove"].require_confirmation(body.confirm, path=body.path, vehicle=v)
        await station.fleet.get(v).service(VehicleFiles).remove(body.path)
    return Response(status_code=204)


@router.post("/make_folder", status_code=204)
async def make_folder(v: str, body: NewFolder, station: StationDep, principal: PrincipalDep) -> Response:
    """Makes a folder on the vehicle. Needs control; refused while the vehicle is armed."""
    with authorized_command(station, principal, "files/make_folder", v, {"path": body.path}):
        await station.fleet.get(v).service(VehicleFiles).make_folder(body.path)
    return Response(status_code=204)


@router.get("/{file}", response_class=FileResponse)
async def downloaded_file(v: str, file: str, station: StationDep) -> Response:
    """A file that was downloaded from the vehicle."""
    found = await asyncio.to_thread(station.file_downloads.path_of, v, file)
    if found is None:
        raise InvalidRequest("file", "The server has no such file.", remedy="Download it first.")
    path, name = found
    return FileResponse(path, media_type="application/octet-stream", filename=name)


def _require_no_other_write(station: Station, vehicle_id: str) -> None:
    """An operation that runs is returned instead of a second one, which would have another content."""
    for operation in station.operations.all():
        if (operation.kind, operation.vehicle, operation.state) == ("files/put", vehicle_id, "running"):
            raise Refused(
                f"Another file is being written to vehicle {vehicle_id}.",
                remedy="Wait for its end, or cancel it.",
            )


def _decoded(text: str) -> bytes:
    try:
        return base64.b64decode(text, validate=True)
    except (binascii.Error, ValueError):
        raise InvalidRequest("content_base64", "The content is not base64.") from None
