"""The scheduler with a fake clock: a server that stalls, and vehicles whose streams fail."""

import math
import struct
import threading
from dataclasses import replace

import pytest

from gcs_server.links.base import Peer
from gcs_server.links.memory import MemoryLink
from gcs_server.mavlink.connection import FrameSender
from gcs_server.streamer.schedule.scheduler import StreamScheduler
from gcs_server.streamer.separation.guard import GroupGuard
from gcs_server.streamer.values.bounds import Bounds
from gcs_server.streamer.values.snapshot import Snapshot
from gcs_server.streamer.values.stream_request import OnExpiry, StreamRequest
from missions.geodesy import LocalOrigin
from missions.setpoints import Position, Velocity

MSG_SET_POSITION_TARGET_LOCAL_NED = 84
HOVER = Position(position_ned_m=(0.0, 0.0, -5.0), yaw_ned_rad=0.0)


class Clock:
    now_s = 50.0

    def monotonic_s(self):
        return self.now_s


class SchedulerSetup:
    """A scheduler with one stream, run step by step, and the time of each sent setpoint."""

    def __init__(self):
        self.clock, self.sent = Clock(), []
        self.streams = StreamScheduler(self.clock, server_silent_limit_s=1.5)
        self.streams.attach("1", self, (1, 1))
        assert self.streams.begin("1", StreamRequest(HOVER, 60.0), 50.0, self.snapshot())
        assert self.streams.engage("1", self.snapshot())

    def send_payload(self, msg_id, payload):
        self.sent.append(self.clock.now_s)
        return True

    def snapshot(self):
        return Snapshot(self.clock.now_s, "offboard", (0.0, 0.0, -5.0), (0.0, 0.0, 0.0), 0.0, armed=True)

    def update_snapshots(self):
        self.streams.update_snapshots({"1": self.snapshot()})

    def run(self, seconds, *, server_alive, steps=True):
        end_s = self.clock.now_s + seconds
        while self.clock.now_s < end_s - 1e-9:
            self.clock.now_s += 0.01
            if server_alive:
                self.update_snapshots()
            if steps:
                assert self.streams.step() > self.clock.now_s  # otherwise it would never wait

    def codes(self):
        return [report.code for _, report in self.streams.take_reports()]


def test_an_event_loop_stall_of_0_4_s_leaves_no_gap():
    bench = SchedulerSetup()
    bench.run(1.0, server_alive=True)
    bench.run(0.4, server_alive=False)
    bench.run(1.0, server_alive=True)
    assert max(b - a for a, b in zip(bench.sent, bench.sent[1:], strict=False)) < 0.045
    assert bench.codes() == []


def test_a_stall_of_3_s_ends_the_stream_with_an_event():
    bench = SchedulerSetup()
    bench.run(1.0, server_alive=True)
    stalled_s = bench.clock.now_s
    bench.run(3.0, server_alive=False)
    assert bench.sent[-1] - stalled_s == pytest.approx(1.5, abs=0.03)
    count = len(bench.sent)
    bench.run(5.0, server_alive=True)
    assert len(bench.sent) == count
    assert bench.codes() == ["server_silent"]
    assert not bench.streams.change("1", StreamRequest(HOVER, 60.0), bench.snapshot())
    assert bench.streams.state("1").last_end.code == "server_silent"


@pytest.mark.parametrize("first", ["update_snapshots", "begin of another vehicle"])
def test_a_resumed_process_sends_no_old_setpoints(first):
    bench = SchedulerSetup()
    bench.run(1.0, server_alive=True)
    bench.clock.now_s += 3.0  # neither loop nor scheduler ran
    count = len(bench.sent)
    if first == "update_snapshots":
        bench.update_snapshots()
    else:
        bench.streams.attach("2", bench, (2, 1))
        bench.streams.begin("2", StreamRequest(HOVER, 60.0), 50.0, bench.snapshot())
        bench.streams.end("2", "stopped", "")
    bench.run(1.0, server_alive=True)
    assert len(bench.sent) == count
    assert bench.codes() == ["server_silent"]


class Broken:
    def send_payload(self, msg_id, payload):
        raise ValueError("broken")


def test_one_vehicles_fault_does_not_affect_other_streams():
    bench = SchedulerSetup()
    bench.streams.attach("bad", Broken(), (2, 1))
    assert bench.streams.begin("bad", StreamRequest(HOVER, 60.0), 50.0, bench.snapshot())
    count = len(bench.sent)
    bench.run(1.0, server_alive=True)
    assert bench.streams.active() == ["1"]
    reports = bench.streams.take_reports()
    assert [(who, report.code) for who, report in reports] == [("bad", "fault")]
    assert len(bench.sent) - count == pytest.approx(50, abs=2)


def setup_with_two():
    """A scheduler with a second stream, to vehicle "bad"."""
    bench = SchedulerSetup()
    bench.streams.attach("bad", bench, (2, 1))
    assert bench.streams.begin("bad", StreamRequest(HOVER, 60.0), 50.0, bench.snapshot())
    assert bench.streams.engage("bad", bench.snapshot())
    return bench


@pytest.mark.parametrize(
    "bad",
    [
        {"position_ned_m": ("north", 0.0, 0.0)},
        {"velocity_ned_m_s": 5},
        {"yaw_ned_rad": "east"},
    ],
)
def test_one_vehicles_invalid_snapshot_does_not_affect_other_streams(bad):
    bench = setup_with_two()
    bench.streams.update_snapshots({"bad": replace(bench.snapshot(), **bad), "1": bench.snapshot()})
    bench.run(1.0, server_alive=True)
    assert bench.streams.active() == ["1"]
    assert [(who, report.code) for who, report in bench.streams.take_reports()] == [("bad", "fault")]


def test_a_fault_after_a_stall_does_not_affect_other_streams(monkeypatch):
    """After a stall of the loop all streams end, even if one of them has a fault."""
    bench = setup_with_two()
    bench.run(0.5, server_alive=True)
    core = bench.streams._streams["bad"].machine

    def broken(*_):
        raise ValueError("broken")

    monkeypatch.setattr(core, "tick", broken)
    bench.clock.now_s += 3.0
    bench.update_snapshots()
    reports = dict(bench.streams.take_reports())
    assert (reports["1"].code, reports["bad"].code) == ("server_silent", "fault")


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf, 1e38, 1e300])
def test_implausible_numbers_count_as_unknown_and_are_never_sent(wrong):
    """The setpoint expires while the estimate is implausible: no position can be held, so Land is
    requested, and all sent setpoints are finite."""
    bench = SchedulerSetup()
    frames = []
    bench.send_payload = lambda msg_id, payload: frames.append((msg_id, payload)) or True
    request = StreamRequest(Velocity((1.0, 0.0, 0.0)), 0.5, OnExpiry("hold"))
    assert bench.streams.change("1", request, bench.snapshot())
    for field in ("position_ned_m", "velocity_ned_m_s"):
        now = replace(bench.snapshot(), **{field: (0.0, wrong, 0.0)})
        assert getattr(now.plausible(), field) is None
        assert now.plausible().position_at(bench.clock.now_s) is None
    for _ in range(100):
        bench.clock.now_s += 0.01
        nonsense = replace(bench.snapshot(), position_ned_m=(0.0, wrong, 0.0), yaw_ned_rad=0.0)
        bench.streams.update_snapshots({"1": nonsense})
        bench.streams.step()
    assert bench.streams.state("1").phase == "landing"
    sent = [payload for msg_id, payload in frames if msg_id == MSG_SET_POSITION_TARGET_LOCAL_NED]
    assert all(abs(value) < 100 for payload in sent for value in struct.unpack_from("<9f", payload, 4))


def in_group(bench, *ids):
    """Puts these vehicles into a group, 10 m apart; returns their bounds."""
    now_s = bench.clock.now_s
    requests = dict.fromkeys(ids, StreamRequest(HOVER, 60.0))
    guard = GroupGuard(
        "g", requests, {v: StreamRequest(Velocity((1.0, 0.0, 0.0)), 60.0) for v in ids}, minimum_m=3.0,
        start_s=now_s, duration_s=60.0,
    )  # fmt: skip
    bench.streams.watch(guard)
    return {v: Bounds(origin=LocalOrigin(47.0, 8.0 + i * 1.3e-4, 500.0)) for i, v in enumerate(ids)}


def test_a_member_that_cannot_be_held_does_not_stop_the_others_from_holding(monkeypatch):
    bench = setup_with_two()
    bounds = in_group(bench, "bad", "1")

    def update_snapshots(**more):
        bench.clock.now_s += 0.05
        bench.streams.update_snapshots(
            {v: replace(bench.snapshot(), bounds=b, **more) for v, b in bounds.items()}
        )
        bench.streams.step()

    update_snapshots()
    update_snapshots()
    assert bench.streams.guard("g").phase == "flying"

    def broken(*_):
        raise ValueError("broken")

    monkeypatch.setattr(bench.streams._streams["bad"].machine, "force_hold", broken)
    update_snapshots(position_ned_m=None)
    assert bench.streams.guard("g").held == {"bad", "1"}
    assert bench.streams.state("bad").phase == "idle"
    assert bench.streams.state("1").phase in ("to_hold", "landing")


@pytest.mark.parametrize("wrong", [math.nan, math.inf, 1e300])
def test_a_member_with_implausible_numbers_holds_only_its_group(wrong):
    bench = setup_with_two()
    bounds = in_group(bench, "bad")
    for _ in range(3):
        bench.clock.now_s += 0.05
        lost = replace(bench.snapshot(), position_ned_m=(wrong, 0.0, 0.0), bounds=bounds["bad"])
        bench.streams.update_snapshots({"bad": lost, "1": bench.snapshot()})
        bench.streams.step()
    assert [(name, finding.code) for name, finding in bench.streams.take_findings()] == [
        ("g", "place_unknown")
    ]
    assert bench.streams.state("1").phase == "streaming"


def test_a_failing_guard_holds_its_group_and_other_streams_continue(monkeypatch):
    bench = setup_with_two()
    bounds = in_group(bench, "bad")

    def broken(*_):
        raise ZeroDivisionError("broken")

    monkeypatch.setattr(bench.streams._guards["g"], "check", broken)
    for _ in range(10):
        bench.clock.now_s += 0.05
        bench.streams.update_snapshots(
            {"bad": replace(bench.snapshot(), bounds=bounds["bad"]), "1": bench.snapshot()}
        )
        assert bench.streams.step() > bench.clock.now_s
    findings = bench.streams.take_findings()
    assert [(name, finding.code) for name, finding in findings] == [("g", "fault")]
    assert bench.streams.state("bad").phase == "to_hold"
    assert bench.streams.state("1").phase == "streaming"


def test_all_threads_share_a_links_sequence_without_duplicates_or_gaps():
    numbers = []
    link = MemoryLink("memory", outgoing=lambda data, _: numbers.append(data[4]))
    link._state = "open"
    link.now_s = lambda: 0.0  # time does not pass, so nothing expires on a busy machine
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


@pytest.mark.parametrize(("stall_s", "continues"), [(0.4, True), (2.0, False)])
def test_a_stall_of_0_4_s_does_not_end_the_stream_and_one_of_2_s_does(stall_s, continues):
    bench = SchedulerSetup()
    bench.run(1.0, server_alive=True)
    bench.run(stall_s, server_alive=False)
    bench.run(3.0, server_alive=True)
    sending = bench.clock.now_s - bench.sent[-1] < 0.05
    assert sending == continues
    assert bench.codes() == ([] if continues else ["server_silent"])
    if not continues:  # it stopped within the limit, so PX4's own failsafe acts
        assert bench.clock.now_s - bench.sent[-1] == pytest.approx(stall_s - 1.5 + 3.0, abs=0.05)
