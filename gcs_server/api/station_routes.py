"""The server itself: health, links, journal, warnings, telemetry."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Annotated

from fastapi import APIRouter, Query, Response, WebSocket, WebSocketDisconnect

from gcs_server.api import models, responses
from gcs_server.api.problems import RESPONSES
from gcs_server.api.responses import answer
from gcs_server.api.station import ClientDep, Station, StationDep, client_of, journaled, names_itself
from gcs_server.telemetry.wire import SCHEMA_VERSION
from gcs_server.version import __version__

router = APIRouter(tags=["station"])


@router.get("/health", response_model=responses.Health)
async def health(station: StationDep) -> Response:
    """Answers while the server is up."""
    uptime_s = station.clock.monotonic_s() - station.started_s
    return answer({"status": "ok", "uptime_s": uptime_s, "vehicles": len(station.fleet.all())})


@router.get("/version", response_model=responses.Version)
async def version(station: StationDep) -> Response:
    """Which server this is."""
    return answer(
        {
            "name": "offboard-gcs",
            "version": __version__,
            "schema_version": SCHEMA_VERSION,
            "simulator": station.simulator,
            "scene": station.has_scene,
            "recording": station.router.settings.recording_dir is not None,
        }
    )


@router.get("/links", response_model=responses.Links)
async def list_links(station: StationDep) -> Response:
    """State and counters of all links."""
    return answer({"links": station.router.links()})


@router.post("/links", response_model=responses.LinkModel, status_code=201, responses=RESPONSES)
async def add_link(body: models.LinkRequest, station: StationDep, client: ClientDep) -> Response:
    """Opens a link; one that cannot be opened yet tries again by itself and says why."""
    with journaled(station, client, "links/add", None, body.model_dump(exclude_none=True)):
        return answer(station.router.add_link(body.url, body.name), 201)


@router.delete("/links/{name}", status_code=204, responses=RESPONSES)
async def remove_link(name: str, station: StationDep, client: ClientDep) -> Response:
    """Closes a link."""
    with journaled(station, client, "links/remove", None, {"name": name}):
        await station.router.remove_link(name)
    return Response(status_code=204)


@router.get("/journal", response_model=responses.Journal)
async def journal(
    station: StationDep, limit: Annotated[int, Query(ge=1, le=1000, description="At most so many.")] = 100
) -> Response:
    """Who commanded what and what became of it, newest first."""
    return answer({"entries": station.journal.tail(limit)})


@router.get("/warnings", response_model=responses.Warnings)
async def warnings(station: StationDep) -> Response:
    """Ports taken, recordings stopped, duplicate ids, a simulator that died."""
    return answer({"warnings": station.warnings()})


@router.websocket("/telemetry")
async def telemetry(socket: WebSocket) -> None:
    """See "WebSocket telemetry" in docs/architecture.md."""
    station: Station = socket.app.state.station
    await socket.accept()
    here = station.authority.connected(client_of(socket)) if names_itself(socket) else nullcontext()
    try:
        with here:
            await station.hub.serve(socket)
    except* (WebSocketDisconnect, RuntimeError):
        pass  # the browser went; RuntimeError is what a send to a closed socket raises
