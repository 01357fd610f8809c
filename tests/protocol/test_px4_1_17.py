"""A flight with a simulated PX4 v1.17."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from gcs_server.errors import NoReply, Refused
from gcs_server.vehicle.services.mission_on_vehicle import PlanReference
from missions.formats.mavlink_items import fence_items, mission_items, rally_items
from missions.setpoints import Position
from tests.protocol.offboard_testbed import sleep
from tests.protocol.ros2_testbed import stream_request_for
from tests.protocol.simulated_testbed import SimulatedTestbed, until
from tests.protocol.small_plan import plan_around
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.parameters import Parameters
from vehicle_sim.px4_version import V1_16, V1_17, Px4Version

REMOVED_PARAMETER = "MPC_HOLD_DZ"


@pytest.mark.story
def test_a_vehicle_with_px4_1_17_is_shown_and_flown_like_a_vehicle_with_1_16(run_simulated: Any) -> None:
    async def scenario() -> None:
        testbed = SimulatedTestbed(px4=V1_17)
        commander = testbed.sim.autopilots[0].commander
        try:
            vehicle = await testbed.wait_for_vehicle_ready_to_arm()
            await until(lambda: vehicle.identity.firmware == "1.17.0", 5)
            await until(lambda: vehicle.topic("hud").value.airspeed_m_s is None, 5)
            assert vehicle.topic("mission").value.count == 0
            with pytest.raises(NoReply, match="did not answer about parameter"):
                await vehicle.params.set(REMOVED_PARAMETER, 0.2)
            assert (await vehicle.params.set("MPC_XY_CRUISE", 4.0)).value == 4.0
            commander.set_mode(NavState.ALTITUDE_CRUISE)
            await until(lambda: vehicle.status.mode == "altitude_cruise", 3)

            await vehicle.command.takeoff(5.0)
            await until(lambda: vehicle.status.mode == "hold", 40)
            await vehicle.offboard.start(stream_request_for(Position((6.0, 0.0, -5.0), yaw_ned_rad=0.0)))
            assert vehicle.status.mode == "offboard"
            await until(lambda: vehicle.topic("local_position").value.position_ned_m[0] > 5.0, 15)
            await vehicle.offboard.stop()
            assert vehicle.status.mode == "hold"

            home = vehicle.topic("home").value
            plan = plan_around(home.lat_deg, home.lon_deg)
            parts = {"mission": mission_items(plan), "fence": fence_items(plan), "rally": rally_items(plan)}
            await vehicle.mission.upload(parts, PlanReference("a", 1, "Out and back"))
            await vehicle.command.start_mission()
            await until(lambda: not vehicle.status.armed, 120)
            await sleep(1)
            (link,) = (connection.info() for connection in testbed.router.connections())
            assert (link.frames_lost, link.crc_errors, link.bytes_skipped) == (0, 0, 0)
        finally:
            await testbed.close()

    run_simulated(scenario)


@pytest.mark.parametrize("px4", [V1_17, V1_16])
def test_altitude_cruise_is_set_on_a_vehicle_that_announces_it_and_refused_on_others(
    run_simulated: Any, px4: Px4Version
) -> None:
    async def scenario() -> None:
        testbed = SimulatedTestbed(px4=px4)
        try:
            vehicle = await testbed.wait_for_vehicle_ready_to_arm()
            if px4 is V1_17:
                await vehicle.command.set_mode("altitude_cruise")
                assert vehicle.status.mode == "altitude_cruise"
            else:
                with pytest.raises(Refused, match="does not announce the mode Altitude cruise"):
                    await vehicle.command.set_mode("altitude_cruise")
                assert vehicle.status.mode == "hold"
        finally:
            await testbed.close()

    run_simulated(scenario)


def test_vehicles_of_two_versions_fly_in_one_fleet(run_simulated: Any) -> None:
    async def scenario() -> None:
        testbed = SimulatedTestbed(2, sim=mixed_fleet())
        try:
            old, new = await asyncio.gather(
                testbed.wait_for_vehicle_ready_to_arm("1"), testbed.wait_for_vehicle_ready_to_arm("2")
            )
            await until(lambda: (old.identity.firmware, new.identity.firmware) == ("1.16.0", "1.17.0"), 5)
            await asyncio.gather(testbed.take_off("1", 5.0), testbed.take_off("2", 5.0))
        finally:
            await testbed.close()

    run_simulated(scenario)


def mixed_fleet() -> SimulatedFleet:
    """One vehicle of v1.16 and one of v1.17."""
    stores = [Parameters(px4=px4) for px4 in (V1_16, V1_17)]
    return SimulatedFleet(2, links=(("gcs", "gcs"),), stores=stores)
