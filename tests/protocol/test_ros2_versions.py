"""A vehicle some of whose ROS 2 topics have a layout that the server does not know: the server starts nothing
that needs these topics, and other vehicles are not affected."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from gcs_server.errors import Refused
from gcs_server.ros2.external_mode import REGISTER
from gcs_server.ros2.formats import USED
from gcs_server.streamer.transport.ros2 import CONTROL_MODE, SETPOINT_TOPICS
from missions.setpoints import Attitude, Position
from tests.protocol.mission_flights import MissionsTestbed
from tests.protocol.mission_modes_testbed import MissionModesTestbed, run_with_mission_modes
from tests.protocol.ros2_testbed import Ros2Testbed, stream_request_for
from tests.protocol.simulated_testbed import until
from tests.support.offboard_missions import mission

TRAJECTORY = SETPOINT_TOPICS["TrajectorySetpoint"]
ABOVE_HOME = Position((0.0, 0.0, -3.0))
UNKNOWN = "a layout that this server does not know: PX4 names it 0badf00d"


def set_unknown_layout(testbed: Ros2Testbed, topic: str, row: int = 0) -> None:
    """The vehicle answers that this topic has another layout."""
    formats = testbed.topics[row].link.formats
    name = topic.rpartition("/")[2].encode().ljust(49, b"\0")
    formats.on_response(
        {"protocol_version": 1, "topic_name": b"/" + name, "success": True, "message_hash": 0x0BADF00D}
    )
    assert topic in formats.unusable


@pytest.mark.parametrize("topic", [TRAJECTORY, CONTROL_MODE])
def test_a_stream_in_an_unknown_layout_is_refused_and_other_vehicles_and_setpoint_types_fly(
    run_simulated: Any, topic: str
) -> None:
    async def run() -> None:
        testbed = Ros2Testbed(2)
        vehicle, other_vehicle = (
            await testbed.wait_for_vehicle_ready_to_arm("1"),
            await testbed.wait_for_vehicle_ready_to_arm("2"),
        )
        set_unknown_layout(testbed, topic)
        sent_count = len(testbed.topics[0].sent_messages)
        with pytest.raises(Refused, match=f"{topic} has {UNKNOWN}") as refused:
            await testbed.streamer.offboard("1").start(stream_request_for(ABOVE_HOME))
        assert f"Not available: {USED[topic].lost}" in str(refused.value)
        assert "connect the vehicle over MAVLink" in (refused.value.remedy or "")
        assert len(testbed.topics[0].sent_messages) == sent_count
        available = testbed.streamer.offboard("1").available()
        assert not available["position"].can
        assert topic in (available["position_global"].why_not or "")
        assert available["attitude"].can is (topic == TRAJECTORY)
        await testbed.streamer.offboard("2").start(stream_request_for(ABOVE_HOME))
        assert other_vehicle.status.mode == "offboard"
        if topic == TRAJECTORY:
            await testbed.streamer.offboard("1").start(
                stream_request_for(Attitude((1.0, 0.0, 0.0, 0.0), 0.1))
            )
            assert vehicle.status.mode == "offboard"
            with pytest.raises(Refused, match=UNKNOWN):
                await testbed.streamer.offboard("1").setpoint(stream_request_for(ABOVE_HOME))
        await testbed.close()

    run_simulated(run)


def test_setpoints_are_sent_over_mavlink_while_a_mavlink_link_is_connected(run_simulated: Any) -> None:
    async def run() -> None:
        testbed = Ros2Testbed(mavlink=True)
        vehicle = await testbed.wait_for_vehicle_ready_to_arm()
        offboard = testbed.streamer.offboard(vehicle.id)
        await until(lambda: vehicle.reach.setpoints == "ROS 2", 10.0)
        set_unknown_layout(testbed, TRAJECTORY)
        assert vehicle.reach.setpoints == "MAVLink"
        sent_count = len(testbed.topics[0].sent_messages)
        await offboard.start(stream_request_for(ABOVE_HOME))
        assert vehicle.status.mode == "offboard"
        assert len(testbed.topics[0].sent_messages) == sent_count
        await offboard.stop()
        testbed.mavlink_on = False
        await asyncio.sleep(2.0)
        with pytest.raises(Refused, match=UNKNOWN):
            await offboard.start(stream_request_for(ABOVE_HOME))
        await testbed.close()

    run_simulated(run)


def test_a_mission_is_refused_before_take_off(run_simulated: Any, tmp_path: Path) -> None:
    async def run() -> None:
        testbed = Ros2Testbed()
        missions = MissionsTestbed(testbed, tmp_path)
        vehicle = await testbed.wait_for_vehicle_ready_to_arm()
        set_unknown_layout(testbed, SETPOINT_TOPICS["VehicleAttitudeSetpoint"])
        attitude = "{step: attitude, roll_rad: 0.1, thrust: 0.5, duration_s: 1}"
        with pytest.raises(Refused, match="Not available: attitude setpoints"):
            missions.begin(
                vehicle, mission(f"- {{step: take_off, height_m: 4}}\n- {attitude}\n- {{step: land}}")
            )
        await asyncio.sleep(2.0)
        assert not vehicle.status.armed
        await testbed.close()

    run_simulated(run)


@pytest.mark.parametrize("topic", [REGISTER, TRAJECTORY])
def test_the_registration_of_a_mode_is_refused_at_once(run_simulated: Any, topic: str) -> None:
    async def scenario(modes: MissionModesTestbed) -> None:
        testbed = modes.testbed
        set_unknown_layout(testbed, topic)
        began_s = testbed.loop.time()
        with pytest.raises(Refused, match=f"{topic} has {UNKNOWN}"):
            await modes.register()
        assert testbed.loop.time() - began_s < 1.0
        assert not modes.sent_messages(REGISTER)

    run_with_mission_modes(run_simulated, scenario)
