"""The real thread against a recording sender: punctual, woken by a change, stopped by silence."""

import threading
import time

import pytest

from gcs_server.clock import SystemClock
from gcs_server.streamer.failsafe import Failsafe
from gcs_server.streamer.news import Snapshot
from gcs_server.streamer.setpoints import Order, Position, Velocity
from gcs_server.streamer.thread import StreamThread

HOVER = Position(position_ned_m=(0.0, 0.0, -5.0), yaw_ned_rad=0.0)


class Recorder:
    def __init__(self, broken=False):
        self.times = []
        self.broken = broken

    def send_payload(self, msg_id, payload):
        if self.broken:
            raise ValueError("broken")
        self.times.append(time.monotonic())
        return True


@pytest.fixture
def stream():
    thread = StreamThread(SystemClock(), server_silent_limit_s=0.5)
    thread.start()
    yield thread
    thread.close()


def snapshot():
    return Snapshot(time.monotonic(), "offboard", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0)


def begin(stream, name, sender, rate_hz=50.0):
    stream.attach(name, sender, (1, 1))
    assert stream.begin(name, Order(HOVER, 60.0), rate_hz, snapshot())
    assert stream.engage(name, snapshot())


def test_streams_while_the_loop_is_stalled_and_stops_when_it_stays_silent(stream):
    sender = Recorder()
    begin(stream, "1", sender)
    stream.beat({"1": snapshot()})
    time.sleep(0.4)
    assert len(sender.times) >= 15
    time.sleep(0.3)
    count = len(sender.times)
    time.sleep(0.2)
    assert len(sender.times) == count
    assert [report.code for _, report in stream.take_reports()] == ["server_silent"]


def test_a_change_wakes_the_thread(stream):
    sender = Recorder()
    begin(stream, "1", sender, rate_hz=2.0)
    time.sleep(0.1)
    before = time.monotonic()
    assert stream.change("1", Order(Velocity(velocity_ned_m_s=(1, 0, 0)), 60.0), snapshot())
    time.sleep(0.05)
    assert sender.times[-1] - before < 0.04


def test_one_vehicles_fault_leaves_the_others_stream(stream):
    good = Recorder()
    begin(stream, "bad", Recorder(broken=True))
    begin(stream, "good", good)
    time.sleep(0.2)
    assert stream.active() == ["good"]
    assert [(who, report.code) for who, report in stream.take_reports()] == [("bad", "fault")]
    assert len(good.times) >= 7


def test_a_second_start_is_refused_and_close_ends_everything(stream):
    sender = Recorder()
    begin(stream, "1", sender)
    assert not stream.begin("1", Order(HOVER), 50.0, snapshot())
    stream.close()
    count = len(sender.times)
    time.sleep(0.1)
    assert len(sender.times) == count
    assert "offboard-stream" not in [t.name for t in threading.enumerate() if t.is_alive()]


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
