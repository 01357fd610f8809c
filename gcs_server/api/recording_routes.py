"""Routes of recordings: list, download and replay. Replayed vehicles accept no commands."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator
from pathlib import Path

import anyio
from fastapi import Response
from starlette.responses import StreamingResponse

from gcs_server.api import models, responses
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import StationDep
from gcs_server.control.accepted import authorized_command
from gcs_server.errors import RecordingUnusable
from gcs_server.operations.operations import ReportProgress

PIECE_BYTES = 1 << 16

router = Routes(tags=["recordings"], responses={s: RESPONSES[s] for s in (404, 409, 422)})


@router.get("/recordings", response_model=responses.Recordings)
async def list_recordings(station: StationDep) -> Response:
    """Recorded flights, newest first; `problem` and `running` mark recordings that are damaged or still being
    written.
    """
    return json_response({"recordings": await station.replays.recordings()})


@router.get(
    "/recordings/{name}",
    response_class=StreamingResponse,
    responses={200: {"content": {"application/octet-stream": {}}}},
)
async def download_recording(name: str, station: StationDep) -> StreamingResponse:
    """The file of a recording; its current content, if the recording is still running."""
    path = station.replays.path(name)
    size = path.stat().st_size
    headers = {
        "content-length": str(size),
        "content-disposition": f'attachment; filename="{_header_safe(name)}"',
    }
    return StreamingResponse(_read_pieces(path, size), media_type="application/octet-stream", headers=headers)


@router.get("/recordings/{name}/index", response_model=responses.RecordingIndexModel)
async def index_recording(name: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Index of a recording: start, end, and each vehicle's modes, armed periods and messages. The first
    request reads the recording, which takes seconds, as an operation that can be followed and cancelled. A
    cancelled operation gives 409.
    """
    replays = station.replays
    if not replays.is_indexed(name):

        async def read(report: ReportProgress) -> dict[str, object]:
            try:
                index = await replays.index_of_recording(name)
            except asyncio.CancelledError:
                replays.stop_reading(name)
                raise
            return {"records": index.records}

        operation = station.operations.start(
            "recording/index",
            read,
            text=f"Reading {name}.",
            subject=name,
            by=(principal.name, principal.key),
        )
        if (await station.operations.wait(operation.id)).state == "cancelled":
            raise RecordingUnusable(f"{name}: reading it was cancelled.")
    return json_response(await replays.index_of_recording(name))


@router.get("/replays", response_model=responses.Replays)
async def list_replays(station: StationDep) -> Response:
    """The replays that are open; also sent by the telemetry socket."""
    return json_response({"replays": station.replays.all()})


@router.post("/replays", response_model=responses.ReplayModel, status_code=201)
async def open_replay(body: models.ReplayRequest, station: StationDep, principal: PrincipalDep) -> Response:
    """Opens a recording for replay; a replay that is already open is not changed."""
    with authorized_command(station, principal, "replays/open", None, body.model_dump()):
        replay = await station.replays.open(body.recording, speed=body.speed, playing=body.playing)
        return json_response(replay, 201)


@router.get("/replays/{name}", response_model=responses.ReplayModel)
async def show_replay(name: str, station: StationDep) -> Response:
    """State of a replay: position, speed, playing or paused."""
    return json_response(station.replays.get(name))


@router.post("/replays/{name}", response_model=responses.ReplayModel)
async def change_replay(name: str, body: models.ReplayChange, station: StationDep) -> Response:
    """Plays, pauses, sets the speed or jumps to a time; answers once the vehicles show their state at that
    time."""
    replay = await station.replays.change(
        name, playing=body.playing, speed=body.speed, position_unix_s=body.position_unix_s
    )
    return json_response(replay)


@router.get("/replays/{name}/index", response_model=responses.RecordingIndexModel)
async def index_replay(name: str, station: StationDep) -> Response:
    """The index of an open replay, including one opened by `gcs replay FILE`."""
    return json_response(await station.replays.index_of_replay(name))


@router.delete("/replays/{name}", status_code=204)
async def close_replay(name: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Closes a replay and removes its vehicles; the file is kept."""
    with authorized_command(station, principal, "replays/close", None, {"name": name}):
        await station.replays.close(name)
    return Response(status_code=204)


def _header_safe(name: str) -> str:
    return "".join(c if c.isascii() and c.isprintable() and c not in '"\\' else "_" for c in name)


async def _read_pieces(path: Path, size: int) -> AsyncGenerator[bytes]:
    """The first `size` bytes of the file in pieces; the file may be growing."""
    remaining = size
    async with await anyio.open_file(path, "rb") as file:
        while remaining and (piece := await file.read(min(PIECE_BYTES, remaining))):
            remaining -= len(piece)
            yield piece
