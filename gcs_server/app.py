"""Builds the server application, and starts and stops its parts in order."""

from __future__ import annotations

import asyncio
import logging
import os
import sys
from collections.abc import AsyncGenerator, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

from fastapi import FastAPI
from fastapi.responses import PlainTextResponse, Response
from fastapi.staticfiles import StaticFiles
from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.routing import Route
from starlette.staticfiles import PathLike
from starlette.types import Scope

from gcs_server.agents.agents import Agents
from gcs_server.api.access import AGENTS_PATH, Access
from gcs_server.api.admission import Admission
from gcs_server.api.agent_calls import AgentsEndpoint, InProcessRequests
from gcs_server.api.bodies import BodyReader
from gcs_server.api.connections import Connections
from gcs_server.api.guard import Guard
from gcs_server.api.headers import SecurityHeaders
from gcs_server.api.offboard_models import LimitsRequest
from gcs_server.api.operation_routes import operation_view
from gcs_server.api.permission import bind_commands, command_of
from gcs_server.api.principals import principal_of
from gcs_server.api.schema import bare_app
from gcs_server.api.station import Station
from gcs_server.api.user_settings_models import checked_settings
from gcs_server.clock import Clock, SystemClock
from gcs_server.control.authority import Authority
from gcs_server.control.journal import Journal
from gcs_server.control.lease import LeaseTimes
from gcs_server.encodings import SUFFIXES, accepted_encodings
from gcs_server.errors import GcsError
from gcs_server.flights.flight_notes import FlightNotes
from gcs_server.flights.flights import Flights
from gcs_server.flights.resume import ProgressStore
from gcs_server.flights.vehicle_models import VehicleModels
from gcs_server.guard.guards import Guards
from gcs_server.language import language_of
from gcs_server.links.names import shown_url
from gcs_server.links.url import guarded
from gcs_server.logbook.after_landing import PERIOD_S
from gcs_server.logbook.decisions import Decisions
from gcs_server.logbook.joined_flights import JoinedFlights
from gcs_server.logbook.library import Library, Removed
from gcs_server.logbook.logbook import Logbook
from gcs_server.logbook.notes import NotesStore
from gcs_server.logbook.work import LogWork
from gcs_server.maps.sources import USUAL_ELEVATION, MapSources
from gcs_server.maps.tiles import Tiles, elevation_fault
from gcs_server.mavlink.dialect import MAV_SEVERITY_DEBUG, MAV_SEVERITY_NOTICE
from gcs_server.mavlink.router import Router, RouterSettings
from gcs_server.operations.operations import Operation, Operations
from gcs_server.plans.ground_tiles import GroundTiles
from gcs_server.plans.known_ground import files_of, relief_around
from gcs_server.plans.store import PlanStore
from gcs_server.plans.work import PlanWork
from gcs_server.px4_sitl.runner import read_state
from gcs_server.replay.link import replay_link
from gcs_server.replay.service import Replays
from gcs_server.ros2.client_settings import ClientSettings
from gcs_server.ros2.inspector import TopicInspectors
from gcs_server.ros2.url import ros2_link
from gcs_server.scene.clicks import SceneClick
from gcs_server.scene.gizmo import SceneGizmo
from gcs_server.scene.ports import OffboardTarget
from gcs_server.scene.process import SceneProcess
from gcs_server.scene.terrain_watch import SceneGround
from gcs_server.settings import Settings, agent_tokens_of, token_of
from gcs_server.simulator_process import SimulatorProcess
from gcs_server.storage.cache import Cache
from gcs_server.storage.folder import DataFolder
from gcs_server.storage.records import Records
from gcs_server.storage.user_settings import UserSettings
from gcs_server.streamer.offboard.limit_store import LimitStore
from gcs_server.streamer.offboard.streamer import Streamer
from gcs_server.streamer.process.streams import Streams
from gcs_server.streamer.values.limit_values import OperatorLimits
from gcs_server.supervise import Supervisor
from gcs_server.telemetry.hub import Hub
from gcs_server.vehicle.events import Event
from gcs_server.vehicle.fleet import Fleet, Notice
from gcs_server.vehicle.services.items_cache import ItemsCache

log = logging.getLogger(__name__)

COMPONENT_ID = 190
STREAM_COMPONENT_ID = 191
"""Component id of the process that sends setpoints. It needs its own id, because MAVLink frames have one
sequence number per component."""
STATIC = Path(__file__).resolve().parent / "static"
NO_PAGE = """The page has not been built yet.

Build it with `make web` (or start the server with `make run`, which does), then reload.
The API works without it: /docs describes it.
"""


def _simulator(settings: Settings, clock: Clock, folder: DataFolder) -> SimulatorProcess | None:
    if not settings.sim:
        return None
    if not settings.px4:
        command = [sys.executable, "-m", "vehicle_sim", "--instances", str(settings.sim)]
        return SimulatorProcess(clock, [*command, *settings.sim_args], folder, count=settings.sim)
    command = [sys.executable, "-m", "gcs_server.px4_sitl", "--instances", str(settings.sim)]
    command += ["--data", str(folder.path)]
    if settings.px4_path is not None:
        command += ["--px4-path", str(settings.px4_path)]
    command += settings.sim_args
    return SimulatorProcess(
        clock, command, folder, count=settings.sim, state=lambda: read_state(folder.px4_sitl)
    )


def _streams(settings: Settings, clock: Clock) -> Streams:
    own_ids = (settings.system_id, STREAM_COMPONENT_ID)
    return Streams(clock, own_ids, server_silent_limit_s=settings.server_silent_limit_s)


@dataclass(frozen=True, slots=True)
class Work:
    """What a server does in processes of its own; a server on simulated time does it in the event loop."""

    streams: Callable[[Settings, Clock], Streams] = _streams
    plan_work: type[PlanWork] = PlanWork


IN_PROCESSES = Work()


def _router(settings: Settings, clock: Clock, supervisor: Supervisor, folder: DataFolder) -> Router:
    own = RouterSettings(
        system_id=settings.system_id,
        component_id=COMPONENT_ID,
        signing_dir=folder.signing,
        recording_dir=folder.recordings if settings.record else None,
    )
    other_kinds = {"tlog": replay_link, "ros2": partial(ros2_link, own_system_id=settings.system_id)}
    return Router(clock, supervisor, own, other_kinds)


def _stored_limits(stored: object) -> OperatorLimits:
    return LimitsRequest.model_validate(stored).to_limits()


def _notices(kind: str, source: Callable[[], Sequence[str] | str | None]) -> list[Notice]:
    """The texts of a source of warnings (one, several, none) as notices of this kind."""
    found = source()
    texts = [found] if isinstance(found, str) else found or ()
    return [Notice(kind, text) for text in texts]


class ClientEvents:
    """Sends what happens in the server to the telemetry clients; nothing of it is stored as an event."""

    def __init__(self, clock: Clock, fleet: Fleet, hub: Hub) -> None:
        self._clock = clock
        self._fleet = fleet
        self._hub = hub

    def operation(self, operation: Operation) -> None:
        """An operation has changed; GET /operations lists it."""
        self._publish(
            "operation", operation.vehicle, operation.text, {"operation": operation_view(operation)}
        )

    def scene_click(self, click: SceneClick) -> None:
        """A position was clicked in 3D."""
        self._publish("scene_click", click.vehicle, "", asdict(click))

    def scene_drag(self, gizmo: SceneGizmo) -> None:
        """A preview was dragged in 3D."""
        self._publish("scene_gizmo", gizmo.vehicle, "", asdict(gizmo))

    def _publish(self, kind: str, vehicle: str | None, text: str, data: dict[str, object]) -> None:
        self._hub.publish(Event(0, kind, vehicle, self._clock.unix_s(), MAV_SEVERITY_DEBUG, text, data))


def _elevation_sources(folder: DataFolder) -> MapSources:
    return MapSources(Records(folder.elevation_sources), USUAL_ELEVATION, "elevation source")


def _elevation_tiles(clock: Clock, folder: DataFolder) -> Tiles:
    return Tiles(clock, folder.cache / "elevation_tiles", "elevation source", elevation_fault)


def _kept_of_vehicles(folder: DataFolder) -> tuple[ProgressStore, VehicleModels]:
    """What is kept of vehicles for their flights and dry runs."""
    return ProgressStore(Records(folder.flights)), VehicleModels(Records(folder.vehicle_models))


class Server:
    """Builds all parts once the event loop runs, and stops them in reverse order."""

    def __init__(self, settings: Settings, clock: Clock, more_links: tuple[str, ...], work: Work) -> None:
        folder = DataFolder(settings.data)
        self._links = (*settings.links, *map(guarded, settings.guards), *more_links)
        self._link_errors: list[Notice] = []
        self._simulator = _simulator(settings, clock, folder)
        self.supervisor = Supervisor(clock)
        self.router = _router(settings, clock, self.supervisor, folder)
        self.fleet = Fleet(clock, self.supervisor, self.router)
        hub = Hub(clock, self.fleet)
        self._events = ClientEvents(clock, self.fleet, hub)
        streams = work.streams(settings, clock)
        self.streamer = Streamer(clock, streams, LimitStore(Records(folder.limits), _stored_limits))
        journal = Journal(clock, folder.journal)
        lease_times = LeaseTimes(settings.control_lease_s, settings.control_answer_s)
        replays = Replays(self.router, self.fleet, folder.recordings)
        authority = Authority(clock, self.fleet, journal, self.supervisor, lease_times)
        operations = Operations(clock, self.supervisor, self._events.operation)
        self.flights = Flights(
            clock,
            self.fleet,
            self.streamer,
            streams,
            self.supervisor,
            operations,
            PlanStore(folder.plans, clock, self.fleet.events),
            work.plan_work(folder.elevation, authority.controls_any),
            *_kept_of_vehicles(folder), authority.controls_any,
        )  # fmt: skip
        self._ros2_settings = ClientSettings(clock, self.fleet.all, self.router.connections)
        self._connect_vehicles(Cache(folder.cache))
        self.scene = self._scene(clock) if settings.scene else None
        self.station = Station(
            clock=clock,
            router=self.router,
            fleet=self.fleet,
            hub=hub,
            journal=journal,
            authority=authority,
            replays=replays,
            operations=operations,
            flights=self.flights,
            topic_inspectors=TopicInspectors(),
            started_s=clock.monotonic_s(),
            mavlink_ids=(settings.system_id, COMPONENT_ID),
            maps=folder.maps,
            map_sources=MapSources(Records(folder.map_sources)),
            user_settings=UserSettings(Records(folder.user_settings), checked_settings),
            map_tiles=Tiles(clock, folder.cache / "map_tiles"),
            elevation_sources=_elevation_sources(folder),
            elevation_tiles=_elevation_tiles(clock, folder),
            ground_tiles=GroundTiles(clock, self.flights.plan_work, folder.cache / "ground_tiles"),
            logbook=self._logbook(settings, clock, folder, authority, replays),
            vehicle_files=folder.vehicle_files,
            after_landing_records=Records(folder.after_landing),
            has_scene=self.scene is not None,
            simulator=self._simulator,
        )
        self._connect_station(hub)
        self.flight_notes = self._flight_notes(clock)
        self._collect_warnings()

    def _logbook(
        self, settings: Settings, clock: Clock, folder: DataFolder, authority: Authority, replays: Replays
    ) -> Logbook:
        def in_use() -> frozenset[Path]:
            recorded = (info.recording for info in self.router.links())
            names = {r.file for r in recorded if r is not None and r.file and r.stopped is None}
            names |= {replay.recording for replay in replays.all()}
            return frozenset(folder.recordings / name for name in names) | self.station.log_streams.paths()

        def report(removed: Removed) -> None:
            station = self.station
            text = f"A flight was deleted to make room: {removed.name} ({removed.bytes / 1e6:.0f} MB)."
            log.warning(text)
            self.fleet.events.add("flight_removed", clock.unix_s(), text, severity=MAV_SEVERITY_NOTICE)
            station.journal.add("server", "flights/delete", None, {}, "ok", text, 0.0)

        return Logbook(
            clock,
            Library(folder.flight_index, folder.recordings, folder.logs),
            LogWork(authority.controls_any),
            JoinedFlights(NotesStore(folder.flight_notes), Decisions(folder.flight_decisions)),
            folder.cache / "flights",
            round(settings.flights_gb * 1e9),
            in_use,
            report,
            lambda: self.flight_notes.any_flying(),
        )

    def _flight_notes(self, clock: Clock) -> FlightNotes:
        logbook, journal = self.station.logbook, self.station.journal
        store = logbook.joined.notes
        notes = FlightNotes(
            clock, self.fleet, self.router, self.flights, store, journal.of_vehicle, logbook.read_unasked
        )
        self.fleet.on_vehicle_removed(notes.detach)
        self.fleet.on_vehicle_removed(self.station.after_landing.detach)
        return notes

    def _scene(self, clock: Clock) -> SceneProcess:
        events, result_of = self._events, self.flights.dry_runs.body
        work = self.flights.plan_work
        ground = SceneGround(partial(files_of, work), partial(relief_around, work))
        target, on_click, on_drag = self._offboard_target, events.scene_click, events.scene_drag
        return SceneProcess(self.fleet, clock, target, on_click, on_drag, result_of, ground)

    def _connect_station(self, hub: Hub) -> None:
        self.station.guards = Guards(self.station, self.router, self.supervisor)
        hub.set_replays_source(self.station.replays.all)
        hub.set_ros2_topics_source(self.station.topic_inspectors.inspect)
        hub.set_landed_logs_source(self.station.after_landing.of)

    def _connect_vehicles(self, cache: Cache) -> None:
        """Lets the parts know of the vehicles that come and go."""
        for part in (self.streamer, self.flights):  # flights use streams
            self.fleet.on_vehicle_added(part.attach)
        for part in (self.flights, self.streamer):
            self.fleet.on_vehicle_removed(part.detach)
        plan_cache = ItemsCache(cache)
        self.fleet.on_vehicle_added(lambda vehicle: vehicle.metadata.set_cache(cache))
        self.fleet.on_vehicle_added(lambda vehicle: vehicle.mission.set_cache(plan_cache))
        self.fleet.subscribe(self._cancel_operations_on_loss)
        self.router.on_change(lambda _link: self.streamer.links_changed())

    def _collect_warnings(self) -> None:
        texts: list[tuple[str, Callable[[], Sequence[str] | str | None]]] = [
            ("fault", self.streamer.faults),
            ("limits", self.streamer.limits.warnings),
            ("fault", self.flights.groups.faults),
            ("plans", self.flights.plans.warnings),
            ("plans", self.flights.progress.warnings),
            ("plans", self.flights.models.warnings),
            ("maps", self.station.map_sources.warnings),
            ("maps", self.station.elevation_sources.warnings),
            ("settings", self.station.user_settings.warnings),
            ("settings", self.station.after_landing.warnings),
            ("ros2_settings", self._ros2_settings.warnings),
        ]
        if self.scene is not None:
            texts += [("fault", self.scene.faults), ("scene", self.scene.warning)]
        sources = self.station.warning_sources
        sources.append(lambda: list(self._link_errors))
        sources.append(self.station.guards.warnings)
        sources += [partial(_notices, kind, source) for kind, source in texts]
        if self._simulator is not None:
            sources.append(self._simulator.warnings)

    async def start(self) -> None:
        """Starts all parts; a link that cannot be opened becomes a warning."""
        await self.station.journal.load()
        self.station.journal.start(self.supervisor)
        for sources in (self.station.map_sources, self.station.elevation_sources):
            await asyncio.to_thread(sources.load)
        await asyncio.to_thread(self.station.user_settings.load)
        await asyncio.to_thread(self.station.after_landing.load)
        await self.streamer.limits.load()
        await self.flights.load()
        self.router.start()
        self.fleet.start()
        self.supervisor.start("settings of ROS 2 clients", self._ros2_settings.run)
        for url in self._links:
            try:
                self.router.add_link(url)
            except GcsError as error:
                displayed_url = shown_url(url)
                log.warning("link %s: %s", displayed_url, error)
                text = f"{displayed_url}: {error.message}" + (f" {error.remedy}" if error.remedy else "")
                self._link_errors.append(Notice("link", text, link=displayed_url))
        self.streamer.start(self.supervisor)
        self.flights.start()
        self.flight_notes.start(self.supervisor)
        self.station.authority.start()
        self.station.guards.start()
        self.supervisor.start("room for flights", self.station.logbook.run)
        self.supervisor.repeat("logs after landings", self.station.after_landing.update, PERIOD_S)
        if self.scene is not None:
            self.supervisor.start("scene", self.scene.run)
        if self._simulator is not None:
            self._simulator.start()
            self.supervisor.start("simulator", self._simulator.watch)
        for notice in self.station.warnings():
            log.warning(notice.text)

    async def stop(self) -> None:
        """Stops all parts: puts vehicles with a setpoint stream into Hold first, stops the simulator last."""
        await self._stop_streams()
        await asyncio.to_thread(self.flight_notes.close)
        await self.station.operations.close()
        self.flights.close()
        self.streamer.close()
        self.station.hub.close()
        await self.fleet.close()
        await self.supervisor.close()
        self.flights.progress.close()
        self.flights.models.close()
        for tiles in (self.station.map_tiles, self.station.elevation_tiles, self.station.ground_tiles):
            await tiles.close()
        for sources in (self.station.map_sources, self.station.elevation_sources):
            sources.close()
        self.station.user_settings.close()
        self.station.after_landing.close()
        self.station.replays.stop()
        await asyncio.to_thread(self.station.logbook.close)
        await asyncio.to_thread(self.station.topic_inspectors.close)
        await self.router.close()
        self.station.journal.flush()
        if self._simulator is not None:
            await self._simulator.stop()

    async def _stop_streams(self) -> None:
        for stopped in await self.flights.stop_streams():
            error = stopped.error
            detail = str(error) if error is not None else "The server was stopped."
            result = error.code if error is not None else "ok"
            self.station.journal.add(
                "server", "offboard/stop", stopped.vehicle, {}, result, detail, stopped.duration_s
            )
            if error is None:
                log.info("vehicle %s was put into Hold: the server is stopping", stopped.vehicle)
            else:
                log.warning("vehicle %s: %s", stopped.vehicle, error)

    def is_simulators(self, address: tuple[str, int] | None) -> bool:
        """Whether a vehicle at this address is one of the simulator that this server started."""
        return self._simulator is not None and self._simulator.sends_from(address)

    def _offboard_target(self, vehicle_id: str) -> OffboardTarget | None:
        target = self.streamer.target(vehicle_id)
        return None if target is None else OffboardTarget(*target)

    def _cancel_operations_on_loss(self, event: Event) -> None:
        is_removed = event.kind == "vehicle_removed"
        if event.vehicle is not None and (
            is_removed or (event.kind == "link" and self._is_lost(event.vehicle))
        ):
            self.station.operations.vehicle_lost(event.vehicle, event.text)

    def _is_lost(self, vehicle_id: str) -> bool:
        return any(v.id == vehicle_id and v.status.link_lost for v in self.fleet.all())


class Page(StaticFiles):
    """The built page: browsers cache files with a hash in their name and always revalidate index.html. A file
    is sent in the smallest compressed form that the build has written and the browser accepts. The page
    itself is sent in the browser's language (`language.py`), if it was built in that language."""

    async def get_response(self, path: str, scope: Scope) -> Response:
        is_page = path in (".", "index.html")
        translated = f"index.{language_of(Headers(scope=scope))}.html"
        if is_page and self.lookup_path(translated)[1] is not None:
            path = translated
        response = await super().get_response(path, scope)
        if is_page:
            response.headers.add_vary_header("Cookie")
            response.headers.add_vary_header("Accept-Language")
        has_hash = path.startswith("assets/")
        response.headers["Cache-Control"] = "public, max-age=31536000, immutable" if has_hash else "no-cache"
        return response

    def file_response(
        self, full_path: PathLike, stat_result: os.stat_result, scope: Scope, status_code: int = 200
    ) -> Response:
        for encoding in accepted_encodings(Headers(scope=scope).get("accept-encoding", "")):
            compressed = Path(f"{full_path!s}{SUFFIXES[encoding]}")
            try:
                compressed_stat = compressed.stat()
            except OSError:
                continue
            # The media type is that of the file: `mimetypes` knows the suffixes of both encodings.
            response = super().file_response(compressed, compressed_stat, scope, status_code)
            response.headers["Content-Encoding"] = encoding
            break
        else:
            response = super().file_response(full_path, stat_result, scope, status_code)
        response.headers.add_vary_header("Accept-Encoding")
        return response


def _add_agents(
    app: FastAPI, server: Server, settings: Settings, token: str | None, agent_tokens: Mapping[str, str]
) -> None:
    """Adds the agents to the station, and the route at which they call."""
    station = server.station
    station.agents = Agents(
        station,
        server.supervisor,
        InProcessRequests(app, token),
        settings.agent_scopes,
        agent_tokens,
        settings.agent_calls_per_min,
        server.is_simulators,
    )
    station.warning_sources.append(station.agents.warnings)
    endpoint = AgentsEndpoint(station.agents, server.supervisor)
    app.router.routes.append(Route(AGENTS_PATH, endpoint, methods=["POST"]))


def create_app(
    settings: Settings,
    clock: Clock | None = None,
    *,
    more_links: tuple[str, ...] = (),
    static: Path = STATIC,
    work: Work = IN_PROCESSES,
) -> FastAPI:
    """The application.

    Args:
        settings: the server's settings.
        clock: default: the system clock.
        more_links: URLs of additional links, such as a replay.
        static: folder of the built page.
        work: where setpoint streams and the work on plans run.

    Raises:
        GcsError: a token is needed, and its file cannot be created or read.
    """
    app = bare_app()
    clock = clock or SystemClock()
    server = Server(settings, clock, more_links, work)

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncGenerator[None]:
        await server.start()
        try:
            yield
        finally:
            await server.stop()

    app.router.lifespan_context = lifespan
    app.state.station = server.station
    app.state.server = server

    def record_invalid_request(request: Request, detail: str) -> None:
        if request.method in ("POST", "PUT"):
            vehicle, command = request.path_params.get("v"), command_of(request)
            if command.journaled:
                caller = principal_of(request).name
                server.station.journal.add(caller, command.name, vehicle, {}, "invalid_request", detail, 0.0)

    app.state.record_invalid_request = record_invalid_request
    in_control = server.station.authority.controls_any
    connections = Connections(clock, in_control=in_control)
    app.state.connections = connections
    server.station.warning_sources.append(partial(_notices, "connections", connections.warning))
    station = server.station
    app.add_middleware(
        BodyReader, request_queue=station.request_queue, large_setpoints=station.large_setpoints
    )
    app.add_middleware(Admission, connections=connections, in_control=in_control)
    token, agent_tokens = token_of(settings), agent_tokens_of(settings)
    access = Access(loopback_only=settings.loopback_only, token=token, agent_tokens=agent_tokens.values())
    app.add_middleware(Guard, access=access, clock=clock)
    app.add_middleware(SecurityHeaders)  # outermost, so that refusals also have them
    _add_agents(app, server, settings, token, agent_tokens)
    if server.scene is not None:
        app.include_router(server.scene.router())
    if (static / "index.html").is_file():
        app.mount("/", Page(directory=static, html=True), name="page")
    else:

        @app.get("/", include_in_schema=False)
        async def no_page() -> PlainTextResponse:
            return PlainTextResponse(NO_PAGE, status_code=503)

    bind_commands(app)
    return app
