"""The vehicle's flight logs over LOG_* messages with the simulated vehicle, with packet loss."""

import asyncio
import os
from contextlib import suppress

import pytest

from gcs_server.api import log_routes
from gcs_server.clock import SystemClock
from gcs_server.errors import Disconnected, InvalidRequest, LogUnusable, NoReply, Refused
from gcs_server.logbook import transfers
from gcs_server.logbook.downloads import LogDownloads
from gcs_server.logbook.partial_logs import PartialLogs
from gcs_server.mavlink import dialect as d
from gcs_server.vehicle.services import logs as log_service
from gcs_server.vehicle.services.ftp_pieces import PartialFile
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


class Progress:
    """The newest progress of a download."""

    newest = None

    def __call__(self, received, size):
        self.newest = (received, size)


async def downloaded(service, log, *, by_ftp=True, progress=lambda *_: None):
    """Content of a log, and how it was read."""
    path = await service.path_of(log, await service.list()) if by_ftp else None
    file = PartialFile(log.size_bytes)
    done = await service.download(log, path, file, progress)
    return file.content, done


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
        for by_ftp, way in ((True, "FTP"), (False, "LOG_DATA")):
            progress = Progress()
            content, done = await downloaded(service, listed[1], by_ftp=by_ftp, progress=progress)
            assert content == files[1]
            assert done.received_bytes == {way: len(content)}
            assert progress.newest == (len(content), len(content))
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


def test_a_large_log_is_read_by_the_faster_way_after_a_trial_of_both(run_simulated, monkeypatch):
    monkeypatch.setattr(log_service, "TRIAL_BYTES", 1000)
    monkeypatch.setattr(log_service, "TRIAL_S", 0.1)

    async def scenario(service, autopilot, vehicle):
        (log,) = await service.list()
        content, done = await downloaded(service, log)
        assert content == files_of(autopilot)[0]
        assert done.received_bytes.keys() == done.rates_bytes_s.keys() == {"FTP", "LOG_DATA"}
        assert sum(done.received_bytes.values()) == len(content)
        faster = max(done.rates_bytes_s, key=done.rates_bytes_s.get)
        assert done.received_bytes[faster] == max(done.received_bytes.values())

    run_with_logs(run_simulated, scenario)


def test_a_log_without_ftp_is_read_by_log_data(run_simulated):
    async def scenario(service, autopilot, vehicle):
        (log,) = await service.list()
        path = await service.path_of(log, (log,))
        assert path.endswith(".ulg")
        assert await service.path_of(log, (log, log)) is None  # two of this size: which is which is not known
        file = PartialFile(log.size_bytes)
        done = await service.download(log, "/log/another.ulg", file, lambda *_: None)
        assert file.content == files_of(autopilot)[0]
        assert done.received_bytes == {"FTP": 0, "LOG_DATA": log.size_bytes}

    run_with_logs(run_simulated, scenario)


def test_a_cancelled_download_tells_the_vehicle_to_stop(run_simulated):
    async def scenario(service, autopilot, vehicle):
        (log,) = await service.list()
        file = PartialFile(log.size_bytes)
        download = asyncio.ensure_future(service.download(log, None, file, lambda *_: None))
        await asyncio.sleep(0.05)
        download.cancel()
        with pytest.raises(asyncio.CancelledError):
            await download
        await asyncio.sleep(0.1)
        assert autopilot.count(LOG_REQUEST_END) == 1
        assert 0 < file.received < file.size
        await service.download(log, None, file, lambda *_: None)  # continues
        assert file.content == files_of(autopilot)[0]

    run_with_logs(run_simulated, scenario)


def test_a_download_ends_with_the_reason(run_simulated, monkeypatch):
    async def scenario(service, autopilot, vehicle):
        (log,) = await service.list()
        with pytest.raises(NoReply, match=r"sent 0 of .* bytes of log 5"):
            await service.download(FlightLog(5, None, 100), None, PartialFile(100), lambda *_: None)
        for path in (await service.path_of(log, (log,)), None):
            with monkeypatch.context() as patch:
                file = PartialFile(log.size_bytes)
                download = asyncio.ensure_future(service.download(log, path, file, lambda *_: None))
                await asyncio.sleep(0.05)
                patch.setattr(type(vehicle), "flight_state", property(lambda _: _Armed))
                with pytest.raises(Refused, match="is armed"):
                    await download
                with pytest.raises(Refused, match="is armed"):
                    await service.list()
            assert file.received < file.size
        autopilot.alive = False
        with pytest.raises((Disconnected, NoReply)):
            await service.download(log, None, PartialFile(log.size_bytes), lambda *_: None)

    run_with_logs(run_simulated, scenario)


def test_logs_are_erased_and_the_vehicle_lists_none_then(run_simulated):
    async def scenario(service, autopilot, vehicle):
        await service.erase()
        assert files_of(autopilot) == []
        assert await service.list() == ()

    run_with_logs(run_simulated, scenario, loss=0.2, seed=4)


def test_answers_without_an_end_that_nobody_asked_for_end_a_download(run_simulated):
    async def run():
        testbed = MemoryTestbed()
        autopilot = testbed.autopilot(testbed.link())
        try:
            vehicle = await testbed.wait_for_vehicle()
            service = vehicle.service(LogService)
            flooding = True

            def flood():
                for number, offset, count in ((7, 0, 90), (3, 4_000_000_000, 90), (3, 5000, 255), (3, 0, 0)):
                    autopilot.send(d.MAVLink_log_data_message(number, offset, count, [1] * 90))
                if flooding:
                    testbed.loop.call_later(0.01, flood)

            flood()
            file = PartialFile(1000)
            with pytest.raises(NoReply, match="sent 0 of 1,000 bytes"):
                await service.download(FlightLog(3, None, 1000), None, file, lambda *_: None)
            flooding = False
            assert file.received == 0
        finally:
            await testbed.close()

    run_simulated(run)


def logs_in(folder, vehicle):
    """A new server's downloads in a folder."""
    return LogDownloads(vehicle.clock, logbook_in(vehicle.clock, folder), lambda _: vehicle)


def cut_off(monkeypatch, share):
    """The link is lost, as it were, when this share of the next log has arrived."""
    download = LogService.download

    async def ends_early(self, log, path, file, progress):
        def cut(received, size):
            progress(received, size)
            if received > share * size:
                raise Disconnected("The link was lost.")

        monkeypatch.setattr(LogService, "download", download)
        return await download(self, log, path, file, cut)

    monkeypatch.setattr(LogService, "download", ends_early)


def test_a_download_continues_after_a_lost_link_and_after_a_sudden_end_of_the_server(
    run_simulated, tmp_path, monkeypatch
):
    monkeypatch.setattr(transfers, "SAVE_PERIOD_S", 0.0)
    texts = []

    async def scenario(service, autopilot, vehicle):
        (log,) = await service.list()
        content = files_of(autopilot)[0]
        for share, restarted in ((0.3, False), (0.6, True)):
            folder = tmp_path / str(share)
            server = logs_in(folder, vehicle)
            cut_off(monkeypatch, share)
            run = asyncio.ensure_future(server.run("1", log.number, lambda text, _: texts.append(text)))
            if restarted:
                while not server.received_bytes("1", log):  # noqa: ASYNC110 simulated time
                    await asyncio.sleep(0.02)
                run.cancel()  # what was not saved is lost with the server
                with suppress(asyncio.CancelledError):
                    await run
                server = logs_in(folder, vehicle)
                kept = server.received_bytes("1", log)
                assert 0 < kept < log.size_bytes
                run = asyncio.ensure_future(server.run("1", log.number, lambda *_: None))
            result = await run
            if restarted:
                assert sum(result["received_bytes"].values()) == log.size_bytes - kept
            assert (result["size_bytes"], result["verified"]) == (len(content), "crc32")
            assert files_in(folder / "logs") == {result["file"]: content}
            assert server.path_of("1", log).name == result["file"]
        assert any(text.startswith("Waits for the vehicle to continue. The link was lost.") for text in texts)

    run_with_logs(run_simulated, scenario)


def test_what_differs_from_the_checksum_is_deleted(run_simulated, tmp_path, monkeypatch):
    async def scenario(service, autopilot, vehicle):
        (log,) = await service.list()
        server = logs_in(tmp_path, vehicle)
        monkeypatch.setattr("gcs_server.logbook.partial_logs.PartialLog.crc32", lambda _: 1)
        with pytest.raises(LogUnusable, match="differs from the vehicle's checksum"):
            await server.run("1", log.number, lambda *_: None)
        assert files_in(tmp_path / "logs") == {}

    run_with_logs(run_simulated, scenario)


def test_a_damaged_record_of_what_has_arrived_begins_the_download_again(tmp_path):
    logs = PartialLogs(tmp_path, SystemClock())
    log = logs.open("1-2-3-4", 1000)
    assert log.file.put(100, b"x" * 100)
    log.saver()()
    assert logs.received_bytes("1-2-3-4", 1000) == 100
    assert logs.received_bytes("1-2-3-4", 999) == 0
    state = next(tmp_path.glob("*.json"))
    good = state.read_text()
    for bad in ("", "[]", good.replace("[0, 100]", "[0, 2000]"), good.replace("[0, 100]", "[50, 10]")):
        state.write_text(bad)
        assert logs.received_bytes("1-2-3-4", 1000) == 0
        assert logs.open("1-2-3-4", 1000).file.received == 0
    state.write_text(good)
    assert logs.open("1-2-3-4", 1000).file.missing == ((0, 100), (200, 1000))


class _Armed:
    """State of an armed vehicle."""

    armed = True


def test_a_downloaded_log_is_kept_on_the_server(run_simulated, tmp_path, monkeypatch):
    log, content = FlightLog(3, 1795222005.0, 4), b"ULog"
    too_large = FlightLog(5, None, log_service.MAX_BYTES + 1)

    async def logs_of(_):
        return (log, too_large)

    async def no_path(*_):
        return None

    async def content_of(_, downloaded, path, file, progress):
        assert (downloaded, path) == (log, None)
        file.put(0, content)
        return log_service.Download({"LOG_DATA": 4}, {"LOG_DATA": 1.0})

    monkeypatch.setattr(LogService, "list", logs_of)
    monkeypatch.setattr(LogService, "path_of", no_path)
    monkeypatch.setattr(LogService, "download", content_of)

    async def scenario(rig):
        station = rig.station
        station.logbook = logbook_in(station.clock, tmp_path)
        station.log_downloads = LogDownloads(station.clock, station.logbook, station.fleet.get)
        listed, _ = json_of(await log_routes.list_logs(rig.vehicle, station))["logs"]
        assert (listed["number"], listed["received_bytes"], listed["downloaded"]) == (3, 0, None)
        for number, state in ((3, "succeeded"), (4, "failed"), (5, "failed")):
            operation = json_of(await log_routes.download("1", number, station, ANNA))
            with suppress(InvalidRequest):
                await station.operations.wait(operation["id"])
            assert station.operations.get(operation["id"]).state == state
        listed, _ = json_of(await log_routes.list_logs(rig.vehicle, station))["logs"]
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
        with pytest.raises(InvalidRequest, match="not the required text"):
            await log_routes.erase("1", log_routes.EraseLogs(confirm="yes"), station, ANNA)
        assert ("anna", "logs/download", "1", "ok") in journal_entries(station)
        assert journal_entries(station)[-1] == ("anna", "logs/erase", "1", "invalid_request")

    run_with_routes(run_simulated, scenario, flying=False)
