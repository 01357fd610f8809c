"""Routes of flights: recordings and logs, their overviews and plotted values; adding and deleting files."""

from __future__ import annotations

import asyncio
from functools import partial
from typing import Annotated, Any

from fastapi import Query, Request, Response
from fastapi.responses import FileResponse
from pydantic import Field

from gcs_server.api import flight_models as m
from gcs_server.api.joined_views import joined_view, record_view
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import StationDep
from gcs_server.control.accepted import authorized_command
from gcs_server.control.commands import BY_NAME
from gcs_server.errors import InvalidRequest, LogUnusable, Refused
from gcs_server.logbook.library import LogFile
from gcs_server.logbook.names import kind_of
from gcs_server.logbook.uploads import MAX_PART_BYTES, Upload
from gcs_server.operations.operations import ReportProgress
from gcs_server.replay.catalogue import RecordingInfo
from missions.values import hidden_character

router = Routes(prefix="/flights", tags=["flights"], responses=RESPONSES)

MAX_SERIES = 32
MAX_POINTS = 10_000
_FILE: dict[int | str, dict[str, Any]] = {200: {"content": {"application/octet-stream": {}}}}
_FIELD = (
    "A field, `topic/field` as in the overview (`vehicle_attitude:0/q[0]`), or an expression with fields in "
    "braces: `norm({vehicle_local_position:0/vx}, {vehicle_local_position:0/vy})`. Operators: `+ - * / **` "
    "and comparisons; functions: abs, sqrt, sin, cos, atan2, min, max, degrees, radians, norm, derivative, "
    "and roll, pitch, yaw [°] of a quaternion. Repeated for several."
)


@router.get("", response_model=m.FlightList)
async def list_flights(station: StationDep) -> Response:
    """All flights with the recordings and logs of each, and what was deleted to make room."""
    logbook = station.logbook
    joined, files = await logbook.flights()
    infos = {info.name: info for info in await station.replays.recordings()}
    removed = await asyncio.to_thread(logbook.library.removed)
    streamed = station.log_streams.paths()
    views = [_view(file, infos.get(file.path.name)) for file in files]
    for view, file in zip(views, files, strict=True):
        view["running"] |= file.path in streamed
    views.sort(key=lambda view: view["start_unix_s"] or view["added_unix_s"], reverse=True)
    return json_response(
        {
            "flights": [joined_view(flight) for flight in joined],
            "files": views,
            "total_bytes": sum(file.size_bytes for file in files),
            "max_bytes": logbook.max_bytes,
            "removed": removed,
        }
    )


@router.post("/uploads", status_code=201, response_model=m.UploadView)
async def begin_upload(body: m.NewUpload, station: StationDep, principal: PrincipalDep) -> Response:
    """Begins to add a log from elsewhere (`.ulg`, `.tlog`, `.tlog.gz`, `.mcap`); its bytes follow."""
    with authorized_command(station, principal, "flights/add", None, {"bytes": body.bytes}):
        upload = await _on_disk(station.logbook.uploads.begin, body.name, body.bytes)
    return json_response(_upload_view(upload, None), 201)


@router.post(
    "/uploads/{u}",
    response_model=m.UploadView,
    openapi_extra={
        "requestBody": {
            "required": True,
            "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
        }
    },
)
async def add_part(
    u: str,
    request: Request,
    station: StationDep,
    offset_bytes: Annotated[
        int, Query(ge=0, le=1 << 40, description="Position of the part: what has been received before.")
    ],
) -> Response:
    """Adds the next part of a log, of at most `part_bytes`. The last part gives the id of the flight."""
    upload, path = await _on_disk(station.logbook.uploads.add, u, offset_bytes, await request.body())
    flight = None
    if path is not None:
        flight = await station.logbook.id_of(path)
        await station.logbook.make_room()
    return json_response(_upload_view(upload, flight))


@router.delete("/uploads/{u}", status_code=204)
async def cancel_upload(u: str, station: StationDep) -> Response:
    """Drops an incomplete log."""
    await _on_disk(station.logbook.uploads.cancel, u)
    return Response(status_code=204)


@router.get("/{f}", response_model=m.FlightOverview)
async def show_flight(f: str, station: StationDep, principal: PrincipalDep) -> Response:
    """What a log has: topics and fields, modes, parameters, messages. The first request reads the log, which
    takes seconds, as an operation that can be followed and cancelled. A cancelled operation gives 409."""
    logbook = station.logbook
    if not await logbook.is_read(f):
        file = await logbook.get(f)

        async def read(_: ReportProgress) -> dict[str, object]:
            await logbook.overview(f)
            return {}

        operation = station.operations.start(
            "flights/read",
            read,
            text=f"Reading {file.path.name}.",
            subject=f,
            by=(principal.name, principal.key),
        )
        if (await station.operations.wait(operation.id)).state == "cancelled":
            raise LogUnusable("Reading the log was cancelled.", remedy="Open it again.")
    return Response(await logbook.overview(f), media_type="application/json")


@router.get("/{f}/joined", response_model=m.FlightRecord)
async def show_joined(f: str, station: StationDep) -> Response:
    """A flight, by the id of any of its parts, with what this server noted of it: the plan or program that
    was flown and how it compared, commands to its vehicle, parameters at arming."""
    flight = await station.logbook.flight(f)
    return json_response(await asyncio.to_thread(record_view, flight, station.logbook.joined.notes))


@router.post("/{f}/name", response_model=m.JoinedFlight)
async def name_flight(f: str, body: m.FlightName, station: StationDep, principal: PrincipalDep) -> Response:
    """Names a flight; an empty name takes it away."""
    with authorized_command(station, principal, "flights/name", None, {"flight": f}):
        name = body.name.strip()
        if (hidden := hidden_character(name)) is not None:
            raise InvalidRequest("name", f"The name has the character {hidden}, which is not shown.")
        logbook = station.logbook
        flight = await _on_disk(logbook.joined.set_name, await logbook.files(), f, name or None)
    return json_response(joined_view(flight))


@router.post("/{f}/parts", response_model=m.JoinedFlight)
async def decide_part(f: str, body: m.PartDecision, station: StationDep, principal: PrincipalDep) -> Response:
    """Joins a part of another flight to this one, or separates one of its parts, which is then a flight of
    its own. This decision is kept, whatever comes in later."""
    arguments: dict[str, object] = {"flight": f, **body.model_dump()}
    with authorized_command(station, principal, "flights/join", None, arguments):
        logbook = station.logbook
        decide = partial(logbook.joined.decide, joined=body.joined)
        flight = await _on_disk(decide, await logbook.files(), f, body.part)
    return json_response(joined_view(flight))


@router.get("/{f}/file", response_class=FileResponse, responses=_FILE)
async def flight_file(f: str, station: StationDep) -> Response:
    """The file itself."""
    file = await station.logbook.get(f)
    return FileResponse(file.path, media_type="application/octet-stream", filename=file.path.name)


@router.get("/{f}/series", response_model=m.FlightSeries)
async def flight_series(
    f: str,
    station: StationDep,
    field: Annotated[
        list[Annotated[str, Field(max_length=600)]],
        Query(min_length=1, max_length=MAX_SERIES, description=_FIELD),
    ],
    from_s: Annotated[
        float | None, Query(ge=-1e7, le=1e7, description="Begin of the window [s since the log's start].")
    ] = None,
    to_s: Annotated[float | None, Query(ge=-1e7, le=1e7, description="End of the window.")] = None,
    points: Annotated[
        int, Query(ge=10, le=MAX_POINTS, description="Maximum number of points of each series.")
    ] = 2000,
) -> Response:
    """Values for a plot: of each field all samples of the window, or the extremes of each of many short
    times, so that every peak stays."""
    body = await station.logbook.plot(f, field, from_s, to_s, points)
    return Response(body, media_type="application/json")


@router.get("/{f}/spectrum", response_model=m.FlightSpectrum)
async def flight_spectrum(
    f: str,
    station: StationDep,
    field: Annotated[str, Query(max_length=600, description=_FIELD)],
    from_s: Annotated[
        float | None, Query(ge=-1e7, le=1e7, description="Begin of the window [s since the log's start].")
    ] = None,
    to_s: Annotated[float | None, Query(ge=-1e7, le=1e7, description="End of the window.")] = None,
) -> Response:
    """The spectrum of a value by Welch's method, and its spectrogram: vibration, oscillation, noise."""
    return Response(await station.logbook.spectrum(f, field, from_s, to_s), media_type="application/json")


@router.get("/{f}/findings", response_model=m.FlightFindings)
async def flight_findings(f: str, station: StationDep) -> Response:
    """What a log means: findings in plain sentences, each with its time, the fields that show it, the limit
    and its
    source, and what to do; and what could not be judged, because it is not logged."""
    return Response(await station.logbook.findings(f), media_type="application/json")


@router.delete("/{f}", status_code=204)
async def delete_flight(
    f: str,
    station: StationDep,
    principal: PrincipalDep,
    confirm: Annotated[
        str, Query(max_length=100, description="Exactly `flight {id} is deleted`, with the id of the flight.")
    ] = "",
) -> Response:
    """Deletes a recording or log, by its id, or a flight with the files that have no other flight; refused
    while one of them is being recorded or replayed."""
    with authorized_command(station, principal, "flights/delete", None, {"flight": f, "confirm": confirm}):
        BY_NAME["flights/delete"].require_confirmation(confirm, flight=f)
        await (station.logbook.delete_flight if "-" in f else station.logbook.delete)(f)
    return Response(status_code=204)


async def _on_disk(function: Any, *arguments: object) -> Any:
    try:
        return await asyncio.to_thread(function, *arguments)
    except OSError as error:
        raise Refused(
            f"The server cannot write the log: {error.strerror or error}.",
            remedy="Make room on its disk, then try again.",
        ) from error


def _upload_view(upload: Upload, flight: str | None) -> dict[str, object]:
    return {
        "id": upload.id,
        "received_bytes": upload.received_bytes,
        "part_bytes": MAX_PART_BYTES,
        "flight": flight,
    }


def _view(file: LogFile, info: RecordingInfo | None) -> dict[str, Any]:
    """A row of the list: from what was read of the file, or else from the recording's start and end."""
    summary = file.summary or {}
    view = {
        "id": file.id,
        "name": file.path.name,
        "source": file.source,
        "kind": kind_of(file.path.name),
        "bytes": file.size_bytes,
        "added_unix_s": file.added_unix_s,
        "start_unix_s": summary.get("start_unix_s"),
        "duration_s": summary.get("duration_s"),
        "vehicles": summary.get("vehicles", []),
        "firmware": summary.get("firmware"),
        "problem": summary.get("problem"),
        "running": False,
        "read": file.is_current,
    }
    if info is not None and file.source == "recording":
        view["running"] = info.running
        if not file.is_current:
            view |= {
                "start_unix_s": info.started_unix_s,
                "duration_s": info.duration_s,
                "vehicles": [str(vehicle) for vehicle in info.vehicles],
                "problem": info.problem,
            }
    return view
