"""The server notes each flight from arming to disarming: its recordings, plan, commands to this vehicle, and
parameters at arming; a killed server leaves what it knew, a replay leaves nothing."""

import asyncio
import json
import logging
from dataclasses import dataclass
from types import SimpleNamespace

import pytest

from gcs_server.errors import UnknownLink
from gcs_server.faults import Isolation
from gcs_server.flights.flight_notes import WRITE_EVERY_S, FlightNotes
from gcs_server.logbook.notes import NotesStore
from gcs_server.supervise import Supervisor


@dataclass
class Flown:
    """Stands for a flight compared with its plan."""

    started_unix_s: float = 1e9 + 101


class Clock:
    now_s = 100.0

    def monotonic_s(self):
        return self.now_s

    def unix_s(self):
        return 1e9 + self.now_s

    async def sleep(self, _seconds):
        await asyncio.Event().wait()


class Setup:
    """Vehicle "1" on link "udp", whose recording a test can change."""

    def __init__(self, tmp_path):
        self.clock = Clock()
        self.recording = "first.tlog"
        self.vehicle = SimpleNamespace(
            id="1",
            identity=SimpleNamespace(replayed=False, system_id=1, uid="00aa"),
            isolation=Isolation(self.clock, logging.getLogger("test"), "1"),
            flight_state=SimpleNamespace(armed=False, landed_state="on_ground"),
            status=SimpleNamespace(mode_label="Hold"),
            endpoints=(SimpleNamespace(boot_at_s=60.0),),
            links=("udp", "gone"),
            params=SimpleNamespace(all=lambda: [SimpleNamespace(name="MPC_XY_VEL_MAX", value=12.0)]),
        )
        self.fleet = [self.vehicle]
        self.waypoint_status = None
        self.dry_run = b"{}"
        waypoint_flights = SimpleNamespace(status=lambda _: self.waypoint_status, flown=lambda _: Flown())
        flights = SimpleNamespace(
            waypoint_flights=waypoint_flights,
            missions=SimpleNamespace(find_flight=lambda _: None),
            dry_runs=SimpleNamespace(body=lambda _: self.dry_run),
        )
        self.ended = []
        self.store = NotesStore(tmp_path / "notes")
        self.asked = []
        self.notes = FlightNotes(
            self.clock,
            SimpleNamespace(all=lambda: self.fleet),
            SimpleNamespace(connection=self._connection),
            flights,
            self.store,
            self._commands,
            self._on_ended,
        )

    def _connection(self, name):
        if name == "gone":
            raise UnknownLink("There is no link.")
        return SimpleNamespace(info=lambda: SimpleNamespace(recording=SimpleNamespace(file=self.recording)))

    def _commands(self, vehicle, begin_unix_s, end_unix_s):
        self.asked.append((vehicle, begin_unix_s, end_unix_s))
        return [{"unix_s": 1e9 + 99, "client": "Ann", "command": "arm", "result": "ok", "detail": None}]

    async def _on_ended(self, names):
        self.ended.append(names)

    def fly(self, seconds, *, armed=True, landed="in_air", mode="Mission"):
        self.vehicle.flight_state = SimpleNamespace(armed=armed, landed_state=landed)
        self.vehicle.status = SimpleNamespace(mode_label=mode)
        for _ in range(seconds):
            self.clock.now_s += 1.0
            self.notes.update()


def run(setup, action):
    """Runs an action with a supervisor whose tasks have ended afterwards."""
    asyncio.run(_run(setup, action))


async def _run(setup, action):
    supervisor = Supervisor(setup.clock)
    setup.notes.start(supervisor)
    action()
    for _ in range(50):
        await asyncio.sleep(0.01)
        if len(supervisor.names()) <= 1:
            break
    await supervisor.close()


@pytest.fixture
def setup(tmp_path):
    return Setup(tmp_path)


def test_a_flight_is_noted_from_arming_to_disarming(setup, tmp_path):
    def flight():
        setup.fly(3, armed=False, landed="on_ground")
        setup.waypoint_status = SimpleNamespace(
            started_unix_s=1e9 + 104, name="Bridge", plan_id="p1", version=2, dry_run=None
        )
        setup.fly(10)
        setup.recording = "second.tlog"
        setup.fly(5)
        assert setup.notes.any_flying()
        setup.fly(2, armed=False, landed="on_ground", mode="Land")

    run(setup, flight)
    assert setup.ended == [["first.tlog", "second.tlog"]]
    assert not setup.notes.any_flying()
    (head,) = NotesStore(tmp_path / "notes").heads()
    assert (head.vehicle, head.plan, head.recordings) == ("1", "Bridge", ("first.tlog", "second.tlog"))
    flight = head.flight
    assert (flight.uid, flight.ended, flight.starts_armed) == ("00aa", "landed", False)
    assert flight.begin_boot_s == pytest.approx(44.0)  # booted at 60, armed at 104
    assert flight.duration_s == pytest.approx(15.0)
    assert flight.modes == ("Mission", "Land")
    details = json.loads(setup.store.details(head.id))
    assert details["parameters"] == {"MPC_XY_VEL_MAX": 12.0}
    assert details["plan"]["flown"] == {"started_unix_s": 1e9 + 101}
    assert [each["client"] for each in details["commands"]] == ["Ann"]
    assert {vehicle for vehicle, _, _ in setup.asked} == {"1"}


@pytest.mark.parametrize(
    ("body", "used"),
    [
        (b'{"nominal": {"battery_start_share": 0.9, "battery_end_share": 0.6}, "group": null, "x": 1}', 0.3),
        (b'{"nominal": {"battery_start_share": 0.9, "battery_end_share": null}, "group": null}', None),
        (b'{"nominal": {"battery_start_share": 0.9, "battery_end_share": 0.6}, "group": {"a": 1}}', None),
        (b"{}", None),
    ],
)
def test_what_the_dry_run_used_of_the_battery_is_noted_if_it_is_of_this_vehicle(setup, body, used):
    setup.dry_run = body

    def flight():
        setup.fly(3, armed=False, landed="on_ground")
        setup.waypoint_status = SimpleNamespace(
            started_unix_s=1e9 + 104, name="Bridge", plan_id="p1", version=2, dry_run="d1"
        )
        setup.fly(3)
        setup.fly(2, armed=False, landed="on_ground")

    run(setup, flight)
    (head,) = setup.store.heads()
    plan = json.loads(setup.store.details(head.id))["plan"]
    assert (plan["dry_run"], plan["predicted_battery_used_share"]) == ("d1", used)


def test_a_vehicle_that_flew_before_the_server_started_is_said_to_start_armed(setup):
    run(setup, lambda: setup.fly(2))
    (head,) = setup.store.heads()
    assert (head.flight.starts_armed, head.flight.ended) == (True, "log_ends")


def test_what_was_known_is_on_disk_while_the_vehicle_flies(setup, tmp_path):
    run(setup, lambda: setup.fly(int(2 * WRITE_EVERY_S) + 3))
    (head,) = NotesStore(tmp_path / "notes").heads()  # as after kill -9
    assert head.flight.duration_s >= WRITE_EVERY_S
    setup.notes.close()
    (head,) = NotesStore(tmp_path / "notes").heads()
    assert head.flight.duration_s == pytest.approx(2 * WRITE_EVERY_S + 2)


def test_a_replay_is_not_noted_and_a_removed_vehicle_ends_its_notes(setup):
    setup.vehicle.identity.replayed = True
    run(setup, lambda: setup.fly(3))
    assert setup.store.heads() == []
    setup.vehicle.identity.replayed = False

    def removed():
        setup.fly(3)
        setup.fleet.clear()
        setup.notes.detach(setup.vehicle)

    run(setup, removed)
    assert len(setup.store.heads()) == 1
    assert not setup.notes.any_flying()


def test_a_full_disk_costs_the_notes_and_not_the_flight(setup, tmp_path, caplog):
    (tmp_path / "notes").write_bytes(b"a file where the folder should be")
    run(setup, lambda: setup.fly(3))
    assert setup.notes.any_flying()
    assert "cannot be written" in caplog.text
