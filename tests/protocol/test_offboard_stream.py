"""Setpoints over the WebSocket on simulated time: replies, several pending setpoints, too many messages, a
closed socket."""

import asyncio
import json
from contextlib import suppress

import pytest

from gcs_server.api.offboard_stream import CLOSE_FLOOD, FLOOD_PER_S, MAX_RESPONSES_BYTES, SetpointSocket
from gcs_server.control.principal import Principal
from tests.protocol.api_calls import new_station
from tests.protocol.fake_autopilot import OFFBOARD_MODE
from tests.protocol.offboard_testbed import run_offboard, sleep, stream_request


class Closed(Exception):
    pass


class FakeSocket:
    """The client's end of a socket: `submit` sends, `received` has the replies."""

    def __init__(self):
        self.inbox = asyncio.Queue()
        self.received = []
        self.closed = None
        self.client_reads = asyncio.Event()
        self.client_reads.set()

    def submit(self, **fields):
        self.inbox.put_nowait(json.dumps(fields))

    async def receive_text(self):
        text = await self.inbox.get()
        if text is None:
            raise Closed
        return text

    async def send_text(self, data):
        await self.client_reads.wait()
        self.received.append(json.loads(data))

    async def close(self, code=1000, reason=None):
        self.closed = (code, reason)


def position_request(north_m, **fields):
    setpoint = {"type": "position", "position_ned_m": [north_m, 0, -5]}
    return {"setpoint": setpoint, "valid_for_s": 60, **fields}


def run_with_socket(run_simulated, scenario, *, start=True):
    async def with_socket(testbed, vehicle, autopilot, link):
        station = new_station(testbed)
        if start:
            await vehicle.offboard.start(stream_request())
        socket = FakeSocket()
        setpoint_socket = SetpointSocket(
            testbed.clock, station, Principal.from_identity("pad", "pad"), vehicle.id, socket
        )
        serving = asyncio.ensure_future(setpoint_socket.serve())
        try:
            await scenario(vehicle, autopilot, socket)
        finally:
            socket.inbox.put_nowait(None)
            with suppress(ExceptionGroup):  # the client has closed the socket
                await serving

    run_offboard(run_simulated, with_socket)


def test_each_setpoint_is_sent_at_once_and_acknowledged_with_the_applied_values(run_simulated):
    async def scenario(vehicle, autopilot, socket):
        for seq in range(1, 51):
            setpoint_count = len(autopilot.setpoints)
            socket.submit(seq=seq, **position_request(seq / 10))
            await sleep(0.0101)
            new_north_m = [m.x for _, m in autopilot.setpoints[setpoint_count:]]
            assert any(x == pytest.approx(seq / 10) for x in new_north_m), (seq, new_north_m)
        assert [reply["seq"] for reply in socket.received] == list(range(1, 51))
        last_reply = socket.received[-1]
        assert last_reply["applied"] == {
            "type": "position",
            "position_ned_m": [5.0, 0.0, -5.0],
            "yaw_ned_rad": 0.5,
        }
        assert last_reply["limited"] == []

    run_with_socket(run_simulated, scenario)


def test_the_newest_valid_of_several_pending_setpoints_is_sent(run_simulated):
    async def scenario(vehicle, autopilot, socket):
        for seq in range(10):
            socket.submit(seq=seq, **position_request(seq))
        socket.submit(seq=10, setpoint={"type": "position", "position_ned_m": ["far", 0, 0]})
        await sleep(0.1)
        replies = {reply["seq"]: reply for reply in socket.received}
        assert replies[10]["error"]["field"] == "setpoint.position_ned_m.0"
        assert replies[9]["applied"]["position_ned_m"] == [9.0, 0.0, -5.0]
        assert all(replies[seq] == {"seq": seq, "superseded": True} for seq in range(9))
        assert {m.x for _, m in autopilot.setpoints[-3:]} == {9.0}

    run_with_socket(run_simulated, scenario)


@pytest.mark.parametrize(
    ("message", "text", "field"),
    [
        ("not json", "not JSON", "body"),
        ("[1, 2]", "JSON object", "body"),
        ('{"type": "position", "position_ned_m": [1, 1, -5]}', "setpoint is missing: put type", "body"),
        ('{"seq": "x"}', "seq", "body"),
        ('{"setpoint": {"type": "warp"}, "seq": 1}', "warp", "setpoint"),
        (
            '{"setpoint": {"type": "position", "position_ned_m": [null, null, null], "yaw_ned_rad": 1}}',
            "Only yaw is controlled",
            None,
        ),
        (
            '{"setpoint": {"type": "position", "position_ned_m": [1, null, -5]}}',
            "north and east are needed together",
            None,
        ),
        (
            '{"setpoint": {"type": "velocity", "velocity_ned_m_s": [1, 1, null]}}',
            "down is not controlled",
            None,
        ),
        (
            '{"setpoint": {"type": "position", "position_ned_m": [1, 1, -5], "frame": 7}}',
            "frame: PX4 follows",
            None,
        ),
        (
            '{"setpoint": {"type": "acceleration", "acceleration_ned_m_s2": [1, 0, 0], "force": true}}',
            "force: PX4 does not support",
            None,
        ),
        ('{"setpoint": {"type": "attitude", "q_ned_frd": [1, 1, 0, 0], "thrust": 0.5}}', "length 1", None),
        (
            '{"setpoint": {"type": "rates", "rates_frd_rad_s": [0, 0, NaN], "thrust": 0.5}}',
            "finite",
            "setpoint.rates_frd_rad_s.2",
        ),
        (
            '{"setpoint": {"type": "thrust_torque", "thrust_frd": [0, 0, -1], "torque_frd": [0, 0, 0]}}',
            "MAVLink link",
            None,
        ),
        ('{"setpoint": {"type": "actuators", "motors": [0.5]}}', "MAVLink link carries no actuators", None),
        (
            '{"setpoint": {"type": "follow", "vehicle": "1", "offset_ned_m": [3, 0, 0]}}',
            "cannot follow itself",
            "setpoint.vehicle",
        ),
        (
            '{"setpoint": {"type": "follow", "vehicle": "9", "offset_ned_m": [3, 0, 0]}}',
            "no vehicle '9'",
            None,
        ),
    ],
)
def test_an_invalid_setpoint_is_refused_with_the_reason_and_changes_nothing(
    run_simulated, message, text, field
):
    async def scenario(vehicle, autopilot, socket):
        await sleep(0.1)
        before = (autopilot.setpoints[-1][1].x, autopilot.setpoints[-1][1].type_mask)
        socket.inbox.put_nowait(message)
        await sleep(0.1)
        (reply,) = socket.received
        assert text in reply["error"]["detail"]
        assert field is None or reply["error"]["field"] == field
        assert (autopilot.setpoints[-1][1].x, autopilot.setpoints[-1][1].type_mask) == before

    run_with_socket(run_simulated, scenario)


def test_a_setpoint_without_a_stream_is_refused_with_the_route_that_starts_one(run_simulated):
    async def scenario(vehicle, autopilot, socket):
        socket.submit(seq=1, **position_request(1))
        await sleep(0.1)
        assert socket.received[0]["error"]["code"] == "refused"
        assert "offboard/start" in socket.received[0]["error"]["remedy"]
        assert autopilot.setpoints == []

    run_with_socket(run_simulated, scenario, start=False)


@pytest.mark.story
def test_setpoints_of_a_client_that_reads_no_replies_are_applied(run_simulated):
    async def scenario(vehicle, autopilot, socket):
        socket.client_reads.clear()
        for seq in range(1000):
            socket.submit(seq=seq, **position_request(seq / 100))
            await sleep(0.01)
        assert autopilot.setpoints[-1][1].x == pytest.approx(9.99, abs=0.03)
        socket.client_reads.set()
        await sleep(0.2)
        # 200 waiting replies and those being sent; the oldest were dropped.
        assert len(socket.received) <= 202
        assert socket.received[-1]["seq"] == 999

    run_with_socket(run_simulated, scenario)


@pytest.mark.parametrize(
    "text",
    [
        '{"' + "x" * 500_000 + '": 1}',
        pytest.param("[" * 500_000, marks=pytest.mark.broad),
        pytest.param('{"type": "' + "y" * 500_000 + '"}', marks=pytest.mark.broad),
    ],
)
def test_unread_replies_to_invalid_setpoints_use_limited_memory_and_do_not_end_the_stream(
    run_simulated, text
):
    async def scenario(vehicle, autopilot, socket):
        socket.client_reads.clear()
        for _ in range(100):
            socket.inbox.put_nowait(text)
            await sleep(0.02)
        socket.submit(seq=7, **position_request(3))
        await sleep(0.1)
        assert autopilot.setpoints[-1][1].x == pytest.approx(3, abs=0.03)
        socket.client_reads.set()
        await sleep(0.2)
        assert sum(len(json.dumps(reply)) for reply in socket.received) < MAX_RESPONSES_BYTES + 10_000
        assert socket.received[-1]["seq"] == 7

    run_with_socket(run_simulated, scenario)


def test_a_client_that_sends_too_many_messages_is_disconnected_and_its_last_setpoint_expires(run_simulated):
    async def scenario(vehicle, autopilot, socket):
        for seq in range(FLOOD_PER_S + 10):
            socket.submit(seq=seq, **position_request(seq / 1000, valid_for_s=0.5))
        await sleep(0.1)
        assert socket.closed[0] == CLOSE_FLOOD
        await sleep(7)
        assert autopilot.mode != OFFBOARD_MODE  # position hold in Offboard, then Hold
        assert autopilot.failsafe_count == 0

    run_with_socket(run_simulated, scenario)


def test_closing_the_socket_changes_nothing_before_the_setpoint_expires(run_simulated):
    async def scenario(vehicle, autopilot, socket):
        socket.submit(seq=1, **position_request(3, valid_for_s=4))
        await sleep(0.1)
        socket.inbox.put_nowait(None)
        await sleep(3)
        assert (autopilot.mode, vehicle.offboard.status().state) == (OFFBOARD_MODE, "streaming")
        await sleep(7)
        assert autopilot.mode != OFFBOARD_MODE
        assert autopilot.failsafe_count == 0
        assert vehicle.offboard.status().state == "idle"

    run_with_socket(run_simulated, scenario)
