"""What happens with a vehicle's log after its flight, with the simulated vehicle's logs on simulated time."""

import asyncio
from dataclasses import replace
from types import SimpleNamespace

import pytest

from gcs_server.api import after_landing_routes
from gcs_server.errors import Refused
from gcs_server.logbook import after_landing
from gcs_server.logbook.after_landing import AfterLanding
from gcs_server.logbook.downloads import NEAR_S, LogDownloads
from gcs_server.operations.operations import Operations
from gcs_server.storage.folder import StorageError
from gcs_server.storage.records import Records
from gcs_server.vehicle.services.logs import LogService
from tests.protocol.api_calls import ANNA, journal_entries, json_of, logbook_in, run_with_routes
from tests.protocol.memory_testbed import MemoryTestbed
from tests.protocol.simulated_autopilot import SimulatedAutopilot

BOOT_UNIX_S = 1795222005
LOG_S = 0.3


class Rig:
    """A server with one simulated vehicle, whose arming and flight a test tells."""

    def __init__(self, testbed, autopilot, vehicle, folder, monkeypatch):
        self.testbed, self.autopilot, self.vehicle, self.folder = testbed, autopilot, vehicle, folder
        self.started = []
        self.state = vehicle.flight_state
        monkeypatch.setattr(type(vehicle), "flight_state", property(lambda _: self.state))
        autopilot.sim.simulation.parameters[0].set("SDLOG_MODE", 2)
        self.start_server()

    def start_server(self):
        testbed, folder = self.testbed, self.folder
        self.operations = Operations(testbed.clock, testbed.supervisor, lambda _: None)
        self.downloads = LogDownloads(testbed.clock, logbook_in(testbed.clock, folder), testbed.fleet.get)
        records = Records(folder / "after_landing")
        self.after = AfterLanding(
            testbed.clock, testbed.fleet, self.operations, self.downloads, records, self.started.append
        )
        self.after.load()

    def arm(self, *, landed="in_air"):
        self.state = replace(self.state, armed=True, landed_state=landed)
        self.after.update()

    def disarm(self):
        self.state = replace(self.state, armed=False, landed_state="on_ground")
        self.after.update()

    async def fly(self):
        """Flies, logs meanwhile, and lands."""
        self.arm()
        assert self.autopilot.sim.loggers[0].start_manually()
        await asyncio.sleep(LOG_S)
        self.autopilot.sim.loggers[0].stop()
        self.disarm()

    def shown(self):
        return self.after.of(self.vehicle)

    async def until(self, state, text=""):
        for _ in range(600):
            self.after.update()
            if self.shown().state == state and text in self.shown().text:
                return
            await asyncio.sleep(0.1)
        raise AssertionError(f"it is {self.shown()}")

    @property
    def on_server(self):
        return sorted(path.read_bytes() for path in (self.folder / "logs").glob("*.ulg"))

    @property
    def on_vehicle(self):
        return sorted(path.read_bytes() for path in self.autopilot.sim.files[0].root.rglob("*.ulg"))


@pytest.fixture
def run_rig(run_simulated, tmp_path, monkeypatch):
    def run(scenario):
        async def run_scenario():
            testbed = MemoryTestbed()
            autopilot = SimulatedAutopilot(testbed.link(), log=True, boot_time_unix_s=BOOT_UNIX_S)
            try:
                vehicle = await testbed.wait_for_vehicle()
                await scenario(Rig(testbed, autopilot, vehicle, tmp_path, monkeypatch))
            finally:
                autopilot.alive = False
                await testbed.close()

        run_simulated(run_scenario)

    return run


def test_the_log_of_a_flight_is_offered_after_the_landing_and_downloaded_when_accepted(run_rig):
    async def scenario(rig):
        assert rig.shown() is None
        with pytest.raises(Refused, match="has seen no flight of vehicle 1"):
            rig.after.download("1")
        rig.arm(landed="on_ground")
        rig.disarm()
        assert rig.shown() is None, "it was armed, and did not fly"
        await rig.fly()
        ended_unix_s = rig.testbed.clock.unix_s()
        assert (rig.shown().state, rig.shown().ended_unix_s) == ("offered", pytest.approx(ended_unix_s))
        operation = rig.after.download("1", ("anna", "anna's key"))
        assert rig.after.download("1") == operation
        await rig.until("running", "Waits until the vehicle has closed its log.")
        await rig.until("succeeded")
        assert rig.on_server == rig.on_vehicle
        assert rig.shown().flight == rig.operations.get(operation.id).result["flight"]
        rig.arm()
        assert rig.shown().state == "none", "a new flight has begun"
        assert rig.started == []

    run_rig(scenario)


def test_the_server_downloads_by_itself_pauses_while_the_vehicle_is_armed_and_takes_both_logs(run_rig):
    async def scenario(rig):
        await rig.after.choose("download")
        await rig.fly()
        await rig.until("running", "received")
        rig.arm()
        await rig.until("running", "Paused while vehicle 1 is armed")
        sent = len(rig.autopilot.received_frames)
        await asyncio.sleep(5.0)
        requests = [data for data in rig.autopilot.received_frames[sent:] if data[7] in (110, 117, 119)]
        assert requests == [], "nothing is requested while the vehicle is armed"
        assert rig.on_server == []
        await rig.fly()
        await rig.until("succeeded")
        for operation in rig.operations.all():
            assert (await rig.operations.wait(operation.id)).state == "succeeded"
        assert len(rig.on_vehicle) == 2
        assert rig.on_server == rig.on_vehicle
        assert rig.started == ["1", "1"]

    run_rig(scenario)


def test_a_download_pauses_during_a_plan_transfer(run_rig):
    async def scenario(rig):
        await rig.after.choose("download")
        await rig.fly()
        await rig.until("running", "received")
        with rig.vehicle.mission._transfer("an upload"):
            await rig.until("running", "Paused while a plan is transferred to or from vehicle 1.")
        await rig.until("succeeded")
        assert rig.on_server == rig.on_vehicle

    run_rig(scenario)


def test_what_is_not_downloaded_yet_outlives_the_server(run_rig):
    async def scenario(rig):
        await rig.after.choose("download")
        rig.arm()
        rig.autopilot.sim.loggers[0].start_manually()
        await asyncio.sleep(LOG_S)
        rig.autopilot.sim.loggers[0].stop()
        rig.disarm()
        await asyncio.sleep(0.1)
        await rig.operations.close()  # the server ends while it waits
        rig.after.close()
        rig.start_server()
        assert rig.after.choice == "download"
        await rig.until("succeeded")
        assert rig.on_server == rig.on_vehicle
        rig.after.close()
        rig.start_server()
        rig.after.update()
        assert rig.shown() is None, "a downloaded log is not offered again"

    run_rig(scenario)


def test_an_offer_is_declined_and_a_download_cancelled(run_rig):
    async def scenario(rig):
        await rig.fly()
        await rig.after.drop("1")
        assert rig.shown().state == "none"
        await rig.after.choose("download")
        await rig.fly()
        await rig.until("running", "received")
        (operation,) = rig.operations.all()
        await rig.after.drop("1")
        assert (rig.shown().state, rig.operations.get(operation.id).state) == ("none", "cancelled")
        await rig.after.choose("never")
        await rig.fly()
        assert rig.shown().state == "none"

    run_rig(scenario)


def test_an_offer_ends_when_its_log_is_downloaded_by_hand_and_stays_with_another_log(run_rig):
    async def scenario(rig):
        await rig.fly()
        await asyncio.sleep(2 * NEAR_S)
        await rig.fly()
        older, newer = await rig.vehicle.service(LogService).list()
        await rig.downloads.run("1", older.number, lambda *_: None)
        assert rig.shown().state == "offered", "another flight's log"
        await rig.downloads.run("1", newer.number, lambda *_: None)
        assert rig.shown().state == "none"
        assert len(rig.on_server) == 2

    run_rig(scenario)


def test_a_vehicle_without_a_new_log_says_so_and_can_be_asked_again(run_rig):
    async def scenario(rig):
        rig.autopilot.sim.loggers[0].stop()
        rig.autopilot.sim.files[0].delete_tree("log")
        rig.arm()
        rig.disarm()
        rig.after.download("1")
        await rig.until("failed", "Vehicle 1 has no log.")
        await rig.fly()
        rig.after.download("1")
        await rig.until("succeeded")
        rig.arm()
        rig.disarm()
        rig.after.download("1")
        await rig.until("failed", "The newest log of vehicle 1 is already on the server.")
        before = rig.operations.all()
        rig.after.download("1")
        assert len(rig.operations.all()) == len(before) + 1

    run_rig(scenario)


def test_several_vehicles_are_downloaded_a_few_at_a_time(run_rig):
    async def scenario(rig):
        def other(n):
            return SimpleNamespace(
                id=str(n),
                flight_state=rig.state,
                link_lost=n == 7,
                identity=SimpleNamespace(commandable=n != 8, replayed=n == 9),
                reach=SimpleNamespace(missing=("files",) if n == 6 else ()),
            )

        others = [other(n) for n in range(2, 10)]
        rig.after._fleet = SimpleNamespace(all=lambda: others)
        await rig.after.choose("download")
        for each in others:
            each.flight_state = SimpleNamespace(armed=True, landed_state="in_air")
        rig.after.update()
        for each in others:
            each.flight_state = SimpleNamespace(armed=False, landed_state="on_ground")
        rig.after.update()
        states = {each.id: state and state.state for each in others if (state := rig.after.of(each)) or 1}
        assert states == {
            **dict.fromkeys("2345", "running"),
            "6": None,  # its links carry no files
            "7": "waiting",  # lost
            "8": None,  # not verified
            "9": None,  # a replay
        }
        assert len(rig.started) == after_landing.MAX_RUNNING
        await rig.operations.close()

    run_rig(scenario)


def test_a_damaged_or_unwritable_record_is_a_warning_and_the_log_is_offered(run_rig):
    async def scenario(rig):
        folder = rig.folder / "after_landing"
        folder.mkdir()
        for bad in ('{"choice": "always", "open": []}', "[]", '{"choice": "never", "open": [{}]}'):
            (folder / "after_landing.json").write_text(bad)
            rig.start_server()
            assert "cannot be read" in rig.after.warnings()
            await rig.fly()
            assert rig.shown().state == "offered"
            assert (folder / "after_landing.json").read_text() == bad
        await rig.after.choose("never")
        assert rig.after.warnings() is None
        (rig.folder / "a file").write_text("")
        rig.after._records = Records(rig.folder / "a file" / "folder")
        with pytest.raises(StorageError, match="The choice cannot be stored"):
            await rig.after.choose("offer")
        assert rig.after.choice == "never"
        assert "cannot be stored" in rig.after.warnings()

    run_rig(scenario)


def test_the_choice_is_set_and_an_offer_declined_by_the_api(run_simulated, tmp_path):
    async def scenario(rig):
        station = rig.station
        station.after_landing._records = Records(tmp_path)
        answer = json_of(await after_landing_routes.read_choice(station))
        assert answer == {"choice": "offer", "landed": {}}
        station.after_landing.update()
        with pytest.raises(Refused, match="is armed"):
            await after_landing_routes.download_landed("1", station, ANNA)
        rig.autopilot.land_and_disarm()
        await asyncio.sleep(1.0)
        station.after_landing.update()
        answer = json_of(await after_landing_routes.read_choice(station))
        assert answer["landed"]["1"]["state"] == "offered"
        operation = json_of(await after_landing_routes.download_landed("1", station, ANNA))
        assert (operation["kind"], operation["vehicle"], operation["client"]) == (
            "logs/download",
            "1",
            "anna",
        )
        await after_landing_routes.decline("1", station, ANNA)
        assert station.operations.get(operation["id"]).state == "cancelled"
        body = after_landing_routes.AfterLandingChoice(choice="download")
        assert json_of(await after_landing_routes.choose(body, station, ANNA))["choice"] == "download"
        assert journal_entries(station)[-3:] == [
            ("anna", "logs/download", "1", "ok"),
            ("anna", "logs/decline", "1", "ok"),
            ("anna", "logs/after_landing", None, "ok"),
        ]

    run_with_routes(run_simulated, scenario)
