"""The real process and real sockets: punctual, not to be delayed by the server, never flying on unseen."""

import asyncio
import contextlib
import functools
import inspect
import os
import signal
import socket
import struct
import threading
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import common

from gcs_server.clock import SystemClock
from gcs_server.errors import Refused
from gcs_server.links.base import Peer
from gcs_server.mavlink.signing import TICKS_PER_S, FrameSigner, SecretKey, SigningClock
from gcs_server.streamer.bounds import Bounds
from gcs_server.streamer.failsafe import Failsafe
from gcs_server.streamer.group_guard import GroupGuard
from gcs_server.streamer.news import Snapshot
from gcs_server.streamer.order import OnExpiry, Order
from gcs_server.streamer.process import StreamProcess
from gcs_server.streamer.worker import Worker
from missions.geodesy import LocalOrigin
from missions.setpoints import Follow, Position, Velocity

HOVER = Position(position_ned_m=(0.0, 0.0, -5.0), yaw_ned_rad=0.0)
OWN_IDS = (255, 191)
MSG_SET_POSITION_TARGET_LOCAL_NED = 84
VELOCITY_ONLY = 2503
"""The type_mask of a velocity without a yaw rate, its yaw kept."""


class Vehicle:
    """Somebody at the other end of a UDP link (or of another kind), and the link as the server has it."""

    def __init__(self):
        self.heard = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.heard.bind(("127.0.0.1", 0))
        self.frames, self.recorded, self.relayed = [], [], []
        self.link_socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.datagrams = True
        link = SimpleNamespace(datagrams=lambda: self.link_socket if self.datagrams else None)
        self.way = SimpleNamespace(
            connection=SimpleNamespace(link=link, sent_elsewhere=self._record, signing=None),
            peer=Peer("peer", self.heard.getsockname()),
        )
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self):
        with contextlib.suppress(OSError):
            while True:
                self.frames.append((time.monotonic(), self.heard.recv(300)))

    def _record(self, time_us, raw):
        self.recorded.append((time_us, raw))

    def send_payload(self, msg_id, payload, *, made_s=None):
        self.made_s = made_s
        self.relayed.append((time.monotonic(), msg_id, payload))
        return True

    def way_out(self):
        return self.way

    def close(self):
        self.heard.close()
        self.link_socket.close()


def flown(story):
    """A test of the process and one vehicle, in a loop of its own."""

    @functools.wraps(story, assigned=("__name__", "__doc__"))
    def test(**more):
        async def run():
            process, vehicle = StreamProcess(SystemClock(), OWN_IDS, server_silent_limit_s=0.5), Vehicle()
            process.start()
            try:
                await story(process, vehicle, **more)
            finally:
                process.close()
                vehicle.close()

        asyncio.run(run())

    names = list(inspect.signature(story).parameters.values())[2:]
    test.__signature__ = inspect.Signature(names)
    del test.__wrapped__
    return test


def snapshot():
    return Snapshot(time.monotonic(), "offboard", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0)


async def begin(streams, name, vehicle, rate_hz=50.0, order=None, attach=True):
    if attach:
        streams.attach(name, vehicle, (7, 1))
    number = await streams.begin(name, order or Order(HOVER, 60.0), rate_hz, snapshot())
    assert number
    assert await streams.engage(name, snapshot(), number)
    return number


def ended(pid):
    with contextlib.suppress(OSError):
        os.kill(pid, 0)
        return False
    return True


def type_mask(raw):
    """Of a framed SET_POSITION_TARGET_LOCAL_NED."""
    return struct.unpack_from("<H", raw, 10 + 48)[0]


def stall(seconds):
    """The loop, which the test is, stands still."""
    time.sleep(seconds)


async def soon(condition, within_s=3.0):
    until_s = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < until_s
        await asyncio.sleep(0.005)


@flown
async def test_streams_while_the_loop_is_stalled_and_stops_when_it_stays_silent(streams, vehicle):
    await begin(streams, "1", vehicle)
    streams.beat({"1": snapshot()})
    stall(0.8)
    await soon(lambda: streams.active() == [])
    assert 15 <= len(vehicle.frames) <= 40, "half a second at 50 a second, and the moment of the start"
    count = len(vehicle.frames)
    await asyncio.sleep(0.2)
    assert len(vehicle.frames) == count
    assert [report.code for _, report in streams.take_reports()] == ["server_silent"]
    assert streams.take_reports() == []


@flown
async def test_what_goes_out_is_ours_numbered_without_gaps_and_recorded(streams, vehicle):
    await begin(streams, "1", vehicle)
    await soon(lambda: len(vehicle.frames) >= 10)
    streams.end("1", "stopped", "")
    await soon(lambda: len(vehicle.recorded) == len(vehicle.frames))
    frames = [frame for _, frame in vehicle.frames]
    assert [raw for _, raw in vehicle.recorded] == frames
    assert {(frame[5], frame[6]) for frame in frames} == {OWN_IDS}
    assert {int.from_bytes(frame[7:10], "little") for frame in frames} == {MSG_SET_POSITION_TARGET_LOCAL_NED}
    assert [frame[4] for frame in frames] == list(range(len(frames)))
    assert abs(vehicle.recorded[-1][0] / 1e6 - time.clock_gettime(time.CLOCK_REALTIME)) < 5
    assert vehicle.relayed == []


@flown
async def test_what_goes_out_is_signed_with_the_links_key_which_no_argument_shows(streams, vehicle):
    key = bytes(range(32))
    signer = FrameSigner(SecretKey(key), 5, SigningClock(SystemClock().unix_s))
    vehicle.way.connection.signing = SimpleNamespace(signer=signer)
    await begin(streams, "1", vehicle)
    await soon(lambda: len(vehicle.frames) >= 10)
    signer.clock.adopt(signer.clock.now() + 100 * TICKS_PER_S)  # a vehicle's clock is ahead
    count = len(vehicle.frames)
    for _ in range(25):
        streams.beat({"1": snapshot()})
        await asyncio.sleep(0.02)
    await soon(lambda: len(vehicle.frames) >= count + 10)
    frames = [raw for _, raw in vehicle.frames]
    other = common.MAVLink(None)
    other.signing.secret_key = key
    messages = [other.decode(bytearray(raw)) for raw in frames]
    assert all(message.get_signed() for message in messages)
    assert {message.get_link_id() for message in messages} == {5}
    first, last = (int.from_bytes(raw[-12:-6], "little") for raw in (frames[0], frames[-1]))
    assert 99 < (last - first) / TICKS_PER_S < 110
    shown = shown_to_other_users(streams.pid)
    assert b"gcs_server.streamer.worker" in shown
    assert key not in shown
    assert key.hex().encode() not in shown


def shown_to_other_users(pid):
    return b"".join(Path(f"/proc/{pid}/{name}").read_bytes() for name in ("cmdline", "environ"))


@flown
async def test_a_change_is_sent_at_once(streams, vehicle):
    await begin(streams, "1", vehicle, rate_hz=2.0)
    await soon(lambda: vehicle.recorded)
    count = len(vehicle.recorded)
    assert await streams.change("1", Order(Velocity(velocity_ned_m_s=(1, 0, 0)), 60.0), snapshot())
    changed_us = time.clock_gettime(time.CLOCK_REALTIME) * 1e6
    assert streams.state("1").sent.velocity_ned_m_s == (1, 0, 0)
    await soon(lambda: type_mask(vehicle.recorded[-1][1]) == VELOCITY_ONLY)
    sent_us = next(time_us for time_us, raw in vehicle.recorded[count:] if type_mask(raw) == VELOCITY_ONLY)
    assert sent_us <= changed_us, "before the call returned, not when the next was due"


@flown
async def test_what_is_no_datagram_is_sent_by_the_server_even_while_its_loop_stalls(streams, vehicle):
    vehicle.datagrams = False
    await begin(streams, "1", vehicle)
    stall(0.4)
    assert len(vehicle.relayed) >= 10
    assert {msg_id for _, msg_id, _ in vehicle.relayed} == {MSG_SET_POSITION_TARGET_LOCAL_NED}
    assert vehicle.frames == []
    at_s, made_s = vehicle.relayed[-1][0], vehicle.made_s
    assert 0 <= at_s - made_s < 0.5, "handed over with its age, so that a late one can be left out"


@flown
async def test_a_new_way_is_taken_with_the_next_beat_and_the_server_sends_where_there_is_none(
    streams, vehicle
):
    await begin(streams, "1", vehicle)
    await soon(lambda: vehicle.frames)
    other = Vehicle()
    vehicle.way = other.way
    streams.beat({"1": snapshot()})
    await soon(lambda: len(other.frames) >= 3)
    count = len(vehicle.frames)
    await asyncio.sleep(0.1)
    assert len(vehicle.frames) == count
    vehicle.way = None
    streams.beat({"1": snapshot()})
    await soon(lambda: len(vehicle.relayed) >= 3)
    other.close()


@flown
async def test_a_closed_links_port_is_free_although_the_process_sent_by_its_socket(streams, vehicle):
    vehicle.link_socket.bind(("127.0.0.1", 0))
    address = vehicle.link_socket.getsockname()
    await begin(streams, "1", vehicle)
    await soon(lambda: len(vehicle.frames) >= 2)
    streams.end("1", "stopped", "That is all.")
    assert streams.active() == []
    vehicle.link_socket.close()
    streams.beat({})
    await soon(lambda: bindable(address), 1.0)
    await begin(streams, "2", second := Vehicle())  # the process still takes sockets
    await soon(lambda: len(second.frames) >= 2)
    second.close()


@flown
async def test_a_fault_of_passing_on_costs_one_setpoint_and_not_the_thread_that_passes_on(streams, vehicle):
    vehicle.datagrams = False
    real, faults = vehicle.send_payload, []

    def send_payload(msg_id, payload, *, made_s):
        if len(faults) < 3:
            faults.append(1)
            raise TypeError("a fault of the link")
        return real(msg_id, payload, made_s=made_s)

    vehicle.send_payload = send_payload
    await begin(streams, "1", vehicle)
    await soon(lambda: len(vehicle.relayed) >= 5)


@flown
async def test_vehicles_of_different_links_are_streamed_to_one_after_the_other_and_again(streams, vehicle):
    other = Vehicle()
    streams.attach("2", other, (8, 1))
    await begin(streams, "1", vehicle)
    for name, one in (("2", other), ("1", vehicle), ("2", other), ("1", vehicle)):
        streams.end("1" if name == "2" else "2", "stopped", "")
        streams.take_reports()
        assert len(streams.active()) <= 1
        count, recorded = len(one.frames), len(one.recorded)
        await begin(streams, name, one, attach=False)
        streams.beat({name: snapshot()})
        await soon(lambda one=one, count=count: len(one.frames) >= count + 3)
        await soon(lambda one=one, recorded=recorded: len(one.recorded) >= recorded + 3)
    assert vehicle.relayed == other.relayed == []
    other.close()


@flown
async def test_a_killed_process_is_told_and_started_again_but_no_stream_is(streams, vehicle):
    number = await begin(streams, "1", vehicle)
    pid = streams.pid
    os.kill(pid, signal.SIGKILL)
    await soon(lambda: streams.pid != pid)
    count = len(vehicle.frames)
    assert [(who, report.code) for who, report in streams.take_reports()] == [("1", "fault")]
    state = streams.state("1")
    assert (state.phase, state.last_end.code) == ("idle", "fault")
    assert not await streams.change("1", Order(HOVER), snapshot())
    assert streams.active() == []
    streams.beat({})
    await asyncio.sleep(0.1)
    assert len(vehicle.frames) == count
    assert await begin(streams, "1", vehicle, attach=False) > number
    await soon(lambda: len(vehicle.frames) > count)


@flown
async def test_a_process_that_hangs_is_ended(streams, vehicle, monkeypatch):
    monkeypatch.setattr("gcs_server.streamer.worker_calls.ANSWERS_WITHIN_S", 0.2)
    await begin(streams, "1", vehicle)
    pid = streams.pid
    os.kill(pid, signal.SIGSTOP)
    streams.attach("2", vehicle, (8, 1))
    with pytest.raises(Refused, match="started again"):
        await streams.begin("2", Order(HOVER), 50.0, snapshot())
    await soon(lambda: ended(pid))
    assert [(who, report.code) for who, report in streams.take_reports()] == [("1", "fault")]


@flown
async def test_a_process_that_hangs_while_nobody_asks_is_ended_too(streams, vehicle, monkeypatch):
    monkeypatch.setattr("gcs_server.streamer.worker_calls.ANSWERS_WITHIN_S", 0.3)
    await begin(streams, "1", vehicle)
    pid = streams.pid
    os.kill(pid, signal.SIGSTOP)
    await soon(lambda: streams.beat({"1": snapshot()}) or streams.pid != pid)
    await soon(lambda: ended(pid))
    assert [(who, report.code) for who, report in streams.take_reports()] == [("1", "fault")]


@flown
async def test_a_loop_that_stood_still_does_not_end_a_living_process(streams, vehicle, monkeypatch):
    monkeypatch.setattr("gcs_server.streamer.worker_calls.ANSWERS_WITHIN_S", 0.3)
    await begin(streams, "1", vehicle)
    pid = streams.pid
    streams.beat({"1": snapshot()})
    os.kill(pid, signal.SIGSTOP)  # both stand still, as on a machine that was suspended
    streams.beat({"1": snapshot()})
    stall(0.6)
    streams.beat({"1": snapshot()})
    os.kill(pid, signal.SIGCONT)
    for _ in range(5):
        await asyncio.sleep(0.05)
        streams.beat({"1": snapshot()})
    assert streams.pid == pid


@flown
async def test_whatever_the_process_does_nothing_in_the_loop_waits_for_it(streams, vehicle):
    """It hangs: each plain call returns at once, and the loop turns while a coroutine waits for an answer."""
    await begin(streams, "1", vehicle)
    os.kill(streams.pid, signal.SIGSTOP)
    guard = GroupGuard(
        "g", {"1": Order(HOVER)}, {"1": Order(HOVER)}, minimum_m=3.0, start_s=time.monotonic() + 9, lasts_s=9
    )
    calls = (
        lambda: streams.beat({"1": snapshot()}),
        streams.links_changed,
        lambda: streams.attach("2", vehicle, (8, 1)),
        streams.active,
        lambda: streams.state("1"),
        lambda: streams.starting("1", 1),
        lambda: streams.abandon("1", snapshot(), 1),
        lambda: streams.wind_down("1", snapshot()),
        lambda: streams.refrain("1"),
        lambda: streams.call_off("1", "why"),
        lambda: streams.watch(guard),
        lambda: streams.guard("g"),
        streams.watched,
        lambda: streams.stand_down("g"),
        lambda: streams.unwatch("g"),
        streams.take_reports,
        streams.take_findings,
        lambda: streams.end("1", "stopped", "", 77),
    )
    changing = asyncio.ensure_future(streams.change("1", Order(HOVER), snapshot()))
    await asyncio.sleep(0)
    slowest_s, until_s = 0.0, time.thread_time() + 60
    while not changing.done():
        for call in calls:
            began_s = time.thread_time()
            call()
            slowest_s = max(slowest_s, time.thread_time() - began_s)
        turn_s = time.monotonic()
        await asyncio.sleep(0.01)
        assert time.monotonic() - turn_s < 1.0, "the loop turns"
        assert time.thread_time() < until_s
    assert not await changing
    assert slowest_s < 0.1
    assert streams.active() == []


@flown
async def test_a_process_that_reads_nothing_is_ended_at_a_bound(streams, vehicle, monkeypatch):
    monkeypatch.setattr("gcs_server.streamer.worker_handle.MOST_WAITING_BYTES", 2_000_000)
    await begin(streams, "1", vehicle)
    pid = streams.pid
    os.kill(pid, signal.SIGSTOP)
    big = replace(snapshot(), mode="x" * 300_000)
    began_s = time.monotonic()
    for _ in range(12):
        streams.beat({"1": big})
    assert time.monotonic() - began_s < 1.0, "without a wait"
    await soon(lambda: ended(pid))
    assert [(who, report.code) for who, report in streams.take_reports()] == [("1", "fault")]


@flown
async def test_a_closed_links_port_is_free_at_once_whoever_streams(streams, vehicle):
    """Its descriptor lives in the process, too: a link deleted and added again would find its port taken."""
    other = Vehicle()
    other.link_socket.bind(("127.0.0.1", 0))
    await begin(streams, "1", vehicle)
    await begin(streams, "2", other)
    await soon(lambda: other.frames)
    address = other.link_socket.getsockname()
    other.link_socket.close()
    other.way = None
    streams.links_changed()  # and no beat
    await soon(lambda: bindable(address), 1.0)
    assert streams.state("1").phase == "streaming"
    other.close()


@flown
async def test_a_link_closed_after_its_stream_has_ended_leaves_its_port_free(streams, vehicle):
    vehicle.link_socket.bind(("127.0.0.1", 0))
    address = vehicle.link_socket.getsockname()
    await begin(streams, "1", vehicle)
    streams.end("1", "stopped", "")
    vehicle.link_socket.close()
    streams.links_changed()
    await soon(lambda: bindable(address), 1.0)


def bindable(address):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as another:
        try:
            another.bind(address)
        except OSError:
            return False
        return True


@flown
async def test_a_snapshot_that_cannot_be_handed_over_costs_its_own_vehicle_only(streams, vehicle):
    other = Vehicle()
    await begin(streams, "1", vehicle)
    await begin(streams, "2", other)
    for _ in range(8):  # longer than the server may be silent
        bad = replace(snapshot(), mode_asked_by=lambda: "cannot be pickled")
        streams.beat({"1": bad, "2": snapshot()})
        await asyncio.sleep(0.1)
    count = len(other.frames)
    await soon(lambda: len(other.frames) > count)
    assert streams.state("2").phase == "streaming"
    other.close()


@flown
async def test_a_start_that_is_cancelled_while_the_process_answers_leaves_no_stream(streams, vehicle):
    streams.attach("1", vehicle, (7, 1))
    await streams.ready()
    starting = asyncio.ensure_future(streams.begin("1", Order(HOVER, 60.0), 50.0, snapshot()))
    await asyncio.sleep(0)  # sent, and not answered
    starting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await starting
    await soon(lambda: streams.state("1").last_end is not None)
    await asyncio.sleep(0.1)
    count = len(vehicle.frames)
    await asyncio.sleep(0.1)
    assert (len(vehicle.frames), streams.active()) == (count, [])
    assert await begin(streams, "1", vehicle, attach=False) == 2


@flown
async def test_a_renewal_of_a_whole_group_is_known_with_its_answer(streams, vehicle):
    await begin(streams, "1", vehicle)
    order, now_s = Order(HOVER, 5.0), time.monotonic()

    def known():
        return replace(snapshot(), bounds=Bounds(origin=LocalOrigin(47.0, 8.0, 500.0)))

    assert await streams.change("1", order, known())
    streams.watch(
        GroupGuard("g", {"1": order}, {"1": order}, minimum_m=3.0, start_s=now_s + 0.1, lasts_s=5.0)
    )
    await soon(lambda: streams.beat({"1": known()}) or streams.guard("g").phase == "flying")
    assert streams.state("1").valid_left_s < 5.2
    assert await streams.change_together("g", {}, {}, time.monotonic() + 50.0)
    assert streams.state("1").valid_left_s > 45.0
    assert streams.guard("g").until_s > time.monotonic() + 45.0


@flown
async def test_ended_here_it_is_idle_before_the_process_says_so(streams, vehicle):
    number = await begin(streams, "1", vehicle)
    streams.end("1", "stopped", "The stream was stopped.", number)
    state = streams.state("1")
    assert (state.phase, state.last_end.code, state.number) == ("idle", "stopped", number)
    assert not streams.starting("1", number)
    again = await streams.begin("1", Order(HOVER, 60.0), 50.0, snapshot())
    assert (again, streams.state("1").phase) == (number + 1, "starting")


@flown
async def test_while_it_starts_the_loop_goes_on_and_a_start_waits_for_it(streams, vehicle, monkeypatch):
    """The moment after its end: a server that waited with its loop would hear no vehicle meanwhile."""
    turns = []

    async def turn():
        while True:
            turns.append(streams.pid)
            await asyncio.sleep(0.005)

    turning = asyncio.ensure_future(turn())
    streams.attach("1", vehicle, (7, 1))
    await soon(lambda: streams.pid)
    os.kill(streams.pid, signal.SIGSTOP)
    pid, began_s = streams.pid, time.monotonic()
    waiting = asyncio.ensure_future(streams.ready())
    await asyncio.sleep(0.2)
    assert not waiting.done()
    assert len(turns) > 5
    os.kill(pid, signal.SIGCONT)
    await waiting
    assert time.monotonic() - began_s >= 0.2
    os.kill(pid, signal.SIGKILL)
    await soon(lambda: streams.beat({}) or streams.pid not in (None, pid))
    os.kill(streams.pid, signal.SIGSTOP)
    monkeypatch.setattr("gcs_server.streamer.process.STARTS_WITHIN_S", 0.1)
    with pytest.raises(Refused, match="started again"):
        await streams.ready()
    os.kill(streams.pid, signal.SIGCONT)
    monkeypatch.setattr("gcs_server.streamer.process.STARTS_WITHIN_S", 10.0)
    await streams.ready()
    assert await begin(streams, "1", vehicle, attach=False)
    turning.cancel()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@flown
async def test_signals_for_the_server_leave_it_streaming(streams, vehicle, number):
    await begin(streams, "1", vehicle)
    os.kill(streams.pid, number)
    await asyncio.sleep(0.1)
    count = len(vehicle.frames)
    await soon(lambda: len(vehicle.frames) >= count + 3)


@flown
async def test_an_order_that_cannot_be_flown_is_an_error_here_and_ends_nothing(streams, vehicle):
    await begin(streams, "1", vehicle)
    with pytest.raises(ValueError, match="vehicle 2 is not heard"):
        await streams.change("1", Order(Follow("2"), 60.0), snapshot())
    assert streams.active() == ["1"]


@flown
async def test_expiry_is_brought_about_and_told_there(streams, vehicle):
    await begin(streams, "1", vehicle, order=Order(HOVER, 0.1, OnExpiry("stop_stream")))
    await soon(lambda: streams.beat({"1": snapshot()}) or not streams.active())
    assert "expired" in [report.code for _, report in streams.take_reports()]


def test_streams_that_want_more_than_a_processor_still_let_others_run(monkeypatch):
    waits = []

    class Hurrying:
        """Wakes a millisecond later than it was to, and then is due at once."""

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

        has_news = False

    class Messages:
        waits = False

        def fileno(self):
            return 0

        def receive(self):
            raise EOFError

    def select(read, _write, _errors, timeout_s):
        waits.append(timeout_s)
        hurrying.now_s += timeout_s
        return (read if len(waits) == 1000 else [], [], [])

    hurrying = Hurrying()
    monkeypatch.setattr("gcs_server.streamer.worker.select.select", select)
    with socket.socket() as sender:
        Worker(Messages(), sender, OWN_IDS, hurrying, hurrying).run()
    assert 8 <= sum(wait_s >= 0.005 for wait_s in waits) <= 20


@flown
async def test_a_second_start_is_refused_and_close_ends_everything(streams, vehicle):
    await begin(streams, "1", vehicle)
    assert not await streams.begin("1", Order(HOVER), 50.0, snapshot())
    pid = streams.pid
    streams.close()
    await asyncio.sleep(0.1)  # what was sent is heard
    count = len(vehicle.frames)
    await asyncio.sleep(0.1)
    assert len(vehicle.frames) == count
    assert ended(pid)
    with pytest.raises(Refused):
        await streams.ready()


@pytest.mark.parametrize(
    ("failsafe", "says"),
    [
        (Failsafe(1.0, 0, False), "lands where it is"),
        (Failsafe(1.0, 0, True), "sticks"),
        (Failsafe(0.5, 3, False), "after 0.5 s the vehicle returns to launch"),
        (Failsafe(1.0, 5, False), "Hold"),
        (Failsafe(1.0, 7, False), "falls"),
        (Failsafe(None, None, False), "did not tell"),
        (Failsafe(1.0, 42, False), "do not know"),
    ],
)
def test_what_the_vehicle_will_do_is_said_in_words(failsafe, says):
    assert says in failsafe.words()
