"""Rounds run by hand, time is a number: a server that is late, and a vehicle whose stream fails."""

import threading

import pytest

from gcs_server.links.base import Peer
from gcs_server.links.memory import MemoryLink
from gcs_server.mavlink.connection import FrameSender
from gcs_server.streamer.news import Snapshot
from gcs_server.streamer.rounds import Rounds
from gcs_server.streamer.setpoints import Order, Position

HOVER = Position(position_ned_m=(0.0, 0.0, -5.0), yaw_ned_rad=0.0)


class Clock:
    now_s = 50.0

    def monotonic_s(self):
        return self.now_s


class Bench:
    """A stream that is run by hand, with the time of each sending."""

    def __init__(self):
        self.clock, self.sent = Clock(), []
        self.streams = Rounds(self.clock, server_silent_limit_s=1.5)
        self.streams.attach("1", self, (1, 1))
        assert self.streams.begin("1", Order(HOVER, 60.0), 50.0, self.snapshot())
        assert self.streams.engage("1", self.snapshot())

    def send_payload(self, msg_id, payload):
        self.sent.append(self.clock.now_s)
        return True

    def snapshot(self):
        return Snapshot(self.clock.now_s, "offboard", (0.0, 0.0, -5.0), (0.0, 0.0, 0.0), 0.0, armed=True)

    def beat(self):
        self.streams.beat({"1": self.snapshot()})

    def run(self, seconds, *, beats, steps=True):
        end_s = self.clock.now_s + seconds
        while self.clock.now_s < end_s - 1e-9:
            self.clock.now_s += 0.01
            if beats:
                self.beat()
            if steps:
                assert self.streams.step() > self.clock.now_s  # else it would never rest

    def codes(self):
        return [report.code for _, report in self.streams.take_reports()]


def test_a_loop_that_stalls_for_0_4_s_leaves_no_gap():
    bench = Bench()
    bench.run(1.0, beats=True)
    bench.run(0.4, beats=False)
    bench.run(1.0, beats=True)
    assert max(b - a for a, b in zip(bench.sent, bench.sent[1:], strict=False)) < 0.045
    assert bench.codes() == []


def test_after_a_stall_of_3_s_it_says_so_and_does_not_start_again():
    bench = Bench()
    bench.run(1.0, beats=True)
    stalled_s = bench.clock.now_s
    bench.run(3.0, beats=False)
    assert bench.sent[-1] - stalled_s == pytest.approx(1.5, abs=0.03)
    count = len(bench.sent)
    bench.run(5.0, beats=True)
    assert len(bench.sent) == count
    assert bench.codes() == ["server_silent"]
    assert not bench.streams.change("1", Order(HOVER, 60.0), bench.snapshot())
    assert bench.streams.state("1").last_end.code == "server_silent"


@pytest.mark.parametrize("first", ["beat", "begin of another vehicle"])
def test_a_process_that_stood_still_sends_nothing_when_it_is_woken(first):
    bench = Bench()
    bench.run(1.0, beats=True)
    bench.clock.now_s += 3.0  # neither loop nor rounds ran
    count = len(bench.sent)
    if first == "beat":
        bench.beat()
    else:
        bench.streams.attach("2", bench, (2, 1))
        bench.streams.begin("2", Order(HOVER, 60.0), 50.0, bench.snapshot())
        bench.streams.end("2", "stopped", "")
    bench.run(1.0, beats=True)
    assert len(bench.sent) == count
    assert bench.codes() == ["server_silent"]


class Broken:
    def send_payload(self, msg_id, payload):
        raise ValueError("broken")


def test_one_vehicles_fault_leaves_the_others_stream():
    bench = Bench()
    bench.streams.attach("bad", Broken(), (2, 1))
    assert bench.streams.begin("bad", Order(HOVER, 60.0), 50.0, bench.snapshot())
    count = len(bench.sent)
    bench.run(1.0, beats=True)
    assert bench.streams.active() == ["1"]
    reports = bench.streams.take_reports()
    assert [(who, report.code) for who, report in reports] == [("bad", "fault")]
    assert len(bench.sent) - count == pytest.approx(50, abs=2)


def test_all_threads_share_a_links_sequence_without_duplicates_or_gaps():
    numbers = []
    link = MemoryLink("memory", outgoing=lambda data, _: numbers.append(data[4]))
    link._state = "open"
    sender = FrameSender(link, 255, 190, lambda _: None)
    peer = Peer("peer")
    ready = threading.Barrier(4)

    def send():
        ready.wait()
        for _ in range(2000):
            assert sender.send(84, bytes(53), peer)

    threads = [threading.Thread(target=send) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert numbers == [i & 0xFF for i in range(8000)]
