"""The stream scheduler with a fake clock: an event loop that stalls, and vehicles whose streams fail."""

import math
import struct
import threading
from dataclasses import replace

import pytest

from gcs_server.links.base import Peer
from gcs_server.mavlink.connection import FrameSender
from gcs_server.scenarios.memory_link import MemoryLink
from gcs_server.streamer.schedule.scheduler import StreamScheduler
from gcs_server.streamer.separation import GroupGuard
from gcs_server.streamer.values.limit_values import Bounds
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
        self.clock, self.sent_at_s = Clock(), []
        self.scheduler = StreamScheduler(self.clock, server_silent_limit_s=1.5)
        self.scheduler.attach("1", self, (1, 1))
        assert self.scheduler.begin("1", StreamRequest(HOVER, 60.0), 50.0, self.snapshot())
        assert self.scheduler.engage("1", self.snapshot())

    def send_payload(self, msg_id, payload):
        self.sent_at_s.append(self.clock.now_s)
        return True

    def snapshot(self):
        return Snapshot(self.clock.now_s, "offboard", (0.0, 0.0, -5.0), (0.0, 0.0, 0.0), 0.0, armed=True)

    def update_snapshots(self):
        self.scheduler.update_snapshots({"1": self.snapshot()})

    def run(self, seconds, *, server_alive):
        end_s = self.clock.now_s + seconds
        while self.clock.now_s < end_s - 1e-9:
            self.clock.now_s += 0.01
            if server_alive:
                self.update_snapshots()
            assert self.scheduler.step() > self.clock.now_s  # otherwise the scheduler would never wait

    def report_codes(self):
        return [report.code for _, report in self.scheduler.take_reports()]


def test_an_event_loop_stall_of_0_4_s_leaves_no_gap():
    setup = SchedulerSetup()
    setup.run(1.0, server_alive=True)
    setup.run(0.4, server_alive=False)
    setup.run(1.0, server_alive=True)
    assert max(b - a for a, b in zip(setup.sent_at_s, setup.sent_at_s[1:], strict=False)) < 0.045
    assert setup.report_codes() == []


def test_an_event_loop_stall_of_3_s_ends_the_stream_with_an_event():
    setup = SchedulerSetup()
    setup.run(1.0, server_alive=True)
    stall_start_s = setup.clock.now_s
    setup.run(3.0, server_alive=False)
    assert setup.sent_at_s[-1] - stall_start_s == pytest.approx(1.5, abs=0.03)
    sent_count = len(setup.sent_at_s)
    setup.run(5.0, server_alive=True)
    assert len(setup.sent_at_s) == sent_count
    assert setup.report_codes() == ["server_silent"]
    assert not setup.scheduler.change("1", StreamRequest(HOVER, 60.0), setup.snapshot())
    assert setup.scheduler.state("1").last_end.code == "server_silent"


@pytest.mark.parametrize("first", ["update_snapshots", "begin of another vehicle"])
def test_a_resumed_process_sends_no_old_setpoints(first):
    setup = SchedulerSetup()
    setup.run(1.0, server_alive=True)
    setup.clock.now_s += 3.0  # the process was stopped: neither the event loop nor the scheduler ran
    sent_count = len(setup.sent_at_s)
    if first == "update_snapshots":
        setup.update_snapshots()
    else:
        setup.scheduler.attach("2", setup, (2, 1))
        setup.scheduler.begin("2", StreamRequest(HOVER, 60.0), 50.0, setup.snapshot())
        setup.scheduler.end("2", "stopped", "")
    setup.run(1.0, server_alive=True)
    assert len(setup.sent_at_s) == sent_count
    assert setup.report_codes() == ["server_silent"]


class BrokenSender:
    def send_payload(self, msg_id, payload):
        raise ValueError("broken")


def test_one_vehicles_fault_does_not_affect_other_streams():
    setup = SchedulerSetup()
    setup.scheduler.attach("bad", BrokenSender(), (2, 1))
    assert setup.scheduler.begin("bad", StreamRequest(HOVER, 60.0), 50.0, setup.snapshot())
    sent_count = len(setup.sent_at_s)
    setup.run(1.0, server_alive=True)
    assert setup.scheduler.active() == ["1"]
    reports = setup.scheduler.take_reports()
    assert [(vehicle, report.code) for vehicle, report in reports] == [("bad", "fault")]
    assert len(setup.sent_at_s) - sent_count == pytest.approx(50, abs=2)


def setup_with_two_streams():
    """A scheduler with a second stream, to vehicle "bad"."""
    setup = SchedulerSetup()
    setup.scheduler.attach("bad", setup, (2, 1))
    assert setup.scheduler.begin("bad", StreamRequest(HOVER, 60.0), 50.0, setup.snapshot())
    assert setup.scheduler.engage("bad", setup.snapshot())
    return setup


@pytest.mark.parametrize(
    "changes",
    [
        {"position_ned_m": ("north", 0.0, 0.0)},
        {"velocity_ned_m_s": 5},
        {"yaw_ned_rad": "east"},
    ],
)
def test_one_vehicles_invalid_snapshot_does_not_affect_other_streams(changes):
    setup = setup_with_two_streams()
    setup.scheduler.update_snapshots({"bad": replace(setup.snapshot(), **changes), "1": setup.snapshot()})
    setup.run(1.0, server_alive=True)
    assert setup.scheduler.active() == ["1"]
    assert [(vehicle, report.code) for vehicle, report in setup.scheduler.take_reports()] == [
        ("bad", "fault")
    ]


def test_a_fault_after_a_stall_does_not_affect_other_streams(monkeypatch):
    """After a stall of the event loop all streams end, even if one of them has a fault."""
    setup = setup_with_two_streams()
    setup.run(0.5, server_alive=True)
    machine = setup.scheduler._streams["bad"].machine

    def fail(*_):
        raise ValueError("broken")

    monkeypatch.setattr(machine, "tick", fail)
    setup.clock.now_s += 3.0
    setup.update_snapshots()
    reports = dict(setup.scheduler.take_reports())
    assert (reports["1"].code, reports["bad"].code) == ("server_silent", "fault")


@pytest.mark.parametrize("invalid_number", [math.nan, math.inf, -math.inf, 1e38, 1e300])
def test_implausible_numbers_count_as_unknown_and_are_never_sent(invalid_number):
    """When the setpoint expires there is no valid position to hold, so the stream requests Land; all sent
    setpoints are finite."""
    setup = SchedulerSetup()
    frames = []
    setup.send_payload = lambda msg_id, payload: frames.append((msg_id, payload)) or True
    request = StreamRequest(Velocity((1.0, 0.0, 0.0)), 0.5, OnExpiry("hold"))
    assert setup.scheduler.change("1", request, setup.snapshot())
    for field in ("position_ned_m", "velocity_ned_m_s"):
        implausible = replace(setup.snapshot(), **{field: (0.0, invalid_number, 0.0)})
        assert getattr(implausible.plausible(), field) is None
        assert implausible.plausible().position_at(setup.clock.now_s) is None
    for _ in range(100):
        setup.clock.now_s += 0.01
        implausible = replace(setup.snapshot(), position_ned_m=(0.0, invalid_number, 0.0), yaw_ned_rad=0.0)
        setup.scheduler.update_snapshots({"1": implausible})
        setup.scheduler.step()
    assert setup.scheduler.state("1").phase == "landing"
    setpoints = [payload for msg_id, payload in frames if msg_id == MSG_SET_POSITION_TARGET_LOCAL_NED]
    assert all(abs(value) < 100 for payload in setpoints for value in struct.unpack_from("<9f", payload, 4))


def start_group(setup, *ids):
    """Starts a group of these vehicles; returns bounds with local origins 10 m apart."""
    now_s = setup.clock.now_s
    requests = dict.fromkeys(ids, StreamRequest(HOVER, 60.0))
    guard = GroupGuard(
        "g", requests, {v: StreamRequest(Velocity((1.0, 0.0, 0.0)), 60.0) for v in ids}, minimum_m=3.0,
        start_s=now_s, duration_s=60.0,
    )  # fmt: skip
    setup.scheduler.watch(guard)
    return {v: Bounds(origin=LocalOrigin(47.0, 8.0 + i * 1.3e-4, 500.0)) for i, v in enumerate(ids)}


def test_a_fault_of_a_group_member_does_not_prevent_other_members_from_holding(monkeypatch):
    setup = setup_with_two_streams()
    bounds = start_group(setup, "bad", "1")

    def update_snapshots(**changes):
        setup.clock.now_s += 0.05
        setup.scheduler.update_snapshots(
            {v: replace(setup.snapshot(), bounds=b, **changes) for v, b in bounds.items()}
        )
        setup.scheduler.step()

    update_snapshots()
    update_snapshots()
    assert setup.scheduler.guard_states()["g"].phase == "flying"

    def fail(*_):
        raise ValueError("broken")

    monkeypatch.setattr(setup.scheduler._streams["bad"].machine, "force_hold", fail)
    update_snapshots(position_ned_m=None)
    assert setup.scheduler.guard_states()["g"].held == {"bad", "1"}
    assert setup.scheduler.state("bad").phase == "idle"
    assert setup.scheduler.state("1").phase in ("to_hold", "landing")


@pytest.mark.parametrize("invalid_number", [math.nan, math.inf, 1e300])
def test_if_a_group_member_has_implausible_numbers_only_its_group_holds(invalid_number):
    setup = setup_with_two_streams()
    bounds = start_group(setup, "bad")
    for _ in range(3):
        setup.clock.now_s += 0.05
        implausible = replace(
            setup.snapshot(), position_ned_m=(invalid_number, 0.0, 0.0), bounds=bounds["bad"]
        )
        setup.scheduler.update_snapshots({"bad": implausible, "1": setup.snapshot()})
        setup.scheduler.step()
    assert [(name, finding.code) for name, finding in setup.scheduler.take_findings()] == [
        ("g", "place_unknown")
    ]
    assert setup.scheduler.state("1").phase == "streaming"


def test_if_a_guard_fails_its_group_holds_and_other_streams_continue(monkeypatch):
    setup = setup_with_two_streams()
    bounds = start_group(setup, "bad")

    def fail(*_):
        raise ZeroDivisionError("broken")

    monkeypatch.setattr(setup.scheduler._guards["g"], "check", fail)
    for _ in range(10):
        setup.clock.now_s += 0.05
        setup.scheduler.update_snapshots(
            {"bad": replace(setup.snapshot(), bounds=bounds["bad"]), "1": setup.snapshot()}
        )
        assert setup.scheduler.step() > setup.clock.now_s
    findings = setup.scheduler.take_findings()
    assert [(name, finding.code) for name, finding in findings] == [("g", "fault")]
    assert setup.scheduler.state("bad").phase == "to_hold"
    assert setup.scheduler.state("1").phase == "streaming"


def test_all_threads_share_the_sequence_numbers_of_a_link_without_duplicates_or_gaps():
    sequence_numbers = []
    link = MemoryLink("memory", outgoing=lambda data, _: sequence_numbers.append(data[4]))
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
    assert sequence_numbers == [i & 0xFF for i in range(8000)]


@pytest.mark.parametrize(("stall_s", "continues"), [(0.4, True), (2.0, False)])
def test_a_stall_of_0_4_s_does_not_end_the_stream_and_a_stall_of_2_s_does(stall_s, continues):
    setup = SchedulerSetup()
    setup.run(1.0, server_alive=True)
    setup.run(stall_s, server_alive=False)
    setup.run(3.0, server_alive=True)
    is_sending = setup.clock.now_s - setup.sent_at_s[-1] < 0.05
    assert is_sending == continues
    assert setup.report_codes() == ([] if continues else ["server_silent"])
    if not continues:  # the stream ended within 1.5 s, so PX4's own failsafe acts
        assert setup.clock.now_s - setup.sent_at_s[-1] == pytest.approx(stall_s - 1.5 + 3.0, abs=0.05)
