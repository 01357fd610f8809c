"""Routes of the server itself: health, links, journal, warnings, telemetry."""

from __future__ import annotations

import asyncio
from contextlib import nullcontext
from dataclasses import asdict
from typing import Annotated

from fastapi import Query, Response, WebSocket, WebSocketDisconnect

from gcs_server.api import models, responses
from gcs_server.api.principals import PrincipalDep, has_identity, principal_of
from gcs_server.api.problems import RESPONSES
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import Station, StationDep
from gcs_server.control.accepted import authorized_command
from gcs_server.control.link_guard import LinkGuard
from gcs_server.links.names import shown_url
from gcs_server.telemetry.wire import SCHEMA_VERSION
from gcs_server.version import __version__

router = Routes(tags=["station"])


@router.get("/health", response_model=responses.ServerHealth)
async def health(station: StationDep) -> Response:
    """Answers while the server is running."""
    uptime_s = station.clock.monotonic_s() - station.started_s
    return json_response({"status": "ok", "uptime_s": uptime_s, "vehicles": len(station.fleet.all())})


@router.get("/version", response_model=responses.Version)
async def version(station: StationDep) -> Response:
    """Name, version and features of this server."""
    return json_response(
        {
            "name": "offboard-gcs",
            "version": __version__,
            "schema_version": SCHEMA_VERSION,
            "simulator": station.simulator is not None,
            "scene": station.has_scene,
            "recording": station.router.settings.recording_dir is not None,
        }
    )


@router.get("/simulator", response_model=responses.Simulator)
async def simulator(station: StationDep) -> Response:
    """The simulated vehicles that this server runs, and what each real PX4 last printed."""
    process = station.simulator
    state = None if process is None else process.state()
    if process is None or state is None:
        return json_response({"kind": None if process is None else "bundled", "instances": []})
    consoles = await asyncio.to_thread(process.consoles, state)
    instances = [
        {**asdict(each), "console": text} for each, text in zip(state.instances, consoles, strict=True)
    ]
    return json_response(
        {"kind": "px4", "source": state.source, "agent": state.agent, "instances": instances}
    )


@router.get("/links", response_model=responses.Links)
async def list_links(station: StationDep) -> Response:
    """State and counters of all links."""
    return json_response({"links": station.router.links()})


@router.post("/links", response_model=responses.LinkModel, status_code=201, responses=RESPONSES)
async def add_link(body: models.LinkRequest, station: StationDep, principal: PrincipalDep) -> Response:
    """Opens a link. If it cannot be opened yet, the server keeps trying and reports the reason.

    A link to another ground station (`forward=1`) is refused (409 `not_in_control`) while another client has
    control of a vehicle, because that station could command the vehicle.
    """
    arguments: dict[str, object] = {**body.model_dump(exclude_none=True), "url": shown_url(body.url)}
    with authorized_command(station, principal, "links/add", None, arguments):
        link = station.router.make_link(body.url, body.name)
        if link.forward:
            _link_guard(station).check_forwarding(principal)
        return json_response(station.router.add(link), 201)


@router.delete("/links/{name}", status_code=204, responses=RESPONSES)
async def remove_link(
    name: str,
    station: StationDep,
    principal: PrincipalDep,
    confirm: Annotated[
        str | None,
        Query(
            max_length=1000,
            description="Required if a vehicle in flight would lose its last link; exactly the text from "
            "the refusal: `link {name} closes, vehicle {id} in flight loses its last link`.",
        ),
    ] = None,
) -> Response:
    """Closes a link; 409 if that would disconnect a vehicle.

    The code is `not_in_control` if another client controls a vehicle on this link. It is `refused` if this is
    the last link of a vehicle that is armed or flown by setpoints, and `confirm` is not the required text.
    """
    arguments: dict[str, object] = {"name": name} if confirm is None else {"name": name, "confirm": confirm}
    with authorized_command(station, principal, "links/remove", None, arguments):
        _link_guard(station).check_close(name, principal, confirm)
        await station.router.remove_link(name)
    return Response(status_code=204)


def _link_guard(station: Station) -> LinkGuard:
    return LinkGuard(station.router, station.fleet, station.authority)


@router.get("/journal", response_model=responses.Journal)
async def journal(
    station: StationDep,
    limit: Annotated[int, Query(ge=1, le=1000, description="Maximum number of entries.")] = 100,
) -> Response:
    """Commands with client, arguments and result, newest first."""
    return json_response({"entries": station.journal.tail(limit)})


@router.get("/warnings", response_model=responses.Warnings)
async def warnings(station: StationDep) -> Response:
    """Current warnings: ports in use, stopped recordings, duplicate ids, a simulator that has ended."""
    return json_response({"warnings": station.warnings()})


@router.websocket("/telemetry")
async def telemetry(socket: WebSocket) -> None:
    """Sends telemetry samples and events; see "Telemetry" in docs/api.md."""
    station: Station = socket.app.state.station
    await socket.accept()
    connection = station.authority.connected(principal_of(socket)) if has_identity(socket) else nullcontext()
    try:
        with connection:
            await station.hub.serve(socket)
    except* (WebSocketDisconnect, RuntimeError):
        pass  # the browser disconnected; sending to a closed socket raises RuntimeError
