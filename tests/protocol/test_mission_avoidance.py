"""Missions towards an obstacle: avoidance enabled by the plan or by the operator, and without avoidance."""

import asyncio
import math

import pytest

from gcs_server.streamer.values.limit_values import OperatorLimits
from tests.protocol.mission_flights import MissionsTestbed, event_codes
from tests.protocol.simulated_testbed import SimulatedTestbed, until
from tests.support.offboard_missions import mission
from tests.unit.vehicle_sim.prepared_stations import station_in_hover
from tests.unit.vehicle_sim.sim_station import Station
from vehicle_sim.world.files import load_world

pytestmark = pytest.mark.flight

BOX_NORTH_M = (4.25, 5.75)
BOX_HALF_WIDTH_M = 2.0
MIN_ALTITUDE_OVER_THE_BOX_M = 4.4
BEHIND_THE_BOX_NE_M = (10.0, 0.0)


def run_towards_the_box(run_simulated, tmp_path, scenario, avoidance):
    """Runs a test with a vehicle that flies a mission straight north, towards the middle of the box.

    `avoidance`: the step enables "plan" (over the box) and "around"; "off" leaves only the obstacle brake,
    and "no brake" leaves neither.
    """

    async def run():
        station = station_in_hover(Station, 2.0, links=(("gcs", "gcs"),), world=load_world("obstacle-box"))
        testbed = SimulatedTestbed(sim=station.sim)
        missions = MissionsTestbed(testbed, tmp_path)
        try:
            vehicle = await testbed.wait_for_vehicle()
            await vehicle.offboard.operator_limits.set(
                OperatorLimits(obstacle_brake=avoidance != "no brake"), by="test"
            )
            await vehicle.offboard.avoidance.wait_for_sensor()
            yaml_value = {"plan": "true", "around": "around"}.get(avoidance, "false")
            step = f"step: fly, points: [{{offset_ned_m: [10, 0, 0]}}], speed_m_s: 2, avoidance: {yaml_value}"
            missions.begin(vehicle, mission(f"- {{{step}}}\n- {{step: hold, duration_s: 1}}\n"), in_air=True)
            await missions.reach("flying", within_s=10)
            await scenario(missions, vehicle, testbed.sim.simulation.truth.position_ned_m[0])
        finally:
            await testbed.close()

    run_simulated(run)


def estimated_down_m(vehicle):
    """The estimated down position, which the mission's altitudes use; it differs from the truth by some
    decimetres."""
    return vehicle.topic("local_position").value.position_ned_m[2]


def has_collided(vehicle):
    return any("Collision" in event.text for event in vehicle.events.since())


async def highest_over_the_box_m(missions, position_ned_m):
    """Waits until the mission ends; returns the greatest altitude over the box, above the local origin."""
    highest_m = 0.0
    for _ in range(900):
        if missions.state not in ("flying", "waiting"):
            break
        if BOX_NORTH_M[0] <= position_ned_m[0] <= BOX_NORTH_M[1]:
            highest_m = max(highest_m, -position_ned_m[2])
        await asyncio.sleep(0.1)
    return highest_m


@pytest.mark.story
def test_a_step_with_avoidance_climbs_over_the_box_and_avoidance_ends_with_the_step(run_simulated, tmp_path):
    async def scenario(missions, vehicle, position_ned_m):
        assert vehicle.offboard.status().avoidance.on
        start_down_m = estimated_down_m(vehicle)
        highest_m = await highest_over_the_box_m(missions, position_ned_m)
        assert MIN_ALTITUDE_OVER_THE_BOX_M < highest_m < 7.0
        assert missions.state == "done"
        assert math.dist(position_ned_m[:2], BEHIND_THE_BOX_NE_M) < 1.0
        assert estimated_down_m(vehicle) == pytest.approx(start_down_m, abs=0.4)
        assert not has_collided(vehicle)
        avoidance = vehicle.offboard.status().avoidance
        assert (avoidance.on, avoidance.state) == (False, None)

    run_towards_the_box(run_simulated, tmp_path, scenario, "plan")


@pytest.mark.story
def test_a_step_with_avoidance_around_passes_the_box_at_the_same_altitude(run_simulated, tmp_path):
    async def scenario(missions, vehicle, position_ned_m):
        assert vehicle.offboard.status().avoidance.way == "around"
        start_down_m, farthest_east_m = estimated_down_m(vehicle), 0.0
        for _ in range(900):
            if missions.state not in ("flying", "waiting"):
                break
            assert estimated_down_m(vehicle) == pytest.approx(start_down_m, abs=0.7)
            farthest_east_m = max(farthest_east_m, abs(position_ned_m[1]))
            await asyncio.sleep(0.1)
        assert missions.state == "done"
        assert farthest_east_m > BOX_HALF_WIDTH_M
        assert math.dist(position_ned_m[:2], BEHIND_THE_BOX_NE_M) < 1.0
        assert not has_collided(vehicle)

    run_towards_the_box(run_simulated, tmp_path, scenario, "around")


@pytest.mark.broad
def test_without_avoidance_the_brake_stops_the_vehicle_until_avoidance_is_enabled(run_simulated, tmp_path):
    async def scenario(missions, vehicle, position_ned_m):
        await asyncio.sleep(25)
        assert missions.state == "flying"
        assert position_ned_m[0] < BOX_NORTH_M[0] - 0.5
        assert "held_back" in event_codes(vehicle)
        await vehicle.offboard.avoidance.switch_on("over")
        highest_m = await highest_over_the_box_m(missions, position_ned_m)
        assert highest_m > MIN_ALTITUDE_OVER_THE_BOX_M
        assert missions.state == "done"
        assert math.dist(position_ned_m[:2], BEHIND_THE_BOX_NE_M) < 1.0
        assert vehicle.offboard.status().avoidance.on, "avoidance that the operator enabled was disabled"

    run_towards_the_box(run_simulated, tmp_path, scenario, "off")


@pytest.mark.broad
def test_avoidance_that_the_operator_disables_stays_disabled_for_this_mission(run_simulated, tmp_path):
    async def scenario(missions, vehicle, position_ned_m):
        vehicle.offboard.avoidance.switch_off()
        await asyncio.sleep(15)
        assert vehicle.offboard.status().avoidance.state is None
        assert (missions.state, position_ned_m[0] < BOX_NORTH_M[0]) == ("flying", True)

    run_towards_the_box(run_simulated, tmp_path, scenario, "plan")


def test_without_avoidance_and_brake_the_vehicle_hits_the_box(run_simulated, tmp_path):
    async def scenario(missions, vehicle, position_ned_m):
        await until(lambda: has_collided(vehicle), 30)
        assert position_ned_m[0] < BOX_NORTH_M[0]
        await missions.reach("stopped", within_s=5)

    run_towards_the_box(run_simulated, tmp_path, scenario, "no brake")
