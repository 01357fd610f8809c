"""The running server, for the routes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from fastapi import Depends
from starlette.requests import HTTPConnection

from gcs_server.agents.agents import Agents
from gcs_server.api.request_queue import LargeSetpoints, RequestQueue
from gcs_server.clock import Clock
from gcs_server.control.authority import Authority
from gcs_server.control.journal import Journal
from gcs_server.flights.flights import Flights
from gcs_server.guard.guards import Guards
from gcs_server.logbook.after_landing import AfterLanding
from gcs_server.logbook.downloads import LogDownloads
from gcs_server.logbook.file_downloads import FileDownloads
from gcs_server.logbook.logbook import Logbook
from gcs_server.logbook.streams import LogStreams
from gcs_server.maps.sources import MapSources
from gcs_server.maps.tiles import Tiles
from gcs_server.mavlink.router import Router
from gcs_server.operations.operations import Operations
from gcs_server.plans.ground_tiles import GroundTiles
from gcs_server.replay.service import Replays
from gcs_server.ros2.inspector import TopicInspectors
from gcs_server.simulator_process import SimulatorProcess
from gcs_server.storage.records import Records
from gcs_server.storage.user_settings import UserSettings
from gcs_server.streamer.offboard.control import OffboardControl
from gcs_server.telemetry.hub import Hub
from gcs_server.vehicle.fleet import Fleet, Notice
from gcs_server.vehicle.vehicle import Vehicle


@dataclass(slots=True)
class Station:
    """The running server: the parts that the routes use."""

    clock: Clock
    router: Router
    fleet: Fleet
    hub: Hub
    journal: Journal
    authority: Authority
    replays: Replays
    operations: Operations
    flights: Flights
    topic_inspectors: TopicInspectors
    started_s: float
    """Time of the server's start, monotonic [s]."""
    mavlink_ids: tuple[int, int]
    """System and component id of this server."""
    maps: Path
    """Folder of the operator's offline maps; need not exist."""
    map_sources: MapSources
    map_tiles: Tiles
    elevation_sources: MapSources
    elevation_tiles: Tiles
    ground_tiles: GroundTiles
    user_settings: UserSettings
    logbook: Logbook
    """The files of flights, among them the logs that were downloaded from vehicles."""
    vehicle_files: Path
    """Folder of the files that were downloaded from vehicles; made when needed."""
    after_landing_records: Records
    """Where it is stored what happens with logs after a landing."""
    log_downloads: LogDownloads = field(init=False)
    after_landing: AfterLanding = field(init=False)
    file_downloads: FileDownloads = field(init=False)
    log_streams: LogStreams = field(init=False)
    guards: Guards = field(init=False)
    """The guarded links of programs."""
    agents: Agents = field(init=False)
    """Language models that call this server over MCP."""
    request_queue: RequestQueue = field(init=False)
    large_setpoints: LargeSetpoints = field(init=False)
    has_scene: bool = False
    simulator: SimulatorProcess | None = None
    """The simulator that this server started or found."""
    warning_sources: list[Callable[[], list[Notice]]] = field(
        default_factory=list[Callable[[], list[Notice]]]
    )
    setpoint_lines: dict[tuple[str, str, str], tuple[float, int]] = field(
        default_factory=dict[tuple[str, str, str], tuple[float, int]]
    )
    """Time of the last journal line and number of setpoints since then, by client key, vehicle and result."""

    def __post_init__(self) -> None:
        self.log_downloads = LogDownloads(self.clock, self.logbook, self.fleet.get)
        self.file_downloads = FileDownloads(
            self.clock, self.vehicle_files, self.log_downloads.transfers, self.fleet.get
        )
        self.after_landing = AfterLanding(
            self.clock,
            self.fleet,
            self.operations,
            self.log_downloads,
            self.after_landing_records,
            lambda v: self.journal.add("server", "logs/download", v, {}, "ok", "After its landing.", 0.0),
        )
        self.log_streams = LogStreams(self.clock, self.logbook, self.fleet.get)
        self.request_queue = RequestQueue(self.authority.controls_any)
        self.large_setpoints = LargeSetpoints(self.authority.controls_any)

    def offboard(self, vehicle_id: str) -> OffboardControl:
        """A vehicle's setpoint stream. Raises UnknownVehicle."""
        return self.flights.offboard(vehicle_id)

    def warnings(self) -> list[Notice]:
        """All current warnings."""
        notices = self.fleet.warnings()
        if self.journal.warning is not None:
            notices.append(Notice("journal", self.journal.warning))
        notices += self.authority.warnings()
        for source_warnings in self.warning_sources:
            notices += source_warnings()
        return notices


# Dependencies are coroutines: FastAPI would call plain functions in other threads, which costs a setpoint
# milliseconds, and the objects of a station are not thread-safe.


async def get_station(connection: HTTPConnection) -> Station:
    """Dependency: the station of this application."""
    return connection.app.state.station


StationDep = Annotated[Station, Depends(get_station)]


async def get_vehicle(v: str, station: StationDep) -> Vehicle:
    """Dependency of routes that read a vehicle's data: raises UnknownVehicle."""
    return station.fleet.get(v)


VehicleDep = Annotated[Vehicle, Depends(get_vehicle)]


async def get_offboard(v: str, station: StationDep) -> OffboardControl:
    """Dependency of routes that read a stream: raises UnknownVehicle."""
    return station.offboard(v)


OffboardDep = Annotated[OffboardControl, Depends(get_offboard)]
