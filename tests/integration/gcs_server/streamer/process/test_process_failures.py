"""A stream process that dies, hangs or does not read is replaced; the event loop never waits for it."""

import asyncio
import os
import signal
import socket
import time
from dataclasses import replace

import pytest

from gcs_server.errors import Refused
from gcs_server.links.base import DdsAddress
from gcs_server.ros2.external_mode import ModeDeclaration
from gcs_server.streamer.process.worker import Worker
from gcs_server.streamer.separation import GroupGuard
from gcs_server.streamer.values.stream_request import StreamRequest
from tests.integration.gcs_server.streamer.process.streamed_vehicle import (
    HOVER,
    OWN_IDS,
    block_event_loop,
    has_ended,
    snapshot,
    start_stream,
    until,
    with_stream_process,
)


@with_stream_process
async def test_a_killed_process_is_reported_and_restarted_without_its_streams(streams, vehicle):
    number = await start_stream(streams, "1", vehicle)
    pid = streams.pid
    os.kill(pid, signal.SIGKILL)
    await until(lambda: streams.pid != pid)
    await vehicle.receive_pending()
    count = len(vehicle.received_frames)
    assert [(vehicle_id, report.code) for vehicle_id, report in streams.take_reports()] == [("1", "fault")]
    state = streams.state("1")
    assert (state.phase, state.last_end.code) == ("idle", "fault")
    assert not await streams.change("1", StreamRequest(HOVER), snapshot())
    assert streams.active() == []
    streams.update_snapshots({})
    await asyncio.sleep(0.1)
    assert len(vehicle.received_frames) == count
    assert await start_stream(streams, "1", vehicle, attach=False) > number
    await until(lambda: len(vehicle.received_frames) > count)


@with_stream_process
async def test_the_modes_of_a_killed_process_are_lost(streams, vehicle):
    await start_stream(streams, "1", vehicle)
    await streams.register_mode("1", DdsAddress(0, None, "none"), ModeDeclaration("Survey", frozenset()))
    await until(lambda: streams.modes().get("1"))
    pid = streams.pid
    os.kill(pid, signal.SIGKILL)
    await until(lambda: streams.pid != pid)
    (mode,) = streams.modes()["1"]
    assert (mode.name, mode.state, mode.mode) == ("Survey", "lost", None)
    assert mode.reason.endswith("ended")
    await until(lambda: streams.update_snapshots({}) or streams.pid is not None)


@with_stream_process
async def test_a_hanging_process_is_killed_when_a_request_times_out(streams, vehicle, monkeypatch):
    monkeypatch.setattr("gcs_server.streamer.process.calls.ANSWER_TIMEOUT_S", 0.2)
    await start_stream(streams, "1", vehicle)
    pid = streams.pid
    os.kill(pid, signal.SIGSTOP)
    streams.attach("2", vehicle, (8, 1))
    with pytest.raises(Refused, match="restarted"):
        await streams.begin("2", StreamRequest(HOVER), 50.0, snapshot())
    await until(lambda: has_ended(pid))
    assert [(vehicle_id, report.code) for vehicle_id, report in streams.take_reports()] == [("1", "fault")]


@with_stream_process
async def test_a_hanging_process_is_killed_even_without_a_pending_request(streams, vehicle, monkeypatch):
    monkeypatch.setattr("gcs_server.streamer.process.calls.ANSWER_TIMEOUT_S", 0.3)
    await start_stream(streams, "1", vehicle)
    pid = streams.pid
    os.kill(pid, signal.SIGSTOP)
    await until(lambda: streams.update_snapshots({"1": snapshot()}) or streams.pid != pid)
    await until(lambda: has_ended(pid))
    assert [(vehicle_id, report.code) for vehicle_id, report in streams.take_reports()] == [("1", "fault")]


@with_stream_process
async def test_a_stalled_event_loop_does_not_kill_a_healthy_process(streams, vehicle, monkeypatch):
    monkeypatch.setattr("gcs_server.streamer.process.calls.ANSWER_TIMEOUT_S", 0.3)
    await start_stream(streams, "1", vehicle)
    pid = streams.pid
    streams.update_snapshots({"1": snapshot()})
    os.kill(pid, signal.SIGSTOP)  # process and event loop both stop, as on a suspended machine
    streams.update_snapshots({"1": snapshot()})
    block_event_loop(0.6)
    streams.update_snapshots({"1": snapshot()})
    os.kill(pid, signal.SIGCONT)
    for _ in range(5):
        await asyncio.sleep(0.05)
        streams.update_snapshots({"1": snapshot()})
    assert streams.pid == pid


@with_stream_process
async def test_the_event_loop_never_waits_for_the_process(streams, vehicle):
    """While the process hangs, plain calls return at once, and the loop runs while a coroutine waits."""
    await start_stream(streams, "1", vehicle)
    os.kill(streams.pid, signal.SIGSTOP)
    guard = GroupGuard(
        "g",
        {"1": StreamRequest(HOVER)},
        {"1": StreamRequest(HOVER)},
        minimum_m=3.0,
        start_s=time.monotonic() + 9,
        duration_s=9,
    )
    calls = (
        lambda: streams.update_snapshots({"1": snapshot()}),
        streams.links_changed,
        lambda: streams.attach("2", vehicle, (8, 1)),
        streams.active,
        lambda: streams.state("1"),
        lambda: streams.starting("1", 1),
        lambda: streams.cancel_start("1", snapshot(), 1),
        lambda: streams.request_stop("1", snapshot()),
        lambda: streams.inhibit_mode_requests("1"),
        lambda: streams.force_hold("1", "why"),
        lambda: streams.watch(guard),
        lambda: streams.guard("g"),
        streams.watched,
        lambda: streams.disable_guard("g"),
        lambda: streams.unwatch("g"),
        streams.take_reports,
        streams.take_findings,
        lambda: streams.end("1", "stopped", "", 77),
    )
    changing = asyncio.ensure_future(streams.change("1", StreamRequest(HOVER), snapshot()))
    await asyncio.sleep(0)
    slowest_s, cpu_limit_s = 0.0, time.thread_time() + 60
    while not changing.done():
        for call in calls:
            began_s = time.thread_time()
            call()
            slowest_s = max(slowest_s, time.thread_time() - began_s)
        iteration_began_s = time.monotonic()
        await asyncio.sleep(0.01)
        assert time.monotonic() - iteration_began_s < 1.0, "the loop was blocked"
        assert time.thread_time() < cpu_limit_s
    assert not await changing
    assert slowest_s < 0.1
    assert streams.active() == []


@with_stream_process
async def test_a_process_that_reads_nothing_is_killed_when_too_many_bytes_wait_for_it(
    streams, vehicle, monkeypatch
):
    monkeypatch.setattr("gcs_server.streamer.process.calls.MAX_WAITING_BYTES", 2_000_000)
    await start_stream(streams, "1", vehicle)
    pid = streams.pid
    os.kill(pid, signal.SIGSTOP)
    large_snapshot = replace(snapshot(), mode="x" * 300_000)
    began_s = time.monotonic()
    for _ in range(12):
        streams.update_snapshots({"1": large_snapshot})
    assert time.monotonic() - began_s < 1.0, "the calls waited for the process"
    await until(lambda: has_ended(pid))
    assert [(vehicle_id, report.code) for vehicle_id, report in streams.take_reports()] == [("1", "fault")]


@pytest.mark.parametrize("signal_number", [signal.SIGINT, signal.SIGTERM])
@with_stream_process
async def test_signals_for_the_server_do_not_stop_the_streams(streams, vehicle, signal_number):
    await start_stream(streams, "1", vehicle)
    os.kill(streams.pid, signal_number)
    await asyncio.sleep(0.1)
    count = len(vehicle.received_frames)
    await until(lambda: len(vehicle.received_frames) >= count + 3)


def test_overloaded_streams_leave_processor_time_for_other_processes(monkeypatch):
    waits_s = []

    class OverdueScheduler:
        """A clock, and a scheduler whose next setpoint is always overdue."""

        def __init__(self):
            self.now_s = 10.0

        def monotonic_s(self):
            self.now_s += 0.0005
            return self.now_s

        def step(self):
            return self.now_s

        def phases(self):
            return {}

        def guard_phases(self):
            return []

        def modes(self):
            return {}

        def close(self):
            pass

        has_pending_reports = False

    class ClosedPipe:
        has_unsent_data = False

        def fileno(self):
            return 0

        def receive(self):
            raise EOFError

    def select(read, _write, _errors, timeout_s):
        waits_s.append(timeout_s)
        overdue_scheduler.now_s += timeout_s
        return (read if len(waits_s) == 1000 else [], [], [])

    overdue_scheduler = OverdueScheduler()
    monkeypatch.setattr("gcs_server.streamer.process.worker.select.select", select)
    with socket.socket() as sender:
        Worker(ClosedPipe(), sender, OWN_IDS, overdue_scheduler, overdue_scheduler).run()
    # A pause of PAUSE_S (5 ms) after each MAX_BUSY_S (50 ms).
    assert 8 <= sum(wait_s >= 0.005 for wait_s in waits_s) <= 20
