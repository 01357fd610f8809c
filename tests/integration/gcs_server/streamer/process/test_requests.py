"""The stream process executes and confirms the server's requests at once; a stalled event loop does not delay
the process."""

import asyncio
import os
import signal
import time
from dataclasses import replace

import pytest

from gcs_server.errors import Refused
from gcs_server.streamer.separation import GroupGuard
from gcs_server.streamer.values.limit_values import Bounds
from gcs_server.streamer.values.stream_request import OnExpiry, StreamRequest
from missions.geodesy import LocalOrigin
from missions.setpoints import Follow, Velocity
from tests.integration.gcs_server.streamer.process.streamed_vehicle import (
    HOVER,
    VELOCITY_ONLY,
    StreamedVehicle,
    block_event_loop,
    has_ended,
    snapshot,
    start_stream,
    type_mask,
    until,
    with_stream_process,
)


@with_stream_process
async def test_the_stream_continues_during_a_short_stall_of_the_loop_and_stops_after_a_long_stall(
    streams, vehicle
):
    await start_stream(streams, "1", vehicle)
    streams.update_snapshots({"1": snapshot()})
    block_event_loop(0.8)
    await until(lambda: streams.active() == [])
    assert 15 <= len(vehicle.received_frames) <= 40, (
        "not about half a second at 50 Hz plus the setpoints of the start"
    )
    count = len(vehicle.received_frames)
    await asyncio.sleep(0.2)
    assert len(vehicle.received_frames) == count
    assert [report.code for _, report in streams.take_reports()] == ["server_silent"]
    assert streams.take_reports() == []


@with_stream_process
async def test_a_change_is_sent_at_once(streams, vehicle):
    await start_stream(streams, "1", vehicle, rate_hz=2.0)
    await until(lambda: vehicle.recorded_frames)
    count = len(vehicle.recorded_frames)
    assert await streams.change("1", StreamRequest(Velocity(velocity_ned_m_s=(1, 0, 0)), 60.0), snapshot())
    changed_us = time.clock_gettime(time.CLOCK_REALTIME) * 1e6
    assert streams.state("1").sent.velocity_ned_m_s == (1, 0, 0)
    await until(lambda: type_mask(vehicle.recorded_frames[-1][1]) == VELOCITY_ONLY)
    sent_us = next(
        time_us for time_us, raw in vehicle.recorded_frames[count:] if type_mask(raw) == VELOCITY_ONLY
    )
    assert sent_us <= changed_us, "sent at the next period, not before the call returned"


@with_stream_process
async def test_a_snapshot_that_cannot_be_pickled_affects_only_its_vehicle(streams, vehicle):
    other_vehicle = StreamedVehicle()
    await start_stream(streams, "1", vehicle)
    await start_stream(streams, "2", other_vehicle)
    for _ in range(8):  # longer than the limit for a silent server
        unpicklable = replace(snapshot(), mode_requested_by=lambda: "cannot be pickled")
        streams.update_snapshots({"1": unpicklable, "2": snapshot()})
        await asyncio.sleep(0.1)
    count = len(other_vehicle.received_frames)
    await until(lambda: len(other_vehicle.received_frames) > count)
    assert streams.state("2").phase == "streaming"
    other_vehicle.close()


@with_stream_process
async def test_a_start_that_is_cancelled_while_the_process_replies_leaves_no_stream(streams, vehicle):
    streams.attach("1", vehicle, (7, 1))
    await streams.ready()
    starting = asyncio.ensure_future(streams.begin("1", StreamRequest(HOVER, 60.0), 50.0, snapshot()))
    await asyncio.sleep(0)  # the request is sent, and the reply is not received yet
    starting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await starting
    await until(lambda: streams.state("1").last_end is not None)
    await asyncio.sleep(0.1)
    count = len(vehicle.received_frames)
    await asyncio.sleep(0.1)
    assert (len(vehicle.received_frames), streams.active()) == (count, [])
    assert await start_stream(streams, "1", vehicle, attach=False) == 2  # the cancelled start was number 1


@with_stream_process
async def test_a_renewal_of_a_whole_group_is_visible_directly_after_the_call(streams, vehicle):
    await start_stream(streams, "1", vehicle)
    request, now_s = StreamRequest(HOVER, 5.0), time.monotonic()

    def snapshot_with_origin():
        return replace(snapshot(), bounds=Bounds(origin=LocalOrigin(47.0, 8.0, 500.0)))

    assert await streams.change("1", request, snapshot_with_origin())
    streams.watch(
        GroupGuard("g", {"1": request}, {"1": request}, minimum_m=3.0, start_s=now_s + 0.1, duration_s=5.0)
    )
    await until(
        lambda: (
            streams.update_snapshots({"1": snapshot_with_origin()}) or streams.guard("g").phase == "flying"
        )
    )
    assert streams.state("1").valid_left_s < 5.2
    assert await streams.change_together("g", {}, {}, time.monotonic() + 50.0)
    assert streams.state("1").valid_left_s > 45.0
    assert streams.guard("g").until_s > time.monotonic() + 45.0


@with_stream_process
async def test_an_ended_stream_is_idle_before_the_process_reports_it(streams, vehicle):
    number = await start_stream(streams, "1", vehicle)
    streams.end("1", "stopped", "The stream was stopped.", number)
    state = streams.state("1")
    assert (state.phase, state.last_end.code, state.number) == ("idle", "stopped", number)
    assert not streams.starting("1", number)
    second_number = await streams.begin("1", StreamRequest(HOVER, 60.0), 50.0, snapshot())
    assert (second_number, streams.state("1").phase) == (number + 1, "starting")


@with_stream_process
async def test_the_event_loop_continues_while_the_process_starts(streams, vehicle, monkeypatch):
    """If the loop waited for the process, the server would receive nothing from vehicles during a restart."""
    iterations = []

    async def count_iterations():
        while True:
            iterations.append(streams.pid)
            await asyncio.sleep(0.005)

    counting = asyncio.ensure_future(count_iterations())
    streams.attach("1", vehicle, (7, 1))
    await until(lambda: streams.pid)
    os.kill(streams.pid, signal.SIGSTOP)
    pid, began_s = streams.pid, time.monotonic()
    waiting = asyncio.ensure_future(streams.ready())
    await asyncio.sleep(0.2)
    assert not waiting.done()
    assert len(iterations) > 5
    os.kill(pid, signal.SIGCONT)
    await waiting
    assert time.monotonic() - began_s >= 0.2
    os.kill(pid, signal.SIGKILL)
    await until(lambda: streams.update_snapshots({}) or streams.pid not in (None, pid))
    os.kill(streams.pid, signal.SIGSTOP)
    monkeypatch.setattr("gcs_server.streamer.process.streams.START_TIMEOUT_S", 0.1)
    with pytest.raises(Refused, match="restarted"):
        await streams.ready()
    os.kill(streams.pid, signal.SIGCONT)
    monkeypatch.setattr("gcs_server.streamer.process.streams.START_TIMEOUT_S", 10.0)
    await streams.ready()
    assert await start_stream(streams, "1", vehicle, attach=False)
    counting.cancel()


@with_stream_process
async def test_an_invalid_setpoint_is_an_error_and_ends_no_stream(streams, vehicle):
    await start_stream(streams, "1", vehicle)
    with pytest.raises(ValueError, match="vehicle 2 sends no position"):
        await streams.change("1", StreamRequest(Follow("2"), 60.0), snapshot())
    assert streams.active() == ["1"]


@with_stream_process
async def test_the_process_executes_and_reports_an_expiry(streams, vehicle):
    await start_stream(streams, "1", vehicle, request=StreamRequest(HOVER, 0.1, OnExpiry("stop_stream")))
    await until(lambda: streams.update_snapshots({"1": snapshot()}) or not streams.active())
    assert "expired" in [report.code for _, report in streams.take_reports()]


@with_stream_process
async def test_a_second_start_is_refused_and_close_ends_stream_and_process(streams, vehicle):
    await start_stream(streams, "1", vehicle)
    assert not await streams.begin("1", StreamRequest(HOVER), 50.0, snapshot())
    pid = streams.pid
    streams.close()
    await asyncio.sleep(0.1)  # sent frames are received
    count = len(vehicle.received_frames)
    await asyncio.sleep(0.1)
    assert len(vehicle.received_frames) == count
    assert has_ended(pid)
    with pytest.raises(Refused):
        await streams.ready()


@with_stream_process
async def test_the_guard_of_a_mission_watches_vehicles_that_have_no_stream_yet(streams, vehicle):
    streams.attach("1", vehicle, (7, 1))
    streams.attach("2", vehicle, (8, 1))
    await streams.ready()

    def armed_snapshots():
        armed = replace(snapshot(), armed=True, bounds=Bounds(origin=LocalOrigin(47.0, 8.0, 500.0)))
        return {"1": armed, "2": armed}

    members = dict.fromkeys(("1", "2"))
    streams.watch(
        GroupGuard("mission 1", {}, members, minimum_m=3.0, start_s=time.monotonic(), duration_s=float("inf"))
    )
    assert streams.watched() == {"1": None, "2": None}
    await until(
        lambda: streams.update_snapshots(armed_snapshots()) or streams.guard("mission 1").held == {"1", "2"}
    )
    name, finding = streams.take_findings()[0]
    assert (name, finding.code) == ("mission 1", "separation")
