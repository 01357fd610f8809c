"""Calls the server's routes as functions, without HTTP, with vehicles on simulated time."""

import json
from pathlib import Path
from types import SimpleNamespace

import msgspec

from gcs_server.api import control_models
from gcs_server.api.setpoints import StartRequest
from gcs_server.api.station import Station
from gcs_server.control.authority import Authority
from gcs_server.control.journal import Journal
from gcs_server.control.principal import Principal
from gcs_server.errors import InvalidRequest, LogUnusable
from gcs_server.flights.flights import Flights
from gcs_server.logbook.decisions import Decisions
from gcs_server.logbook.joined_flights import JoinedFlights
from gcs_server.logbook.library import Library
from gcs_server.logbook.logbook import Logbook
from gcs_server.logbook.notes import NotesStore
from gcs_server.logbook.work import LogWork
from gcs_server.maps.sources import MapSources
from gcs_server.maps.tiles import Tiles
from gcs_server.operations.operations import Operations
from gcs_server.plans import tasks
from gcs_server.plans.ground_tiles import GroundTiles
from gcs_server.plans.store import PlanStore
from gcs_server.plans.work import PlanWork
from gcs_server.replay.service import Replays
from gcs_server.ros2.inspector import TopicInspectors
from gcs_server.storage.records import Records
from gcs_server.storage.user_settings import UserSettings
from tests.protocol.offboard_testbed import OffboardTestbed, sleep

ANNA, BOB = Principal.from_identity("anna", "anna's tab"), Principal.from_identity("bob", "bob's tab")
MISSION_MODE = 4 << 16 | 4 << 24
START_REQUEST = StartRequest.model_validate(
    {"setpoint": {"type": "position", "position_ned_m": [0, 0, -5]}, "valid_for_s": 60}
)
FORCED_CONTROL_REQUEST = control_models.TakeControl(force=True)


class InlinePlanWork:
    """Replaces `PlanWork`: executes the tasks in this process, because simulated time would advance without
    limit while the loop waits for another process."""

    elevation_folder = Path("no elevation")

    async def in_thread(self, work):
        return work()

    async def elevation_paths(self):
        return []

    async def run(self, task, arguments, **_):
        request = msgspec.msgpack.encode({"task": task, "arguments": {**arguments, "elevation": []}})
        answer = tasks.answer_from_bytes(tasks.answer_request(request))
        if answer.fault is not None:
            raise InvalidRequest(answer.fault["field"] or "plan", answer.fault["reason"])
        return answer


def new_station(testbed, progress=None):
    """A `Station` for the routes. `progress`: the store of interrupted flights; None: a new store without
    files."""
    journal = Journal(testbed.clock, None)
    authority = Authority(testbed.clock, testbed.fleet, journal, testbed.supervisor)
    operations = Operations(testbed.clock, testbed.supervisor, lambda _: None)
    flights = Flights(
        testbed.clock,
        testbed.fleet,
        testbed.streamer,
        testbed.streamer._streams,
        testbed.supervisor,
        operations,
        PlanStore(Path("no plans"), testbed.clock, testbed.fleet.events),
        InlinePlanWork(),
        progress,
    )
    flights.groups.start_updates(testbed.supervisor)
    for vehicle in testbed.fleet.all():
        flights.waypoint_flights.attach(vehicle)
    station = Station(
        clock=testbed.clock,
        router=testbed.router,
        fleet=testbed.fleet,
        hub=None,
        journal=journal,
        authority=authority,
        started_s=0.0,
        replays=Replays(testbed.router, testbed.fleet, Path("no recordings")),
        operations=operations,
        flights=flights,
        mavlink_ids=(255, 190),
        topic_inspectors=TopicInspectors(),
        maps=Path("no maps"),
        map_sources=MapSources(Records(Path("no sources"))),
        map_tiles=Tiles(testbed.clock, Path("no tiles")),
        elevation_sources=MapSources(Records(Path("no sources"))),
        elevation_tiles=Tiles(testbed.clock, Path("no tiles")),
        ground_tiles=GroundTiles(testbed.clock, PlanWork(Path("no elevation")), Path("no tiles")),
        user_settings=UserSettings(Records(Path("no settings")), lambda values: values),
        logbook=logbook_in(testbed.clock, Path("no logs")),
        vehicle_files=Path("no files"),
        after_landing_records=Records(Path("no records")),
    )
    return station


class NoLogWork(LogWork):
    """Reads no log: simulated time does not wait for a process."""

    async def read(self, path, folder):
        raise LogUnusable("No log is read here.")


def logbook_in(clock, folder):
    """A logbook with this folder of logs."""
    library = Library(folder / "index.sqlite", folder / "recordings", folder / "logs")
    joined = JoinedFlights(NotesStore(folder / "notes"), Decisions(folder / "decisions"))
    return Logbook(clock, library, NoLogWork(), joined, folder / "cache", 10**9, frozenset, lambda _: None)


def journal_entries(station):
    """The journal, oldest entry first: client, command, vehicle and result of each."""
    return [(e.client, e.command, e.vehicle, e.result) for e in reversed(station.journal.tail(1000))]


def json_of(response):
    """The JSON value of a response's body."""
    return json.loads(response.body)


def run_with_routes(run_simulated, scenario, *, flying=True, loss=0.0, seed=0):
    """Runs a test with a scripted vehicle and the server's routes, on simulated time."""

    async def run():
        testbed = OffboardTestbed()
        autopilot = testbed.offboard_autopilot(testbed.link(), loss=loss, seed=seed)
        if flying:
            autopilot.set_hovering()
        try:
            vehicle = await testbed.wait_for_vehicle()
            await sleep(1.5)
            station = new_station(testbed)
            station.authority.start()
            await scenario(
                SimpleNamespace(testbed=testbed, station=station, vehicle=vehicle, autopilot=autopilot)
            )
        finally:
            await testbed.close()

    run_simulated(run)
