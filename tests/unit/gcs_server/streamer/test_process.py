"""The real process and real sockets: punctual, not to be delayed by the server, never flying on unseen."""

import asyncio
import contextlib
import os
import signal
import socket
import struct
import threading
import time
from types import SimpleNamespace

import pytest

from gcs_server.clock import SystemClock
from gcs_server.errors import Refused
from gcs_server.links.base import Peer
from gcs_server.streamer.failsafe import Failsafe
from gcs_server.streamer.news import Snapshot
from gcs_server.streamer.process import StreamProcess
from gcs_server.streamer.setpoints import Follow, OnExpiry, Order, Position, Velocity
from gcs_server.streamer.worker import Worker

HOVER = Position(position_ned_m=(0.0, 0.0, -5.0), yaw_ned_rad=0.0)
OWN_IDS = (255, 191)
MSG_SET_POSITION_TARGET_LOCAL_NED = 84
VELOCITY_ONLY = 2503
"""The type_mask of a velocity without a yaw rate, its yaw kept."""


class Vehicle:
    """Somebody at the other end of a UDP link (or of another kind), and the link as the server has it."""

    def __init__(self, *, datagrams=True):
        self.heard = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.heard.bind(("127.0.0.1", 0))
        self.frames, self.recorded, self.relayed = [], [], []
        self.link_socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        link = SimpleNamespace(datagrams=lambda: self.link_socket if datagrams else None)
        self.way = SimpleNamespace(
            connection=SimpleNamespace(link=link, sent_elsewhere=self._record),
            peer=Peer("peer", self.heard.getsockname()),
        )
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self):
        with contextlib.suppress(OSError):
            while True:
                self.frames.append((time.monotonic(), self.heard.recv(300)))

    def _record(self, time_us, raw):
        self.recorded.append((time_us, raw))

    def send_payload(self, msg_id, payload):
        self.relayed.append((time.monotonic(), msg_id, payload))
        return True

    def way_out(self):
        return self.way

    def close(self):
        self.heard.close()
        self.link_socket.close()


@pytest.fixture
def streams():
    process = StreamProcess(SystemClock(), OWN_IDS, server_silent_limit_s=0.5)
    process.start()
    yield process
    process.close()


@pytest.fixture
def vehicle():
    vehicle = Vehicle()
    yield vehicle
    vehicle.close()


def snapshot():
    return Snapshot(time.monotonic(), "offboard", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0)


def begin(streams, name, vehicle, rate_hz=50.0, order=None, attach=True):
    if attach:
        streams.attach(name, vehicle, (7, 1))
    number = streams.begin(name, order or Order(HOVER, 60.0), rate_hz, snapshot())
    assert number
    assert streams.engage(name, snapshot(), number)
    return number


def ended(pid):
    with contextlib.suppress(OSError):
        os.kill(pid, 0)
        return False
    return True


def type_mask(raw):
    """Of a framed SET_POSITION_TARGET_LOCAL_NED."""
    return struct.unpack_from("<H", raw, 10 + 48)[0]


def soon(condition, within_s=3.0):
    until_s = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < until_s
        time.sleep(0.005)


def test_streams_while_the_loop_is_stalled_and_stops_when_it_stays_silent(streams, vehicle):
    begin(streams, "1", vehicle)
    streams.beat({"1": snapshot()})
    soon(lambda: len(vehicle.frames) >= 15)  # nobody beats meanwhile
    soon(lambda: streams.active() == [])
    assert 15 <= len(vehicle.frames) <= 40, "half a second at 50 a second, and the moment of the start"
    count = len(vehicle.frames)
    time.sleep(0.2)
    assert len(vehicle.frames) == count
    assert [report.code for _, report in streams.take_reports()] == ["server_silent"]
    assert streams.take_reports() == []


def test_what_goes_out_is_ours_numbered_without_gaps_and_recorded(streams, vehicle):
    begin(streams, "1", vehicle)
    soon(lambda: len(vehicle.frames) >= 10)
    streams.end("1", "stopped", "")
    soon(lambda: len(vehicle.recorded) == len(vehicle.frames))
    frames = [frame for _, frame in vehicle.frames]
    assert [raw for _, raw in vehicle.recorded] == frames
    assert {(frame[5], frame[6]) for frame in frames} == {OWN_IDS}
    assert {int.from_bytes(frame[7:10], "little") for frame in frames} == {MSG_SET_POSITION_TARGET_LOCAL_NED}
    assert [frame[4] for frame in frames] == list(range(len(frames)))
    assert abs(vehicle.recorded[-1][0] / 1e6 - time.clock_gettime(time.CLOCK_REALTIME)) < 5
    assert vehicle.relayed == []


def test_a_change_is_sent_at_once(streams, vehicle):
    begin(streams, "1", vehicle, rate_hz=2.0)
    soon(lambda: vehicle.recorded)
    count = len(vehicle.recorded)
    assert streams.change("1", Order(Velocity(velocity_ned_m_s=(1, 0, 0)), 60.0), snapshot())
    changed_us = time.clock_gettime(time.CLOCK_REALTIME) * 1e6
    assert streams.state("1").sent.velocity_ned_m_s == (1, 0, 0)
    soon(lambda: type_mask(vehicle.recorded[-1][1]) == VELOCITY_ONLY)
    sent_us = next(time_us for time_us, raw in vehicle.recorded[count:] if type_mask(raw) == VELOCITY_ONLY)
    assert sent_us <= changed_us, "before the call returned, not when the next was due"


def test_what_is_no_datagram_is_sent_by_the_server_even_while_its_loop_stalls(streams):
    vehicle = Vehicle(datagrams=False)
    begin(streams, "1", vehicle)
    soon(lambda: len(vehicle.relayed) >= 10)  # the loop, which this test is, does nothing
    assert {msg_id for _, msg_id, _ in vehicle.relayed} == {MSG_SET_POSITION_TARGET_LOCAL_NED}
    assert vehicle.frames == []


def test_a_new_way_is_taken_with_the_next_beat_and_the_server_sends_where_there_is_none(streams, vehicle):
    begin(streams, "1", vehicle)
    soon(lambda: vehicle.frames)
    other = Vehicle()
    vehicle.way = other.way
    streams.beat({"1": snapshot()})
    soon(lambda: len(other.frames) >= 3)
    count = len(vehicle.frames)
    time.sleep(0.1)
    assert len(vehicle.frames) == count
    vehicle.way = None
    streams.beat({"1": snapshot()})
    soon(lambda: len(vehicle.relayed) >= 3)
    other.close()


def test_a_closed_links_port_is_free_although_the_process_sent_by_its_socket(streams, vehicle):
    vehicle.link_socket.bind(("127.0.0.1", 0))
    begin(streams, "1", vehicle)
    soon(lambda: len(vehicle.frames) >= 2)
    streams.end("1", "stopped", "That is all.")
    assert streams.active() == []
    port = vehicle.link_socket.getsockname()[1]
    vehicle.link_socket.close()
    streams.beat({})
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as again:
        again.bind(("127.0.0.1", port))
    begin(streams, "2", second := Vehicle())  # the process still takes sockets
    soon(lambda: len(second.frames) >= 2)
    second.close()


def test_a_fault_of_passing_on_costs_one_setpoint_and_not_the_thread_that_passes_on(streams):
    on_serial = Vehicle(datagrams=False)
    real, faults = on_serial.send_payload, []

    def send_payload(msg_id, payload):
        if len(faults) < 3:
            faults.append(1)
            raise TypeError("a fault of the link")
        return real(msg_id, payload)

    on_serial.send_payload = send_payload
    begin(streams, "1", on_serial)
    soon(lambda: len(on_serial.relayed) >= 5)
    on_serial.close()


def test_vehicles_of_different_links_are_streamed_to_one_after_the_other_and_again(streams, vehicle):
    other = Vehicle()
    streams.attach("2", other, (8, 1))
    begin(streams, "1", vehicle)
    for name, one in (("2", other), ("1", vehicle), ("2", other), ("1", vehicle)):
        streams.end("1" if name == "2" else "2", "stopped", "")
        streams.take_reports()
        assert len(streams.active()) <= 1
        count, recorded = len(one.frames), len(one.recorded)
        begin(streams, name, one, attach=False)
        streams.beat({name: snapshot()})
        soon(lambda one=one, count=count: len(one.frames) >= count + 3)
        soon(lambda one=one, recorded=recorded: len(one.recorded) >= recorded + 3)
    assert vehicle.relayed == other.relayed == []
    other.close()


def test_a_killed_process_is_told_and_started_again_but_no_stream_is(streams, vehicle):
    number = begin(streams, "1", vehicle)
    pid = streams.pid
    os.kill(pid, signal.SIGKILL)
    soon(lambda: ended(pid) or streams.beat({"1": snapshot()}) or streams.pid != pid)
    count = len(vehicle.frames)
    assert [(who, report.code) for who, report in streams.take_reports()] == [("1", "fault")]
    state = streams.state("1")
    assert (state.phase, state.last_end.code) == ("idle", "fault")
    assert not streams.change("1", Order(HOVER), snapshot())
    assert streams.active() == []
    streams.beat({})
    time.sleep(0.1)
    assert len(vehicle.frames) == count
    assert begin(streams, "1", vehicle, attach=False) > number
    soon(lambda: len(vehicle.frames) > count)


def test_a_process_that_hangs_is_ended(streams, vehicle, monkeypatch):
    monkeypatch.setattr("gcs_server.streamer.child.ANSWERS_WITHIN_S", 0.2)
    begin(streams, "1", vehicle)
    os.kill(streams.pid, signal.SIGSTOP)
    pid = streams.pid
    with pytest.raises(Refused, match="started again"):
        streams.attach("2", vehicle, (8, 1))
        streams.begin("2", Order(HOVER), 50.0, snapshot())
    assert ended(pid)
    assert [(who, report.code) for who, report in streams.take_reports()] == [("1", "fault")]


def test_while_it_starts_the_loop_goes_on_and_a_start_waits_for_it(streams, vehicle, monkeypatch):
    """The moment after its end: a server that waited with its loop would hear no vehicle meanwhile."""
    turns = []

    async def story():
        async def turn():
            while True:
                turns.append(streams.pid)
                await asyncio.sleep(0.005)

        turning = asyncio.ensure_future(turn())
        streams.attach("1", vehicle, (7, 1))
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
        await asyncio.sleep(0.1)
        streams.beat({})
        os.kill(streams.pid, signal.SIGSTOP)
        monkeypatch.setattr("gcs_server.streamer.process.STARTS_WITHIN_S", 0.1)
        with pytest.raises(Refused, match="started again"):
            await streams.ready()
        os.kill(streams.pid, signal.SIGCONT)
        monkeypatch.setattr("gcs_server.streamer.process.STARTS_WITHIN_S", 10.0)
        await streams.ready()
        assert begin(streams, "1", vehicle, attach=False)
        turning.cancel()

    asyncio.run(story())


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_for_the_server_leave_it_streaming(streams, vehicle, number):
    begin(streams, "1", vehicle)
    os.kill(streams.pid, number)
    time.sleep(0.1)
    count = len(vehicle.frames)
    soon(lambda: len(vehicle.frames) >= count + 3)


def test_an_order_that_cannot_be_flown_is_an_error_here_and_ends_nothing(streams, vehicle):
    begin(streams, "1", vehicle)
    with pytest.raises(ValueError, match="vehicle 2 is not heard"):
        streams.change("1", Order(Follow("2"), 60.0), snapshot())
    assert streams.active() == ["1"]


def test_expiry_is_brought_about_and_told_there(streams, vehicle):
    begin(streams, "1", vehicle, order=Order(HOVER, 0.1, OnExpiry("stop_stream")))
    soon(lambda: streams.beat({"1": snapshot()}) or not streams.active())
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

    class Calls:
        def fileno(self):
            return 0

        def recv_bytes(self):
            raise EOFError

    def select(read, _write, _errors, timeout_s):
        waits.append(timeout_s)
        hurrying.now_s += timeout_s
        return (read if len(waits) == 1000 else [], [], [])

    hurrying = Hurrying()
    monkeypatch.setattr("gcs_server.streamer.worker.select.select", select)
    with socket.socket() as sender:
        Worker(Calls(), sender, OWN_IDS, hurrying, hurrying).run()
    assert 8 <= sum(wait_s >= 0.005 for wait_s in waits) <= 20


def test_a_second_start_is_refused_and_close_ends_everything(streams, vehicle):
    begin(streams, "1", vehicle)
    assert not streams.begin("1", Order(HOVER), 50.0, snapshot())
    pid = streams.pid
    streams.close()
    count = len(vehicle.frames)
    time.sleep(0.1)
    assert len(vehicle.frames) == count
    assert ended(pid)
    with pytest.raises(Refused):
        asyncio.run(streams.ready())


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
