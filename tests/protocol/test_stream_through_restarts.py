"""A setpoint stream while PX4's agent, the MAVLink link, the ROS 2 link or the vehicle itself goes and comes
back: it continues on the other path, or it ends and the operator is told why."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Awaitable, Callable
from typing import Any

from gcs_server.vehicle.vehicle import Vehicle
from missions.setpoints import Position
from tests.protocol.offboard_testbed import offboard_event_codes, sleep
from tests.protocol.ros2_testbed import Ros2Testbed, stream_request_for
from tests.protocol.simulated_testbed import both_versions, until
from vehicle_sim.px4_version import V1_17, Px4Version

ABOVE_HOME = Position((0.0, 0.0, -8.0), yaw_ned_rad=0.0)
Scenario = Callable[[Ros2Testbed, Vehicle], Awaitable[None]]


def run_streaming(run_simulated: Any, px4: Px4Version, scenario: Scenario, *, mavlink: bool) -> None:
    """Runs a scenario that begins in Offboard, in flight."""

    async def run() -> None:
        testbed = Ros2Testbed(mavlink=mavlink, px4=px4)
        try:
            vehicle = await testbed.take_off()
            await until(lambda: vehicle.reach.setpoints == "ROS 2", 10.0)
            await testbed.streamer.offboard(vehicle.id).start(stream_request_for(ABOVE_HOME))
            await sleep(2.0)
            assert vehicle.status.mode == "offboard"
            await scenario(testbed, vehicle)
        finally:
            await testbed.close()

    run_simulated(run)


def failsafes(vehicle: Vehicle) -> list[str]:
    return [each.text for each in vehicle.events.since() if "failsafe" in each.text.lower()]


async def modes_during(vehicle: Vehicle, duration_s: float) -> list[str]:
    """The vehicle's modes, one after the other."""
    seen = list[str]()
    for _ in range(round(duration_s / 0.05)):
        seen.append(str(vehicle.status.mode))
        await asyncio.sleep(0.05)
    return [mode for mode, _ in itertools.groupby(seen)]


@both_versions
def test_with_both_links_the_stream_goes_on_while_the_agent_or_the_mavlink_link_restarts(
    run_simulated: Any, px4: Px4Version
) -> None:
    async def scenario(testbed: Ros2Testbed, vehicle: Vehicle) -> None:
        testbed.ros2_on = False
        assert await modes_during(vehicle, 8.0) == ["offboard"]
        assert vehicle.reach.setpoints == "MAVLink"
        testbed.ros2_on = True
        assert await modes_during(vehicle, 8.0) == ["offboard"]
        assert vehicle.reach.setpoints == "ROS 2"
        testbed.mavlink_on = False
        assert await modes_during(vehicle, 8.0) == ["offboard"]
        testbed.mavlink_on = True
        assert await modes_during(vehicle, 4.0) == ["offboard"]
        assert failsafes(vehicle) == []
        assert testbed.streamer.offboard(vehicle.id).status().streaming

    run_streaming(run_simulated, px4, scenario, mavlink=True)


def test_a_program_that_renews_its_setpoint_is_not_refused_when_one_of_two_links_fails(
    run_simulated: Any,
) -> None:
    async def scenario(testbed: Ros2Testbed, vehicle: Vehicle) -> None:
        offboard = testbed.streamer.offboard(vehicle.id)
        for mavlink_on, ros2_on in ((False, True), (True, True), (True, False)):
            testbed.mavlink_on, testbed.ros2_on = mavlink_on, ros2_on
            for _ in range(50):
                await offboard.setpoint(stream_request_for(ABOVE_HOME))
                await sleep(0.1)
        assert vehicle.status.mode == "offboard"

    run_streaming(run_simulated, V1_17, scenario, mavlink=True)


def test_over_ros2_alone_a_restart_of_the_agent_ends_the_stream_with_its_reason(run_simulated: Any) -> None:
    async def scenario(testbed: Ros2Testbed, vehicle: Vehicle) -> None:
        testbed.ros2_on = False
        await sleep(6.0)
        assert vehicle.status.link_lost
        assert offboard_event_codes(vehicle) == ["lost"]
        await sleep(6.0)
        assert offboard_event_codes(vehicle) == ["lost", "not_confirmed"]
        assert not testbed.streamer.offboard(vehicle.id).status().streaming
        testbed.ros2_on = True
        await until(lambda: not vehicle.status.link_lost, 5.0)
        await sleep(3.0)
        assert vehicle.status.mode != "offboard", "PX4 has acted, and nothing sends setpoints again by itself"
        assert not testbed.streamer.offboard(vehicle.id).status().streaming
        await testbed.streamer.offboard(vehicle.id).start(stream_request_for(ABOVE_HOME))
        assert await modes_during(vehicle, 3.0) == ["offboard"]

    run_streaming(run_simulated, V1_17, scenario, mavlink=False)


def test_a_vehicle_that_boots_again_gets_no_setpoint_of_the_stream_before(run_simulated: Any) -> None:
    async def scenario(testbed: Ros2Testbed, vehicle: Vehicle) -> None:
        testbed.restart_vehicle()
        await sleep(4.0)
        assert not testbed.streamer.offboard("1").status().streaming
        assert offboard_event_codes(vehicle), "the operator is told why the stream has ended"
        await until(lambda: not testbed.fleet.get("1").status.link_lost, 20.0)
        sent = len(testbed.topics[0].sent_messages)
        await sleep(10.0)
        assert not testbed.fleet.get("1").status.armed
        setpoints = [topic for topic, _ in testbed.topics[0].sent_messages[sent:] if "setpoint" in topic]
        assert setpoints == []

    run_streaming(run_simulated, V1_17, scenario, mavlink=True)
