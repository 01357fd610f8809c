"""The vehicle's flight logs over LOG_* messages with the simulated vehicle, with packet loss."""

import asyncio
import os
from contextlib import suppress

import pytest

from gcs_server.api import log_routes
from gcs_server.errors import Disconnected, InvalidRequest, NoReply, Refused
from gcs_server.vehicle.services import logs as log_service
from gcs_server.vehicle.services.logs import FlightLog, LogService
from tests.protocol.api_calls import ANNA, journal_entries, json_of, logbook_in, run_with_routes
from tests.protocol.memory_testbed import MemoryTestbed
from tests.protocol.simulated_autopilot import SimulatedAutopilot

BOOT_UNIX_S = 1795222005
LOG_REQUEST_DATA, LOG_REQUEST_END = 119, 122


def run_with_logs(run_simulated, scenario, *, log_count=1, loss=0.0, seed=0):
    async def run():
        testbed = MemoryTestbed()
        autopilot = SimulatedAutopilot(testbed.link(), log=True, boot_time_unix_s=BOOT_UNIX_S)
        try:
            vehicle = await testbed.wait_for_vehicle()
            logger = autopilot.sim.loggers[0]
            autopilot.sim.simulation.parameters[0].set("SDLOG_MODE", 2)
            for _ in range(log_count):
                assert logger.start_manually()
                await asyncio.sleep(0.3)
                logger.stop()
            autopilot.loss = loss
            autopilot.random.seed(seed)
            await scenario(vehicle.service(LogService), autopilot, vehicle)
        finally:
            autopilot.alive = False
            await testbed.close()

    run_simulated(run)


def files_in(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def files_of(autopilot):
    return [path.read_bytes() for path in sorted((autopilot.sim.files[0].root / "log").rglob("*.ulg"))]


@pytest.mark.parametrize(("loss", "seed"), [(0.0, 1), (0.2, 2)])
def test_logs_are_listed_and_downloaded_completely_at_any_packet_loss(run_simulated, loss, seed):
    async def scenario(service, autopilot, vehicle):
        listed = await service.list()
        files = files_of(autopilot)
        assert [(log.number, log.size_bytes) for log in listed] == [(n, len(f)) for n, f in enumerate(files)]
        assert len(files) == 2
        assert listed[0].ended_unix_s == pytest.approx(BOOT_UNIX_S, abs=60)
        assert listed[0].ended_unix_s <= listed[1].ended_unix_s
        progress = []
        content = await service.download(listed[1], lambda *received: progress.append(received))
        assert content == files[1]
        assert progress[-1] == (len(content), len(content))
        if not loss:
            assert autopilot.count(LOG_REQUEST_DATA) == -(-len(content) // log_service.WINDOW_BYTES)

    run_with_logs(run_simulated, scenario, log_count=2, loss=loss, seed=seed)


def test_logs_are_listed_by_time_because_px4_numbers_them_as_its_file_system_lists_them(run_simulated):
    # v1.17.0 numbered nine logs by no order of time; the time of each was that of the end of its flight.
    async def scenario(service, autopilot, vehicle):
        root = autopilot.sim.files[0].root / "log"
        for path, ended_s in zip(sorted(root.rglob("*.ulg")), (1_795_222_100, 1_795_222_050), strict=True):
            os.utime(path, (ended_s, ended_s))
        listed = await service.list()
        assert [(log.number, log.ended_unix_s) for log in listed] == [(1, 1_795_222_050), (0, 1_795_222_100)]

    run_with_logs(run_simulated, scenario, log_count=2)


def test_a_vehicle_without_logs_has_an_empty_list(run_simulated):
    async def scenario(service, autopilot, vehicle):
        autopilot.sim.files[0].delete_tree("log")
        assert await service.list() == ()

    run_with_logs(run_simulated, scenario)


def test_a_cancelled_download_tells_the_vehicle_to_stop(run_simulated):
    async def scenario(service, autopilot, vehicle):
        (log,) = await service.list()
        download = asyncio.ensure_future(service.download(log, lambda *_: None))
        await asyncio.sleep(0.02)
        download.cancel()
        with pytest.raises(asyncio.CancelledError):
            await download
        await asyncio.sleep(0.1)
        assert autopilot.count(LOG_REQUEST_END) == 1
        assert await service.download(log, lambda *_: None) == files_of(autopilot)[0]

    run_with_logs(run_simulated, scenario)


def test_a_download_ends_with_the_reason(run_simulated, monkeypatch):
    async def scenario(service, autopilot, vehicle):
        (log,) = await service.list()
        too_large = FlightLog(0, None, log_service.MAX_BYTES + 1)
        with pytest.raises(InvalidRequest, match="are not downloaded"):
            await service.download(too_large, lambda *_: None)
        with pytest.raises(NoReply, match=r"sent 0 of .* bytes of log 5"):
            await service.download(FlightLog(5, None, 100), lambda *_: None)
        with monkeypatch.context() as patch:
            patch.setattr(log_service, "WINDOW_BYTES", 9000)
            download = asyncio.ensure_future(service.download(log, lambda *_: None))
            await asyncio.sleep(0.01)
            patch.setattr(type(vehicle), "flight_state", property(lambda _: _Armed))
            with pytest.raises(Refused, match="is armed"):
                await download
            with pytest.raises(Refused, match="is armed"):
                await service.list()
        autopilot.alive = False
        with pytest.raises((Disconnected, NoReply)):
            await service.download(log, lambda *_: None)

    run_with_logs(run_simulated, scenario)


class _Armed:
    """State of an armed vehicle."""

    armed = True


def test_a_downloaded_log_is_kept_on_the_server(run_simulated, tmp_path, monkeypatch):
    log, content = FlightLog(3, 1795222005.0, 4), b"ULog"

    async def logs_of(_):
        return (log,)

    async def content_of(_, downloaded, progress):
        assert downloaded == log
        return content

    monkeypatch.setattr(LogService, "list", logs_of)
    monkeypatch.setattr(LogService, "download", content_of)

    async def scenario(rig):
        station = rig.station
        station.logbook = logbook_in(station.clock, tmp_path)
        (listed,) = json_of(await log_routes.list_logs(rig.vehicle, station))["logs"]
        assert (listed["number"], listed["downloaded"]) == (3, None)
        for number, state in ((3, "succeeded"), (4, "failed")):
            operation = json_of(await log_routes.download("1", number, station, ANNA))
            with suppress(InvalidRequest):
                await station.operations.wait(operation["id"])
            assert station.operations.get(operation["id"]).state == state
        (listed,) = json_of(await log_routes.list_logs(rig.vehicle, station))["logs"]
        name = listed["downloaded"]["file"]
        file = await log_routes.log_file("1", name, station)
        assert files_in(tmp_path / "logs") == {name: content}
        assert file.path == tmp_path / "logs" / name
        (flight,) = await station.logbook.files()
        assert (flight.id, flight.source) == (listed["downloaded"]["flight"], "vehicle")
        assert flight.summary == {"problem": "No log is read here."}
        for name in ("../secret", "missing.ulg"):
            with pytest.raises(InvalidRequest):
                await log_routes.log_file("1", name, station)
        assert journal_entries(station)[0] == ("anna", "logs/download", "1", "ok")

    run_with_routes(run_simulated, scenario, flying=False)
