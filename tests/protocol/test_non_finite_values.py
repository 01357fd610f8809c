"""NaN, infinite and implausible values remove only the topics that contain them; other vehicles, views and
streams continue."""

import asyncio
import itertools
import json
import math
from typing import Any

import pytest

from gcs_server.api.responses import history_pieces, history_view, json_response, vehicle_view
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.telemetry.hub import Hub
from gcs_server.vehicle.samples import TOPICS
from tests.protocol.fake_autopilot import POSITION_MODE
from tests.protocol.memory_testbed import run_test
from tests.protocol.offboard_testbed import OffboardTestbed, stream_request

INVALID = [math.inf, -math.inf, math.nan, 1e38]


async def connect_two_vehicles(testbed) -> tuple[Any, Any]:
    """Connects two flying vehicles; returns their autopilots. The first will send invalid values."""
    link = testbed.link()
    invalid_autopilot = testbed.offboard_autopilot(link, peer="a")
    other_autopilot = testbed.offboard_autopilot(link, peer="b", system=2)
    for autopilot in (invalid_autopilot, other_autopilot):
        autopilot.set_hovering()
    await testbed.wait_for_vehicle("1")
    await testbed.wait_for_vehicle("2")
    return invalid_autopilot, other_autopilot


def vehicle_views(testbed) -> list[Any]:
    """The response of `GET /vehicles`, parsed as standard JSON."""

    def refuse_constant(name):
        raise AssertionError(f"{name} is not JSON")

    body = json_response([vehicle_view(vehicle) for vehicle in testbed.fleet.all()]).body
    return json.loads(body, parse_constant=refuse_constant)


def replace_values(autopilot, message_type: str, **fields: float):
    """Replaces fields of all further messages of this type; returns a function that ends the replacement."""
    send = autopilot.send

    def send_replaced(message):
        if message.get_type() == message_type:
            for name, value in fields.items():
                setattr(message, name, value)
        send(message)

    def restore():
        autopilot.send = send

    autopilot.send = send_replaced
    return restore


@pytest.mark.parametrize("roll_rad", INVALID)
def test_an_invalid_angle_removes_only_the_attitude(run_simulated, roll_rad):
    async def scenario(testbed):
        invalid_autopilot, _ = await connect_two_vehicles(testbed)
        restore = replace_values(invalid_autopilot, "ATTITUDE", roll=roll_rad)
        await asyncio.sleep(0.1)
        for _ in range(20):
            await asyncio.sleep(0.02)
            first, second = vehicle_views(testbed)
            assert "attitude" not in first["topics"]
            assert first["topics"]["local_position"]["value"]["position_ned_m"] == [0.0, 0.0, -5.0]
            assert second["topics"]["attitude"]["value"]["yaw_ned_rad"] == pytest.approx(0.5)
        samples = testbed.fleet.get("1").history(tuple(TOPICS), 0.0)
        history_response = json_response(history_view(list(history_pieces(testbed.fleet.get("1"), samples))))
        assert len(json.loads(history_response.body)["samples"]) > 3
        (warning,) = [w for w in testbed.fleet.warnings() if w.kind == "telemetry"]
        assert (warning.vehicle, "attitude" in warning.text) == ("1", True)
        restore()
        await asyncio.sleep(0.1)
        assert vehicle_views(testbed)[0]["topics"]["attitude"]["value"]["roll_rad"] == 0.0
        assert not [w for w in testbed.fleet.warnings() if w.kind == "telemetry"]

    run_test(run_simulated, scenario, OffboardTestbed)


def test_after_an_invalid_home_the_last_valid_home_is_kept(run_simulated):
    async def scenario(testbed):
        invalid_autopilot, _ = await connect_two_vehicles(testbed)
        vehicle = testbed.fleet.get("1")
        replace_values(invalid_autopilot, "HOME_POSITION", latitude=910_000_000)
        await asyncio.sleep(5.0)
        assert vehicle.topic("home").value.lat_deg == pytest.approx(47.397742)
        assert any("home" in w.text for w in testbed.fleet.warnings())

    run_test(run_simulated, scenario, OffboardTestbed)


@pytest.mark.parametrize("value", INVALID)
def test_an_invalid_estimate_of_a_streamed_vehicle_counts_as_missing_and_other_streams_continue(
    run_simulated, value
):
    async def scenario(testbed):
        invalid_autopilot, other_autopilot = await connect_two_vehicles(testbed)
        vehicles = [testbed.fleet.get("1"), testbed.fleet.get("2")]
        for vehicle in vehicles:
            await vehicle.offboard.start(stream_request(valid_for_s=8.0 if vehicle.id == "1" else 60.0))
        began_s = testbed.loop.time()

        replace_values(invalid_autopilot, "LOCAL_POSITION_NED", x=value, vy=value)
        await asyncio.sleep(1.0)
        snapshot = vehicles[0].offboard.snapshot()
        assert (snapshot.position_ned_m, snapshot.velocity_ned_m_s) == (None, None)
        assert vehicles[0].offboard.available()["position"].can is False
        assert not VehicleEstimates(vehicles[0]).has_position()
        await asyncio.sleep(8.0)
        times = [at_s for at_s, _ in other_autopilot.setpoints if at_s >= began_s]
        assert max(b - a for a, b in itertools.pairwise(times)) < 0.03
        assert vehicles[1].status.mode == "offboard"
        assert vehicles[0].status.mode == "land", (
            "a connected vehicle without a position estimate must land when its setpoint expires"
        )

    run_test(run_simulated, scenario, OffboardTestbed)


def test_a_vehicle_whose_snapshot_fails_has_no_estimates_and_other_streams_continue(run_simulated):
    async def scenario(testbed):
        invalid_autopilot, other_autopilot = await connect_two_vehicles(testbed)
        for vehicle in testbed.fleet.all():
            await vehicle.offboard.start(stream_request())
        offboard = testbed.fleet.get("1").offboard

        def fail(_request=None):
            raise ZeroDivisionError("simulated error")

        offboard.snapshot = fail
        await asyncio.sleep(3.0)
        assert [v.status.mode for v in testbed.fleet.all()] == ["offboard", "offboard"]
        (warning,) = [w for w in testbed.fleet.warnings() if w.kind == "fault"]
        assert (warning.vehicle, "snapshot" in warning.text) == ("1", True)
        invalid_autopilot.mode = invalid_autopilot.requested_mode = POSITION_MODE
        invalid_autopilot.send_heartbeat()
        await asyncio.sleep(0.5)
        phases = [testbed.streamer._streams.state(v).phase for v in ("1", "2")]
        assert phases == ["idle", "streaming"], "the stream did not end although the vehicle left Offboard"
        assert other_autopilot.setpoints[-1][0] > testbed.loop.time() - 0.05

    run_test(run_simulated, scenario, OffboardTestbed)


class FakeWebSocket:
    """A WebSocket that never makes the sender wait."""

    def __init__(self) -> None:
        self.incoming: asyncio.Queue[str] = asyncio.Queue()
        self.statuses: list[tuple[float, Any]] = []

    async def send_text(self, data: str) -> None:
        frame = json.loads(data)
        for sample in frame.get("samples", ()):
            if sample["vehicle"] == "1" and sample["topic"] == "status":
                self.statuses.append((asyncio.get_running_loop().time(), sample))

    async def receive_text(self) -> str:
        return await self.incoming.get()

    async def close(self, code: int = 1000, reason: str | None = None) -> None:
        raise AssertionError(reason)


def test_a_lost_link_is_reported_once_and_its_recovery_is_reported(run_simulated):
    async def scenario(testbed):
        invalid_autopilot, _ = await connect_two_vehicles(testbed)
        hub, socket = Hub(testbed.clock, testbed.fleet), FakeWebSocket()
        async with asyncio.TaskGroup() as group:
            serving = group.create_task(hub.serve(socket))
            await socket.incoming.put(json.dumps({"type": "subscribe", "topics": ["status"], "rate_hz": 20}))
            await asyncio.sleep(2.0)
            assert socket.statuses[-1][1]["value"]["link_lost"] is False
            stopped_s, invalid_autopilot.alive = testbed.loop.time(), False
            await asyncio.sleep(6.0)
            lost_s, sample = next((at_s, s) for at_s, s in socket.statuses if s["value"]["link_lost"])
            # The link counts as lost after 3.5 s without a message; a heartbeat may be one second older.
            assert 3.4 <= lost_s - stopped_s <= 3.65
            assert 3.4 <= sample["value"]["last_heartbeat_age_s"] <= 4.6
            assert len([s for _, s in socket.statuses if s["value"]["link_lost"]]) == 1, (
                "link_lost was reported several times"
            )
            invalid_autopilot.alive = True
            await asyncio.sleep(1.2)
            assert socket.statuses[-1][1]["value"]["link_lost"] is False
            received_unix_s = [s["received_unix_s"] for _, s in socket.statuses]
            assert received_unix_s == sorted(received_unix_s), "a status is older than the previous one"
            serving.cancel()

    run_test(run_simulated, scenario, OffboardTestbed)
