"""The state machine of a setpoint stream from start to end, with a fake clock."""

import itertools
import json
import math
import struct

import pytest

from gcs_server.streamer.schedule.stream import LOST_S, MAX_MODE_REQUESTS, VehicleStream
from gcs_server.streamer.transport.vehicle_transport import MavlinkTransport
from gcs_server.streamer.values.snapshot import Snapshot
from gcs_server.streamer.values.stream_request import OnExpiry, StreamRequest
from gcs_server.vehicle.px4.modes import BY_CUSTOM_MODE
from missions.setpoints import Path, PathPoint, Position, Velocity

SETPOINT, COMMAND = 84, 76
"""Ids of SET_POSITION_TARGET_LOCAL_NED and COMMAND_LONG."""
POSITION_AND_YAW, VELOCITY_AND_YAW, VELOCITY_AND_YAW_RATE = 2552, 2503, 1479
"""Type masks of SET_POSITION_TARGET_LOCAL_NED that use only these fields."""
HOVER = Position(position_ned_m=(0.0, 0.0, -5.0), yaw_ned_rad=0.5)
NORTH = Velocity(velocity_ned_m_s=(3.0, 0.0, 0.0), yaw_ned_rad=0.0)


class Flight:
    """A fake vehicle with its setpoint stream and clock."""

    def __init__(self, rate_hz=50.0):
        self.now_s = 100.0
        self.transport = MavlinkTransport(self, (7, 1))
        self.stream = VehicleStream(self.transport)
        self.rate_hz = rate_hz
        self.mode = "hold"
        self.position = (1.0, 2.0, -5.0)
        self.velocity = (0.0, 0.0, 0.0)
        self.armed = self.failsafe = self.lost = False
        self.yaw = 0.25
        self.loop_alive = True
        self.loop_message_s = self.now_s
        self.last_snapshot = None
        self.sent = []
        self.unread_messages = []

    def snapshot(self):
        if self.loop_alive or self.last_snapshot is None:
            self.last_snapshot = Snapshot(
                self.now_s, self.mode, self.position, self.velocity, self.yaw,
                armed=self.armed, failsafe=self.failsafe, lost=self.lost,
            )  # fmt: skip
        return self.last_snapshot

    def send_payload(self, msg_id, payload):
        self.unread_messages.append((round(self.now_s, 3), msg_id, decode(msg_id, payload)))
        return True

    def begin(self, setpoint, **validity):
        self.stream.begin(
            self.now_s, StreamRequest(setpoint, client="test", **validity), self.rate_hz, self.snapshot()
        )

    def change(self, setpoint, **validity):
        return self.stream.change(
            self.now_s, StreamRequest(setpoint, client="test", **validity), self.snapshot()
        )

    def engage(self):
        self.mode = "offboard"
        assert self.stream.engage(self.now_s)

    def run(self, seconds):
        """Runs the stream at its due times; returns the sent messages as (time, id, fields)."""
        messages = []
        end_s = self.now_s + seconds
        while self.now_s < end_s - 1e-9:
            if self.loop_alive:
                self.loop_message_s = self.now_s
            for item in self.stream.tick(self.now_s, self.snapshot(), self.loop_message_s):
                self.transport.send(item)
            messages += self.unread_messages
            self.unread_messages.clear()
            self.now_s = min(end_s, max(self.now_s + 0.001, self.stream.due_s(self.loop_message_s)))
        self.sent += messages
        return messages

    def report_codes(self):
        return [report.code for report in self.stream.reports]


def decode(msg_id, payload):
    if msg_id == COMMAND:
        values = struct.unpack("<fffffffHBBB", payload)
        return {
            "param1": values[0],
            "main_mode": values[1],
            "sub_mode": values[2],
            "command": values[7],
            "confirmation": values[10],
        }
    v = struct.unpack("<IfffffffffffHBBB", payload)
    return {
        "position": v[1:4],
        "velocity": v[4:7],
        "yaw": v[10],
        "yaw_rate": v[11],
        "mask": v[12],
        "target": v[13:15],
        "frame": v[15],
    }


def start_flight(setpoint, **validity):
    flight = Flight()
    flight.begin(setpoint, **validity)
    flight.run(1.2)
    flight.engage()
    return flight


def test_setpoints_are_streamed_at_50_hz_in_local_ned():
    flight = start_flight(HOVER, valid_for_s=60)
    messages = flight.run(2.0)
    assert 99 <= len(messages) <= 101
    _, msg_id, sent = messages[0]
    assert msg_id == SETPOINT
    assert sent["target"] == (7, 1)
    assert sent["frame"] == 1
    assert sent["position"] == (0.0, 0.0, -5.0)
    assert sent["yaw"] == pytest.approx(0.5)
    assert flight.stream.cadence.achieved_hz(flight.now_s) == pytest.approx(50, rel=0.03)


def test_a_changed_setpoint_is_sent_immediately():
    flight = Flight(rate_hz=2.0)
    flight.begin(HOVER, valid_for_s=60)
    flight.run(1.1)
    flight.engage()
    flight.run(0.05)
    assert flight.change(NORTH, valid_for_s=60)
    messages = flight.run(0.01)
    assert [sent["mask"] for _, _, sent in messages] == [VELOCITY_AND_YAW]


def test_setpoints_without_yaw_keep_the_heading_from_the_start():
    flight = start_flight(Velocity(velocity_ned_m_s=(1.0, 0.0, 0.0)), valid_for_s=60)
    flight.change(Velocity(velocity_ned_m_s=(2.0, 0.0, 0.0)), valid_for_s=60)
    _, _, sent = flight.run(0.02)[0]
    assert sent["mask"] == VELOCITY_AND_YAW
    assert sent["yaw"] == pytest.approx(0.25)


def test_after_a_setpoint_expires_the_stream_holds_the_position_and_then_requests_hold():
    flight = start_flight(NORTH, valid_for_s=0.5, on_expiry=OnExpiry("hold", 2.0))
    flight.velocity = (3.0, 0.0, 0.0)
    assert all(sent["velocity"][0] == 3.0 for _, _, sent in flight.run(0.49))
    flight.position = (10.0, 2.0, -5.0)
    flight.run(0.02)
    hold_messages = flight.run(1.9)
    assert {sent["mask"] for _, _, sent in hold_messages} == {POSITION_AND_YAW}
    assert hold_messages[-1][2]["position"] == pytest.approx((10.0, 2.0, -5.0), abs=0.1)
    assert flight.report_codes() == ["expired"]
    requests = [sent for _, msg_id, sent in flight.run(0.2) if msg_id == COMMAND]
    assert [(r["command"], r["param1"], r["main_mode"], r["sub_mode"]) for r in requests] == [
        (176, 1.0, 4.0, 3.0)  # MAV_CMD_DO_SET_MODE, Hold
    ]
    assert [m for _, m, _ in flight.run(0.1)].count(SETPOINT) >= 4, (
        "the stream ended before the vehicle was in Hold"
    )
    flight.mode = "hold"
    assert flight.run(1.0) == []
    assert flight.report_codes() == ["expired", "held"]
    times = [t for t, m, _ in flight.sent if m == SETPOINT]
    assert max(b - a for a, b in itertools.pairwise(times)) < 0.05


def test_a_new_setpoint_while_holding_resumes_the_stream():
    flight = start_flight(NORTH, valid_for_s=0.5)
    flight.run(1.0)
    assert flight.stream.phase == "holding"
    assert flight.change(HOVER, valid_for_s=60)
    flight.run(10.0)
    assert flight.stream.phase == "streaming"


def test_an_unconfirmed_hold_ends_the_stream_so_that_the_failsafe_acts():
    flight = start_flight(NORTH, valid_for_s=0.1, on_expiry=OnExpiry("hold", 0.0))
    messages = flight.run(MAX_MODE_REQUESTS + 2.0)
    requests = [sent["confirmation"] for _, msg_id, sent in messages if msg_id == COMMAND]
    assert requests == list(range(MAX_MODE_REQUESTS))
    assert flight.report_codes()[-1] == "not_confirmed"
    assert flight.run(1.0) == []


def test_on_expiry_without_a_position_estimate_the_stream_requests_land():
    flight = start_flight(NORTH, valid_for_s=0.5)
    flight.position = None
    messages = flight.run(1.0)
    assert [(s["main_mode"], s["sub_mode"]) for _, m, s in messages if m == COMMAND] == [(4.0, 6.0)]  # Land
    last_setpoint = [sent for _, m, sent in messages if m == SETPOINT][-1]
    assert (last_setpoint["mask"], last_setpoint["velocity"]) == (VELOCITY_AND_YAW_RATE, (0.0, 0.0, 0.0))
    flight.mode = "land"
    assert flight.run(1.0) == []
    assert flight.report_codes() == ["expired", "landing"]


def test_on_expiry_the_stream_requests_land_or_stops():
    flight = start_flight(HOVER, valid_for_s=0.5, on_expiry=OnExpiry("land"))
    assert COMMAND in [m for _, m, _ in flight.run(0.6)]
    flight = start_flight(HOVER, valid_for_s=0.5, on_expiry=OnExpiry("stop_stream"))
    assert flight.run(3.0)[-1][0] < 100.0 + 1.2 + 0.52  # start, time before Offboard, validity
    assert flight.report_codes() == ["expired"]


def test_setpoints_continue_while_the_event_loop_stalls_and_end_if_it_stays_blocked():
    flight = start_flight(HOVER, valid_for_s=60)
    flight.run(0.1)
    flight.loop_alive = False
    assert len(flight.run(0.4)) >= 19
    flight.loop_alive = True
    flight.run(0.2)
    flight.loop_alive = False
    messages = flight.run(3.0)
    assert 1.4 < messages[-1][0] - messages[0][0] < 1.52
    assert flight.report_codes() == ["server_silent"]


def test_expiry_during_a_stall_holds_the_vehicles_current_position():
    flight = start_flight(NORTH, valid_for_s=0.5)
    flight.velocity = (4.0, 0.0, 0.0)
    flight.run(0.4)
    flight.loop_alive = False
    flight.snapshot()
    messages = flight.run(0.3)
    assert messages[-1][2]["mask"] == POSITION_AND_YAW
    assert 1.2 < messages[-1][2]["position"][0] < 1.6


@pytest.mark.parametrize("mode", ["position", "rtl", "mission"])
def test_leaving_offboard_ends_the_stream(mode):
    flight = start_flight(HOVER, valid_for_s=60)
    flight.run(0.5)
    flight.mode = mode
    assert flight.run(2.0) == []
    assert flight.report_codes() == ["left_offboard"]
    assert not flight.change(HOVER, valid_for_s=1)


def in_failsafe(setpoint=NORTH, mode="position", **validity):
    """A flight whose vehicle has left Offboard for its failsafe, 10 m north of its start."""
    flight = start_flight(setpoint, **{"valid_for_s": 60, **validity})
    flight.armed = True
    flight.run(0.5)
    flight.mode, flight.failsafe, flight.position = mode, True, (10.0, 2.0, -4.0)
    return flight


@pytest.mark.parametrize("mode", ["position", "altitude", "hold"])
def test_a_failsafe_interrupts_the_stream_which_keeps_the_vehicle_at_its_place(mode):
    flight = in_failsafe(mode=mode)
    assert {sent["position"] for _, _, sent in flight.run(0.5)} == {(10.0, 2.0, -4.0)}
    flight.position = (11.0, 2.0, -3.0)  # the failsafe sinks
    assert flight.run(0.5)[-1][2]["position"] == (11.0, 2.0, -3.0)
    assert flight.stream.phase == "interrupted"
    assert not flight.change(NORTH, valid_for_s=60), "a setpoint was accepted that the vehicle does not fly"
    flight.mode, flight.failsafe = "offboard", False
    flight.run(0.1)
    flight.position = (11.5, 2.0, -3.0)
    assert flight.run(0.5)[-1][2]["position"] == (11.0, 2.0, -3.0)
    assert flight.change(NORTH, valid_for_s=60)
    assert (flight.run(0.1)[-1][2]["mask"], flight.stream.phase) == (VELOCITY_AND_YAW, "streaming")
    assert flight.report_codes() == ["interrupted", "interrupted"]


def test_after_an_interruption_without_a_new_setpoint_the_vehicle_is_put_into_hold():
    flight = in_failsafe(on_expiry=OnExpiry("hold", hold_for_s=1.0))
    flight.run(2.0)
    flight.mode, flight.failsafe = "offboard", False
    requests = [sent["main_mode"] for _, msg_id, sent in flight.run(2.0) if msg_id == COMMAND]
    assert requests
    flight.mode = "hold"
    assert flight.run(1.0) == []


@pytest.mark.parametrize("mode", ["rtl", "land", "precision_land"])
def test_a_return_or_landing_of_the_failsafe_is_not_interrupted_by_setpoints(mode):
    flight = in_failsafe(mode=mode)
    assert flight.run(2.0) == []
    assert flight.report_codes() == ["left_offboard"]


def test_a_failsafe_that_lasts_or_whose_vehicle_has_no_position_ends_the_stream():
    flight = in_failsafe()
    assert 4.9 < flight.run(10.0)[-1][0] - 101.7 < 5.1
    assert flight.report_codes() == ["interrupted", "left_offboard"]
    flight = in_failsafe()
    flight.position = None
    assert flight.run(10.0)[-1][0] - 101.7 < 0.6


def test_a_link_that_is_lost_during_an_interruption_keeps_the_last_place_until_it_is_lost():
    flight = in_failsafe()
    flight.run(0.5)
    flight.position = flight.yaw = None
    assert {sent["position"] for _, _, sent in flight.run(2.0)} == {(10.0, 2.0, -4.0)}
    flight.position, flight.yaw, flight.mode, flight.failsafe = (10.5, 2.0, -3.0), 0.25, "offboard", False
    assert flight.run(0.2)[-1][2]["position"] == (10.5, 2.0, -3.0)


@pytest.mark.parametrize("stops_after_s", [None, 0.0, 2.0])
def test_a_lost_vehicle_gets_nothing_once_its_failsafe_has_acted_also_if_the_client_stops(stops_after_s):
    flight = Flight()
    flight.begin(HOVER, valid_for_s=60.0)
    flight.engage()
    flight.run(1.0)
    flight.lost, flight.position, flight.yaw, lost_s = True, None, None, flight.now_s
    if stops_after_s is not None:  # the client's own Hold is sent meanwhile
        flight.run(stops_after_s)
        flight.stream.request_stop(flight.now_s, flight.snapshot())
        flight.stream.inhibit_mode_requests(flight.now_s)
    assert flight.run(20.0)[-1][0] - lost_s <= LOST_S + 0.1
    assert flight.stream.phase == "idle"
    assert flight.report_codes()[-1] == "not_confirmed"


def test_a_pilot_who_selects_a_mode_during_a_failsafe_ends_the_stream():
    flight = in_failsafe()
    flight.run(0.5)
    flight.failsafe = False
    assert flight.run(5.0) == []
    assert flight.stream.phase == "idle"


def test_a_client_that_wants_the_failsafe_gets_no_interruption():
    flight = in_failsafe(on_expiry=OnExpiry("stop_stream"))
    assert flight.run(2.0) == []


def test_an_interrupted_stream_that_is_stopped_requests_hold_and_ends():
    flight = in_failsafe()
    flight.run(0.5)
    flight.stream.request_stop(flight.now_s, flight.snapshot())
    flight.stream.end("stopped", "stopped by the client")
    assert flight.run(5.0) == []


@pytest.mark.parametrize("follows", [True, False])
def test_after_a_gap_a_path_goes_on_only_if_the_vehicle_has_followed_it(follows):
    line = Path((PathPoint(0.0, (0.0, 2.0, -5.0)), PathPoint(20.0, (60.0, 2.0, -5.0))))
    flight = start_flight(line, valid_for_s=60)
    flight.run(2.0)
    flight.position = None
    on_path = flight.run(2.6)[-1][2]["position"]
    flight.position = place = on_path if follows else (on_path[0] - 3.0, 2.0, -4.0)
    sent = flight.run(0.5)[-1][2]["position"]
    assert flight.stream.phase == ("streaming" if follows else "interrupted")
    assert sent[0] > on_path[0] if follows else sent == pytest.approx(place)


def test_the_stream_never_leads_a_recorded_px4_away_from_its_place_after_a_gap(reference_data):
    """Every gap in which a real PX4 left Offboard, as the server sees it: modes and positions, 10 m high."""
    cases = json.loads((reference_data / "px4/items/link_gap.json").read_text())["cases"]
    left = [case for case in cases if case["clean"] and case["left_offboard_s"] is not None]
    assert len(left) >= 8
    for case in left:
        rows, flight, seen_failsafe = case["rows_every_0.2s"], Flight(), False
        start_ned_m = (rows[0][1], 0.0, rows[0][2])
        flight.position, flight.armed = start_ned_m, True
        path = Path((PathPoint(0.0, start_ned_m), PathPoint(40.0, (120.0, 0.0, -10.0))))
        flight.begin(path, valid_for_s=60)
        flight.engage()
        for (t_s, x, z, vx, vz, custom_mode), (next_s, *_) in itertools.pairwise(rows):
            flight.mode = BY_CUSTOM_MODE[custom_mode].name
            flight.failsafe = flight.mode != "offboard"
            flight.position, flight.velocity = (x, 0.0, z), (vx, 0.0, vz)
            sent = [fields for _, _, fields in flight.run(next_s - t_s)]
            seen_failsafe |= flight.failsafe
            if flight.failsafe and sent:
                away_m = math.dist(sent[-1]["position"], flight.position)
                assert away_m < 1.5, (case["gap_s"], t_s, flight.mode)
            if flight.mode in ("rtl", "land"):
                assert sent == []
        assert seen_failsafe
        assert flight.stream.phase in ("idle", "interrupted", "to_hold"), "the path was flown on"


def test_a_stopped_stream_holds_the_position_until_its_end_and_then_sends_nothing():
    flight = start_flight(NORTH, valid_for_s=60)
    flight.run(0.3)
    flight.stream.request_stop(flight.now_s, flight.snapshot())
    assert {sent["mask"] for _, _, sent in flight.run(0.2)} == {POSITION_AND_YAW}
    assert not flight.change(NORTH, valid_for_s=60), "a late setpoint cancelled the stop"
    flight.stream.end("stopped", "stopped by the client")
    assert flight.run(5.0) == []


def test_setpoints_do_not_expire_while_starting_but_the_start_has_a_deadline():
    flight = Flight()
    flight.begin(HOVER, valid_for_s=0.1)
    assert len(flight.run(5.0)) > 200
    assert flight.report_codes() == []
    flight.run(20.0)
    assert flight.report_codes() == ["not_confirmed"]


def test_after_a_late_wake_up_one_setpoint_is_sent_and_the_rate_is_kept():
    flight = start_flight(HOVER, valid_for_s=60)
    flight.run(0.1)
    flight.now_s += 0.3
    flight.loop_message_s = flight.now_s
    assert len(flight.stream.tick(flight.now_s, flight.snapshot(), flight.loop_message_s)) == 1
    assert flight.stream.tick(flight.now_s, flight.snapshot(), flight.loop_message_s) == []
    assert flight.now_s < flight.stream.due_s(flight.loop_message_s) <= flight.now_s + 0.02 + 1e-9
