"""The vehicle's log streamed over LOGGING_DATA by the simulated vehicle: complete without loss, always a
valid log with its gaps at any loss, over a lost link and a restart; one client at a time."""

import asyncio
from contextlib import suppress

import pytest

from gcs_server.errors import NoReply, Refused
from gcs_server.logbook.streams import LogStreams
from gcs_server.logbook.ulog import read_ulog
from gcs_server.vehicle.services.log_stream import LogStreamService
from tests.protocol.api_calls import logbook_in
from tests.protocol.memory_testbed import MemoryTestbed
from tests.protocol.simulated_autopilot import SimulatedAutopilot

LOGGING_ACK = 268


def run_with_stream(run_simulated, tmp_path, scenario, *, loss=0.0, seed=0, log=True):
    async def run():
        testbed = MemoryTestbed()
        autopilot = SimulatedAutopilot(testbed.link(), log=log)
        try:
            vehicle = await testbed.wait_for_vehicle()
            autopilot.loss = loss
            autopilot.random.seed(seed)
            streams = LogStreams(vehicle.clock, logbook_in(vehicle.clock, tmp_path), lambda _: vehicle)
            await scenario(streams, autopilot, vehicle)
        finally:
            autopilot.alive = False
            await testbed.close()

    run_simulated(run)


class Report:
    """The texts of an operation's progress."""

    def __init__(self):
        self.texts = []

    def __call__(self, text, fraction):
        self.texts.append(text)


async def streamed(streams, seconds, report=lambda *_: None):
    """The result of a stream that is stopped after some seconds."""
    running = asyncio.ensure_future(streams.run("1", report))
    await asyncio.sleep(seconds)
    await streams.stop("1")
    return await running


def only_log(tmp_path):
    (path,) = (tmp_path / "logs").iterdir()
    return read_ulog(path)


def test_a_streamed_log_is_that_of_the_vehicle(run_simulated, tmp_path):
    async def scenario(streams, autopilot, vehicle):
        logger = autopilot.sim.loggers[0]
        assert logger.start_manually()
        report = Report()
        result = await streamed(streams, 12, report)
        logger.stop()
        assert (result["lost_share"], result["dropouts"], result["ended"]) == (0.0, 0, None)
        assert any("0.0% lost" in text for text in report.texts)
        assert streams.paths() == frozenset()
        own = read_ulog(next((autopilot.sim.files[0].root / "log").rglob("*.ulg")))
        log = only_log(tmp_path)
        assert log.parameters == own.parameters
        assert log.problems == []
        topics = {topic.id: topic for topic in log.topics}
        assert {"vehicle_attitude:0", "vehicle_status:0", "battery_status:0"} <= topics.keys()
        for topic in own.topics:  # all that the vehicle wrote while the stream ran
            if topic.id not in topics:
                assert topic.name == "event"  # before the stream began
                continue
            got = topics[topic.id].times_s + log.start_boot_s
            times_s = topic.times_s + own.start_boot_s
            during = times_s[(times_s >= got[0] - 1e-6) & (times_s <= got[-1] + 1e-6)]
            if len(got) > 50:
                assert len(got) == len(during), topic.id
        assert 9 < log.duration_s < 13

    run_with_stream(run_simulated, tmp_path, scenario)


@pytest.mark.parametrize("seed", [1, 2])
def test_at_any_loss_it_is_a_valid_log_with_its_gaps(run_simulated, tmp_path, seed):
    async def scenario(streams, autopilot, vehicle):
        result = await streamed(streams, 15)
        assert 0.1 < result["lost_share"] < 0.3
        log = only_log(tmp_path)
        assert log.problems == []
        assert len(log.dropouts) == result["dropouts"] > 20
        assert len(log.parameters) > 500  # definitions are repeated until they are acknowledged
        assert log.duration_s > 8
        assert autopilot.count(LOGGING_ACK) > 50

    run_with_stream(run_simulated, tmp_path, scenario, loss=0.2, seed=seed)


def test_it_goes_on_after_a_lost_link(run_simulated, tmp_path):
    async def scenario(streams, autopilot, vehicle):
        report = Report()
        running = asyncio.ensure_future(streams.run("1", report))
        await asyncio.sleep(10)
        autopilot.loss = 1.0
        await asyncio.sleep(20)
        assert "Waits for the vehicle to continue." in report.texts
        autopilot.loss = 0.0
        await asyncio.sleep(10)
        await streams.stop("1")
        result = await running
        log = only_log(tmp_path)
        assert result["dropouts"] == len(log.dropouts) == 1
        assert log.dropouts[0][1] > 15
        assert log.duration_s > 35

    run_with_stream(run_simulated, tmp_path, scenario)


def test_it_ends_with_the_reason_when_the_vehicle_has_restarted(run_simulated, tmp_path):
    async def scenario(streams, autopilot, vehicle):
        running = asyncio.ensure_future(streams.run("1", lambda *_: None))
        await asyncio.sleep(10)
        autopilot.sim.nodes[0]._log_stream._end()  # a restarted PX4 streams to nobody
        result = await running
        assert "sends no more" in result["ended"]
        assert only_log(tmp_path).duration_s > 5

    run_with_stream(run_simulated, tmp_path, scenario)


def test_another_clients_stream_is_refused_and_can_be_stopped(run_simulated, tmp_path):
    async def scenario(streams, autopilot, vehicle):
        service = autopilot.sim.nodes[0]._log_stream
        service._stream = autopilot.sim.loggers[0].start_stream()
        with pytest.raises(Refused, match="streams already"):
            await streams.run("1", lambda *_: None)
        assert list((tmp_path / "logs").iterdir()) == []
        assert await streams.stop("1") is False
        assert not service.busy
        assert (await streamed(streams, 5))["ended"] is None

    run_with_stream(run_simulated, tmp_path, scenario)


def test_a_vehicle_that_sends_nothing_is_said(run_simulated, tmp_path):
    async def scenario(streams, autopilot, vehicle):
        with pytest.raises(NoReply, match="accepted to stream its log, and sent nothing"):
            await streams.run("1", lambda *_: None)

    run_with_stream(run_simulated, tmp_path, scenario, log=False)


def test_a_cancelled_stream_tells_the_vehicle_to_stop_and_keeps_what_came(run_simulated, tmp_path):
    async def scenario(streams, autopilot, vehicle):
        running = asyncio.ensure_future(streams.run("1", lambda *_: None))
        await asyncio.sleep(8)
        assert len(streams.paths()) == 1
        running.cancel()
        with suppress(asyncio.CancelledError):
            await running
        await asyncio.sleep(1)
        assert not autopilot.sim.nodes[0]._log_stream.busy
        assert only_log(tmp_path).duration_s > 3

    run_with_stream(run_simulated, tmp_path, scenario)


def test_a_client_that_acknowledges_nothing_gets_nothing_more(run_simulated, tmp_path):
    async def scenario(streams, autopilot, vehicle):
        service = autopilot.sim.nodes[0]._log_stream
        vehicle.service(LogStreamService)._command(2510, 0)
        await asyncio.sleep(1)
        assert service.busy
        await asyncio.sleep(2)
        assert not service.busy  # after 50 tries of 50 ms

    run_with_stream(run_simulated, tmp_path, scenario)
