"""A target below home, or below known ground, is refused with the number: by go-to and by setpoints of every
kind, in every frame, for one vehicle, a group, a mission and a follower. Scripted vehicles on simulated time.
"""

import numpy as np
import pytest

from gcs_server.api import command_routes, group_routes
from gcs_server.api.models import GotoRequest
from gcs_server.errors import NotTogether, Refused
from gcs_server.streamer.values.stream_request import StreamRequest
from gcs_server.vehicle.param_table import Param
from missions.setpoints import (
    Follow,
    Path,
    PathPoint,
    Position,
    PositionBody,
    PositionGlobal,
    Trajectory,
    Velocity,
)
from missions.terrain.ground import Ground
from tests.protocol.api_calls import ANNA, run_with_routes
from tests.protocol.command_numbers import DO_REPOSITION
from tests.protocol.fake_autopilot import HOLD_MODE, OFFBOARD_MODE
from tests.protocol.group_testbed import ANNA as GROUP_ANNA
from tests.protocol.group_testbed import position_setpoint, run_with_vehicles, setpoints_request, start_group
from tests.protocol.mission_flights import MissionsTestbed
from tests.protocol.offboard_testbed import OffboardTestbed, run_offboard, sleep, stream_request
from tests.support.offboard_missions import mission

HOME_LAT_DEG, HOME_LON_DEG, HOME_AMSL_M = 47.397742, 8.545594, 489.0
HOVER_UP_M = 5.0
"""Height of the scripted vehicle above home and its local origin [m]."""
AT = {"lat_deg": HOME_LAT_DEG, "lon_deg": HOME_LON_DEG}


def level_ground(amsl_m):
    """Known ground of this altitude, 2 km around home."""
    return Ground(
        HOME_LAT_DEG + 0.02, HOME_LON_DEG - 0.03, 0.04, 0.06, np.full((2, 2), amsl_m, dtype=np.float32)
    )


def slope(north_amsl_m):
    """Known ground at home's altitude at home, and at `north_amsl_m` 1.1 km north."""
    south_amsl_m = 2 * HOME_AMSL_M - north_amsl_m
    rows = np.array([[north_amsl_m] * 2, [south_amsl_m] * 2], dtype=np.float32)
    return Ground(HOME_LAT_DEG + 0.01, HOME_LON_DEG - 0.03, 0.02, 0.06, rows)


@pytest.mark.parametrize("altitude", [{"alt_home_m": -20.0}, {"alt_amsl_m": 12.0}, {"alt_amsl_m": 469.0}])
def test_go_to_refuses_a_target_below_home_and_sends_nothing(run_simulated, altitude):
    async def scenario(rig):
        below_m = HOME_AMSL_M - (altitude.get("alt_amsl_m") or HOME_AMSL_M + altitude["alt_home_m"])
        with pytest.raises(Refused, match=f"The target is {below_m:.1f} m below home") as refused:
            await command_routes.goto("1", GotoRequest(**AT, **altitude), rig.station, ANNA)
        assert "at least 489 m AMSL, which is 0 m above home" in refused.value.remedy
        assert not rig.autopilot.received_commands(DO_REPOSITION)
        for accepted in ({"alt_home_m": -0.9}, {"alt_amsl_m": 488.1}, {"alt_home_m": 0.0}):
            await command_routes.goto("1", GotoRequest(**AT, **accepted), rig.station, ANNA)

    run_with_routes(run_simulated, scenario)


def test_go_to_follows_the_known_ground_on_a_slope(run_simulated):
    async def scenario(rig):
        north = {"lat_deg": HOME_LAT_DEG + 0.005, "lon_deg": HOME_LON_DEG}
        rig.vehicle.command.floor.grounds = (slope(HOME_AMSL_M - 40),)
        await command_routes.goto("1", GotoRequest(**north, alt_home_m=-15), rig.station, ANNA)
        with pytest.raises(Refused, match=r"2\.0 m below the ground there, according to the elevation data"):
            await command_routes.goto("1", GotoRequest(**north, alt_home_m=-22), rig.station, ANNA)
        rig.vehicle.command.floor.grounds = (slope(HOME_AMSL_M + 40),)
        with pytest.raises(Refused, match=r"10\.0 m below the ground there"):
            await command_routes.goto("1", GotoRequest(**north, alt_home_m=10), rig.station, ANNA)

    run_with_routes(run_simulated, scenario)


def path_down(down_m):
    corners = [(0.0, -5.0), (3.0, down_m), (6.0, -5.0)]
    return Path(tuple(PathPoint(20.0 * n, (north, 0.0, down)) for n, (north, down) in enumerate(corners)))


SETPOINTS = {
    "position": lambda up: Position((3.0, 0.0, -up)),
    "position_global, AMSL": lambda up: PositionGlobal(**AT, alt_amsl_m=HOME_AMSL_M + up),
    "position_global, above home": lambda up: PositionGlobal(**AT, alt_home_m=up),
    "position_body": lambda up: PositionBody((3.0, 0.0, HOVER_UP_M - up)),
    "trajectory": lambda up: Trajectory((3.0, 0.0, -up), (0.1, 0.0, 0.0)),
    "trajectory that fixes the altitude only": lambda up: Trajectory((None, None, -up), (1.0, 0.0, None)),
    "path": lambda up: path_down(-up),
}


@pytest.mark.parametrize("kind", SETPOINTS)
def test_a_setpoint_below_home_is_refused_at_the_start_and_in_flight(run_simulated, kind):
    async def scenario(testbed, vehicle, autopilot, link):
        too_low = StreamRequest(SETPOINTS[kind](-20.0))
        with pytest.raises(Refused, match=r"20\.0 m below home"):
            await vehicle.offboard.start(too_low)
        assert not autopilot.setpoints
        assert autopilot.mode != OFFBOARD_MODE
        vehicle.offboard.check(StreamRequest(SETPOINTS[kind](-0.5)))
        await vehicle.offboard.start(stream_request())
        with pytest.raises(Refused, match=r"20\.0 m below home"):
            await vehicle.offboard.setpoint(too_low)
        assert vehicle.offboard.status().streaming

    run_offboard(run_simulated, scenario)


@pytest.mark.parametrize("kind", SETPOINTS)
def test_a_setpoint_is_compared_with_the_known_ground(run_simulated, kind):
    async def scenario(testbed, vehicle, autopilot, link):
        vehicle.command.floor.grounds = (level_ground(HOME_AMSL_M - 30),)
        vehicle.offboard.check(StreamRequest(SETPOINTS[kind](-30.5)))
        with pytest.raises(Refused, match=r"32\.0 m below home|2\.0 m below the ground"):
            vehicle.offboard.check(StreamRequest(SETPOINTS[kind](-32.0)))

    run_offboard(run_simulated, scenario)


def test_a_velocity_downwards_and_the_vehicles_own_place_are_no_targets_below_ground(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        autopilot.position_ned_m = [0.0, 0.0, 8.0]
        await sleep(0.3)
        for setpoint in (
            Velocity((0.0, 0.0, 1.0)),
            Trajectory((0.0, 0.0, None), (None, None, 0.5)),
            Position((0.0, 0.0, 8.0)),
            PositionBody((0.0, 0.0, -2.0)),
        ):
            vehicle.offboard.check(StreamRequest(setpoint))
        with pytest.raises(Refused, match=r"8\.5 m below home"):
            vehicle.offboard.check(StreamRequest(PositionBody((0.0, 0.0, 0.5))))
        with pytest.raises(Refused, match=r"8\.0 m below home"):
            vehicle.offboard.check(StreamRequest(Position((5.0, 0.0, 8.0))))

    run_offboard(run_simulated, scenario)


def test_the_landing_height_is_the_vehicles(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        known = Param("MPC_LAND_ALT3", 3.0, is_integer=False)
        vehicle.params.known = {"MPC_LAND_ALT3": known}.get
        vehicle.offboard.check(StreamRequest(Position((3.0, 0.0, 2.9))))
        with pytest.raises(Refused, match=r"3\.1 m below home"):
            vehicle.offboard.check(StreamRequest(Position((3.0, 0.0, 3.1))))

    run_offboard(run_simulated, scenario)


def test_a_group_with_one_target_below_home_does_not_start(run_simulated):
    async def scenario(rig):
        with pytest.raises(NotTogether, match=r"Vehicle 2: The target is 4\.0 m below home") as refused:
            await start_group(rig, {"1": position_setpoint(4), "2": position_setpoint(4, down_m=4.0)})
        assert refused.value.vehicles == ("2",)
        assert all(autopilot.mode == HOLD_MODE for autopilot in rig.autopilots.values())
        await start_group(rig, {"1": position_setpoint(4), "2": position_setpoint(4)})
        await sleep(1.0)
        too_low = setpoints_request({"1": position_setpoint(4, down_m=9.0)})
        with pytest.raises(NotTogether, match=r"9\.0 m below home"):
            await group_routes.setpoints("1", too_low, rig.station, GROUP_ANNA)

    run_with_vehicles(run_simulated, scenario, count=2)


def test_a_follower_is_refused_below_ground_and_stays_above_it_when_its_leader_lands(run_simulated):
    async def scenario(rig):
        follower, leader = rig.vehicles["1"], rig.autopilots["2"]
        with pytest.raises(Refused, match=r"3\.0 m below home"):
            follower.offboard.check(StreamRequest(Follow("2", offset_ned_m=(0.0, 0.0, 8.0))))
        below_leader = Follow("2", offset_ned_m=(0.0, -4.0, 3.0))
        await follower.offboard.start(StreamRequest(below_leader, 60.0))
        await sleep(0.5)
        assert rig.autopilots["1"].setpoints[-1][1].z == pytest.approx(-2.0, abs=0.1)
        leader.position[2] = leader.home[2]
        leader.position_ned_m = [0.0, 0.0, 0.0]
        await sleep(1.0)
        assert rig.autopilots["1"].setpoints[-1][1].z == pytest.approx(1.0, abs=0.1)

    def at_hover_height(rig):
        for autopilot in rig.autopilots.values():
            autopilot.position[2] = autopilot.home[2] + HOVER_UP_M

    async def with_positions(rig):
        at_hover_height(rig)
        await sleep(1.0)
        await scenario(rig)

    run_with_vehicles(run_simulated, with_positions, count=2)


BELOW_HOME = """
- {step: fly, points: [{offset_ned_m: [20, 0, 0]}, {offset_ned_m: [40, 0, 12]}]}
- {step: fly, points: [{offset_ned_m: [40, 0, 0]}]}
- {step: land}
"""
ABOVE_HOME = BELOW_HOME.replace("[40, 0, 12]", "[40, 0, 2]")


def test_a_mission_with_a_point_below_home_does_not_start(run_simulated, tmp_path):
    async def run():
        testbed = OffboardTestbed()
        missions = MissionsTestbed(testbed, tmp_path)
        autopilot = testbed.offboard_autopilot(testbed.link())
        autopilot.set_hovering()
        try:
            vehicle = await testbed.wait_for_vehicle()
            await sleep(1.5)
            with pytest.raises(Refused, match=r"The path at step 1 \(.*\) is \d\.\d m below home"):
                missions.begin(vehicle, mission(BELOW_HOME), in_air=True)
            await sleep(1.0)
            assert not autopilot.setpoints
            vehicle.command.floor.grounds = (slope(HOME_AMSL_M - 400),)
            missions.begin(vehicle, mission(BELOW_HOME), in_air=True)
        finally:
            await testbed.close()

    run_simulated(run)


def test_a_mission_that_lands_starts(run_simulated, tmp_path):
    async def run():
        testbed = OffboardTestbed()
        missions = MissionsTestbed(testbed, tmp_path)
        testbed.offboard_autopilot(testbed.link()).set_hovering()
        try:
            vehicle = await testbed.wait_for_vehicle()
            await sleep(1.5)
            missions.begin(vehicle, mission(ABOVE_HOME), in_air=True)
            await missions.reach("flying", within_s=10)
        finally:
            await testbed.close()

    run_simulated(run)
