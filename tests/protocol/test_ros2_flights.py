"""Flights over ROS 2 alone: a mission and a group, on simulated time."""

from __future__ import annotations

import asyncio
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from gcs_server.api import group_routes
from gcs_server.errors import InvalidRequest, NotTogether, Refused
from gcs_server.vehicle.vehicle import Vehicle
from missions.frames import Vector3
from missions.setpoints import Position, Velocity
from tests.protocol.api_calls import ANNA, new_station
from tests.protocol.group_testbed import setpoints_request, start_group, velocity_setpoint
from tests.protocol.mission_flights import MissionsTestbed, event_codes
from tests.protocol.mission_modes_testbed import OtherStation
from tests.protocol.ros2_testbed import Ros2Testbed, newest_value, stream_request_for
from tests.protocol.simulated_testbed import both_versions, until
from tests.support.offboard_missions import mission
from vehicle_sim.mavlink import generated_dialect as sim
from vehicle_sim.px4_version import V1_16, Px4Version

MISSION = """
- {step: take_off, height_m: 4}
- {step: orbit, center: {offset_ned_m: [6, 0, -4]}, radius_m: 6, speed_m_s: 3}
- {step: land}
"""


@both_versions
@pytest.mark.story
def test_an_offboard_mission_takes_off_flies_and_lands(
    run_simulated: Any, tmp_path: Path, px4: Px4Version
) -> None:
    async def run() -> None:
        testbed = Ros2Testbed(px4=px4)
        missions = MissionsTestbed(testbed, tmp_path)
        vehicle = await testbed.wait_for_vehicle_ready_to_arm()
        flight = missions.begin(vehicle, mission(MISSION))
        await missions.reach("flying")
        deviation_max_m = 0.0
        while missions.state == "flying":
            deviation_max_m = max(deviation_max_m, flight.status().deviation_m or 0.0)
            await asyncio.sleep(0.1)
        await missions.reach("done")
        assert deviation_max_m < 3.0
        assert not vehicle.status.armed
        assert event_codes(vehicle) == ["done"]
        await testbed.close()

    run_simulated(run)


def test_a_mission_with_a_picture_is_flown_and_reports_that_ros2_carries_no_camera_commands(
    run_simulated: Any, tmp_path: Path
) -> None:
    async def run() -> None:
        testbed = Ros2Testbed()
        missions = MissionsTestbed(testbed, tmp_path)
        vehicle = await testbed.wait_for_vehicle_ready_to_arm()
        missions.begin(vehicle, mission("- {step: take_off, height_m: 4}\n- {step: photo}\n- {step: land}\n"))
        await missions.reach("done")
        texts = [event.text for event in vehicle.events.since()]
        assert any("carries no camera commands" in text for text in texts), texts
        await testbed.close()

    run_simulated(run)


@both_versions
@pytest.mark.story
def test_a_group_starts_together_and_switches_to_hold_together(run_simulated: Any, px4: Px4Version) -> None:
    async def run() -> None:
        testbed = Ros2Testbed(2, px4=(V1_16, px4))
        vehicles = [await testbed.take_off(v, alt_home_m=10.0) for v in ("1", "2")]
        rig = SimpleNamespace(testbed=testbed, station=new_station(testbed))
        await fly_6_m_east(vehicles[1])

        goals_ned_m: dict[str, Vector3] = {}
        for vehicle in vehicles:
            north_m, east_m, down_m = newest_value(vehicle, "local_position").position_ned_m
            goals_ned_m[vehicle.id] = (north_m + 5.0, east_m, down_m)
        setpoints = {
            v: {"type": "position", "position_ned_m": goal_ned_m} for v, goal_ned_m in goals_ned_m.items()
        }
        await start_group(rig, setpoints, minimum_separation_m=3.0)
        await until(lambda: all(distance_m(v, goals_ned_m[v.id]) < 0.5 for v in vehicles), 15)
        assert [vehicle.status.mode for vehicle in vehicles] == ["offboard", "offboard"]

        with pytest.raises(Refused, match="group"):
            await vehicles[0].offboard.setpoint(stream_request_for(Velocity((1.0, 0.0, 0.0))))
        crossing_setpoints = setpoints_request({"1": velocity_setpoint(0, 3), "2": velocity_setpoint(0, -3)})
        with pytest.raises(NotTogether):
            await group_routes.setpoints("1", crossing_setpoints, rig.station, ANNA)
        await group_routes.hold("1", rig.station, ANNA)
        await until(lambda: all(v.status.mode == "hold" for v in vehicles), 5)
        await testbed.close()

    run_simulated(run)


async def fly_6_m_east(vehicle: Vehicle) -> None:
    """Flies a vehicle 6 m to the east and waits until it hovers: the two vehicles took off 3 m apart."""
    north_m, east_m, down_m = newest_value(vehicle, "local_position").position_ned_m
    goal_ned_m = (north_m, east_m + 6.0, down_m)
    await vehicle.offboard.start(stream_request_for(Position(goal_ned_m, yaw_ned_rad=0.0)))
    await until(lambda: distance_m(vehicle, goal_ned_m) < 0.5, 20)
    await vehicle.offboard.stop()
    await until(lambda: math.hypot(*newest_value(vehicle, "local_position").velocity_ned_m_s) < 0.3, 10)


def distance_m(vehicle: Vehicle, position_ned_m: Vector3) -> float:
    return math.dist(newest_value(vehicle, "local_position").position_ned_m, position_ned_m)


def test_a_take_off_to_an_altitude_below_the_vehicle_is_refused_over_ros2(run_simulated: Any) -> None:
    async def run() -> None:
        testbed = Ros2Testbed(mavlink=True)
        testbed.mavlink_on = False
        vehicle = await testbed.wait_for_vehicle_ready_to_arm()
        position = newest_value(vehicle, "global_position")
        home = (position.lat_deg, position.lon_deg, position.alt_amsl_m - 30.0)
        OtherStation(testbed).command(sim.MAV_CMD_DO_SET_HOME, 0, 0, 0, 0, *home)
        await until(lambda: newest_value(vehicle, "home").alt_amsl_m < position.alt_amsl_m - 29, 5)
        with pytest.raises(InvalidRequest, match="is not above vehicle 1") as caught:
            await vehicle.command.takeoff(10)
        assert caught.value.field == "alt_home_m"
        assert not vehicle.status.armed
        await testbed.close()

    run_simulated(run)
