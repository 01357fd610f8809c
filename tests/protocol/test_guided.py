"""Commands in guided flight, to simulated PX4 vehicles at packet loss and to a scripted one: each shows in
the vehicle's own state, and what PX4 would limit or do instead is refused before anything is sent."""

import asyncio
import math
from itertools import pairwise

import numpy as np
import pytest

from gcs_server.api import command_routes, models
from gcs_server.errors import Interrupted, InvalidRequest, PlanFindings, Refused, Rejected
from gcs_server.vehicle.px4.modes import BY_NAME
from gcs_server.vehicle.services.mission_on_vehicle import PlanReference
from missions.formats.mavlink_items import fence_items
from missions.geodesy import LocalOrigin, distance_m
from missions.plan import Plan
from missions.terrain.ground import Ground
from missions.values import FenceCircle, Point
from tests.protocol.api_calls import ANNA, run_with_routes
from tests.protocol.command_numbers import DO_CHANGE_SPEED, DO_ORBIT, DO_REPOSITION, DO_SET_HOME
from tests.protocol.offboard_testbed import sleep, stream_request
from tests.protocol.simulated_testbed import SimulatedTestbed, until
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.mavlink import generated_dialect as sim
from vehicle_sim.px4_version import DEFAULT, V1_16, V1_17

HOME_LAT_DEG, HOME_LON_DEG, HOME_AMSL_M = 47.397742, 8.545594, 489.0
NORTH = {"lat_deg": HOME_LAT_DEG + 5e-4, "lon_deg": HOME_LON_DEG}
"""A position 56 m north of home."""
ORBIT = models.OrbitRequest(**NORTH, alt_home_m=15, radius_m=20, speed_m_s=3)


def value(vehicle, topic):
    sample = vehicle.topic(topic)
    assert sample is not None, topic
    return sample.value


def away_m(vehicle, lat_deg, lon_deg):
    position = value(vehicle, "global_position")
    return distance_m(position.lat_deg, position.lon_deg, lat_deg, lon_deg)


def speed_m_s(vehicle):
    return math.hypot(*value(vehicle, "local_position").velocity_ned_m_s[:2])


def run_flying(run_simulated, scenario, *, loss=0.2, px4=DEFAULT):
    """Runs a scenario with a simulated vehicle that hovers 10 m above home."""

    async def run():
        testbed = SimulatedTestbed(px4=px4)
        vehicle = await testbed.take_off()
        testbed.loss = loss
        await scenario(testbed, vehicle)
        await testbed.close()

    run_simulated(run)


@pytest.mark.parametrize("px4", [V1_16, V1_17])
def test_speed_altitude_and_heading_change_a_flight_to_a_position(run_simulated, px4):
    async def scenario(testbed, vehicle):
        goal = (HOME_LAT_DEG + 1e-3, HOME_LON_DEG)
        await vehicle.guided.goto(*goal, alt_home_m=10, speed_m_s=2)
        await testbed.clock.sleep(6)
        assert 1.3 < speed_m_s(vehicle) < 2.3
        await vehicle.guided.change_speed(5)
        await testbed.clock.sleep(6)
        assert 3.5 < speed_m_s(vehicle) < 5.5
        await vehicle.guided.change_altitude(alt_home_m=20)
        await testbed.clock.sleep(4)
        assert speed_m_s(vehicle) > 3.0, "the flight to the position continues"
        await vehicle.guided.change_heading(-90)
        assert value(vehicle, "global_position").heading_deg == pytest.approx(270, abs=12)
        await until(lambda: away_m(vehicle, *goal) < 2, 40)
        assert value(vehicle, "global_position").alt_home_m == pytest.approx(20, abs=1.5)
        assert vehicle.status.mode == "hold"

    run_flying(run_simulated, scenario, px4=px4)


def test_altitude_and_heading_in_another_mode_first_hold_the_vehicle(run_simulated):
    async def scenario(testbed, vehicle):
        await vehicle.guided.orbit(**NORTH, alt_home_m=15, radius_m=20, speed_m_s=3)
        await testbed.clock.sleep(2)
        await vehicle.guided.change_altitude(alt_home_m=25)
        assert vehicle.status.mode == "hold"
        place = value(vehicle, "global_position")
        await testbed.clock.sleep(8)
        assert away_m(vehicle, place.lat_deg, place.lon_deg) < 8, "it stops where it was"
        assert value(vehicle, "global_position").alt_home_m == pytest.approx(25, abs=2)

    run_flying(run_simulated, scenario)


@pytest.mark.parametrize("clockwise", [True, False])
def test_an_orbit_is_flown_and_reported_with_its_direction(run_simulated, clockwise):
    async def scenario(testbed, vehicle):
        await vehicle.guided.orbit(
            **NORTH, alt_home_m=15, radius_m=20, speed_m_s=4, clockwise=clockwise, yaw="center"
        )
        circle = value(vehicle, "orbit")
        assert (circle.radius_m, circle.clockwise) == (pytest.approx(20), clockwise)
        assert distance_m(circle.lat_deg, circle.lon_deg, *NORTH.values()) < 0.1
        await testbed.clock.sleep(25)
        centre = LocalOrigin(*NORTH.values(), 0.0)
        bearings = []
        for _ in range(5):
            position = value(vehicle, "global_position")
            north, east, _ = centre.to_ned(position.lat_deg, position.lon_deg, 0.0)
            assert math.hypot(north, east) == pytest.approx(20, abs=2.5)
            bearings.append(math.atan2(east, north))
            nose = math.radians(position.heading_deg)
            assert abs(math.remainder(nose - bearings[-1] - math.pi, 2 * math.pi)) < 0.5
            await testbed.clock.sleep(2)
        turns = [math.remainder(b - a, 2 * math.pi) for a, b in pairwise(bearings)]
        assert all((turn > 0.1) == clockwise for turn in turns), turns
        assert vehicle.mode_cause.source == "command"
        await vehicle.guided.orbit(**NORTH, alt_home_m=15, radius_m=10, speed_m_s=2)  # another circle
        assert value(vehicle, "orbit").radius_m == pytest.approx(10)
        await vehicle.command.hold()

    run_flying(run_simulated, scenario)


@pytest.mark.parametrize("px4", [V1_16, V1_17])
def test_home_is_set_here_and_at_a_point_and_altitudes_refer_to_it(run_simulated, px4):
    async def scenario(testbed, vehicle):
        await vehicle.guided.goto(**NORTH, alt_home_m=10)
        await until(lambda: away_m(vehicle, *NORTH.values()) < 1.5, 40)
        await vehicle.guided.set_home()
        home, position = value(vehicle, "home"), value(vehicle, "global_position")
        assert distance_m(home.lat_deg, home.lon_deg, position.lat_deg, position.lon_deg) < 2
        assert abs(home.alt_amsl_m - position.alt_amsl_m) < 3
        # The altitude of the same place: no correction of PX4, although it is as small as one.
        await vehicle.guided.set_home((home.lat_deg, home.lon_deg, home.alt_amsl_m - 4))
        assert value(vehicle, "home").alt_amsl_m == pytest.approx(home.alt_amsl_m - 4, abs=0.1)
        await testbed.clock.sleep(3)
        assert value(vehicle, "global_position").alt_home_m > 1.0
        await vehicle.guided.set_home((HOME_LAT_DEG, HOME_LON_DEG, None))
        assert value(vehicle, "home").alt_amsl_m == pytest.approx(home.alt_amsl_m - 4, abs=0.5)

    run_flying(run_simulated, scenario, px4=px4)


def test_a_home_that_is_sent_again_does_not_move_the_target_of_a_return_that_began_meanwhile(run_simulated):
    async def scenario(testbed, vehicle):
        await vehicle.guided.goto(**NORTH, alt_home_m=10)
        await until(lambda: away_m(vehicle, *NORTH.values()) < 20, 30)
        before = value(vehicle, "home")
        testbed.loss_to_vehicle = 1.0
        setting = asyncio.ensure_future(vehicle.guided.set_home())
        await sleep(0.5)
        testbed.sim.autopilots[0].commander.set_mode(NavState.RTL)  # as a pilot does
        await until(lambda: vehicle.status.mode == "rtl", 2)
        testbed.loss_to_vehicle = 0.0
        with pytest.raises(Interrupted, match="refers to its present home"):
            await setting
        await sleep(3)
        home = value(vehicle, "home")
        assert (home.lat_deg, home.lon_deg) == (before.lat_deg, before.lon_deg), "PX4 corrects its altitude"

    run_flying(run_simulated, scenario, loss=0.0)


def test_a_refused_home_says_why(run_simulated):
    async def scenario(rig):
        rig.autopilot.refusals[DO_SET_HOME] = sim.MAV_RESULT_DENIED
        before = value(rig.vehicle, "home")
        with pytest.raises(Rejected, match="refused to set home: denied") as denied:
            await command_routes.home("1", models.HomeRequest(here=True), rig.station, ANNA)
        assert "COM_HOME_EN is 0" in denied.value.remedy
        rig.autopilot.refusals[DO_SET_HOME] = sim.MAV_RESULT_TEMPORARILY_REJECTED
        with pytest.raises(Rejected, match="not possible now"):
            await command_routes.home("1", models.HomeRequest(here=True), rig.station, ANNA)
        assert value(rig.vehicle, "home") == before

    run_with_routes(run_simulated, scenario)


REFUSED = {
    "a radius beyond the vehicle's": ({"radius_m": 1500}, r"from 1 to 1000 \(MC_ORBIT_RAD_MAX\)"),
    "a speed beyond the vehicle's": (
        {"radius_m": 200, "speed_m_s": 13},
        r"at most 12 m/s \(MPC_XY_VEL_MAX\)",
    ),
    "a speed that the radius does not allow": ({"radius_m": 8, "speed_m_s": 5}, r"no more than 4\.0 m/s"),
    "a centre too far away": ({"lat_deg": HOME_LAT_DEG + 0.02}, r"more than the allowed 1000 m"),
    "a circle below home": ({"alt_home_m": -5}, r"A part of the circle is 5\.0 m below home"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_an_orbit_that_px4_would_not_fly_as_asked_is_refused_and_nothing_is_sent(run_simulated, case):
    changes, words = REFUSED[case]

    async def scenario(rig):
        with pytest.raises((InvalidRequest, Refused), match=words):
            await command_routes.orbit("1", ORBIT.model_copy(update=changes), rig.station, ANNA)
        assert not rig.autopilot.received_commands(DO_ORBIT)
        assert rig.vehicle.status.mode == "hold"

    run_with_routes(run_simulated, scenario)


def test_a_circle_is_compared_with_the_known_ground_at_its_edge(run_simulated):
    async def scenario(rig):
        rows = [[HOME_AMSL_M + 40] * 2, [HOME_AMSL_M - 40] * 2]  # 8 m higher for each 112 m to the north
        rig.vehicle.command.floor.grounds = (
            Ground(HOME_LAT_DEG + 0.005, HOME_LON_DEG - 0.03, 0.01, 0.06, np.array(rows, dtype=np.float32)),
        )
        fits = ORBIT.model_copy(update={"lat_deg": HOME_LAT_DEG, "alt_home_m": 2.0, "radius_m": 10})
        await command_routes.orbit("1", fits, rig.station, ANNA)
        with pytest.raises(Refused, match=r"A part of the circle is .* below the ground there"):
            await command_routes.orbit("1", fits.model_copy(update={"radius_m": 80}), rig.station, ANNA)

    run_with_routes(run_simulated, scenario)


def fence_around_home(radius_m, *, inclusion=True, north_m=0.0):
    lat_deg, lon_deg, _ = LocalOrigin(HOME_LAT_DEG, HOME_LON_DEG, 0.0).to_geodetic((north_m, 0.0, 0.0))
    centre = Point(lat_deg=lat_deg, lon_deg=lon_deg)
    plan = Plan(fence=(FenceCircle(inclusion=inclusion, center=centre, radius_m=radius_m),))
    return {"mission": (), "fence": fence_items(plan), "rally": ()}


@pytest.mark.parametrize("px4", [V1_16, V1_17])
def test_targets_and_circles_are_compared_with_the_vehicles_geofence_before_they_are_sent(run_simulated, px4):
    async def scenario(testbed, vehicle):
        async def refused(code, command, **arguments):
            with pytest.raises(PlanFindings) as error:
                await command(**arguments)
            assert error.value.codes == (code,)
            assert vehicle.status.mode == "hold"

        guided, near = vehicle.guided, {**NORTH, "alt_home_m": 10}  # 56 m north
        circle = {**near, "speed_m_s": 3}
        testbed.loss = 0.0
        await vehicle.mission.upload(fence_around_home(70), PlanReference(None, None, None))
        await guided.goto(**near)
        await refused("fence_violation", guided.orbit, **circle, radius_m=20)
        await refused("fence_violation", guided.goto, **{**near, "lat_deg": HOME_LAT_DEG + 7e-4})
        await guided.goto(HOME_LAT_DEG, HOME_LON_DEG, alt_home_m=10)
        await until(lambda: away_m(vehicle, HOME_LAT_DEG, HOME_LON_DEG) < 3, 60)
        zone = fence_around_home(8, inclusion=False, north_m=30)  # on the straight way to the target
        await vehicle.mission.upload(zone, PlanReference(None, None, None))
        await refused("fence_crossed", guided.goto, **near)
        await guided.goto(HOME_LAT_DEG, HOME_LON_DEG + 5e-4, alt_home_m=10)  # another way is free
        known = vehicle.mission.items_on_vehicle
        vehicle.mission.items_on_vehicle = None  # as after an upload of another station
        await refused("fence_unknown", guided.goto, **near)
        await guided.goto(**near, despite=["fence_unknown"])
        vehicle.mission.items_on_vehicle = known

    run_flying(run_simulated, scenario, px4=px4)


def test_targets_are_compared_with_the_distance_and_height_of_the_geofence_unless_it_does_nothing(
    run_simulated,
):
    async def scenario(testbed, vehicle):
        near, circle = {**NORTH, "alt_home_m": 10}, {**NORTH, "alt_home_m": 10, "speed_m_s": 3}
        await vehicle.params.set("GF_MAX_HOR_DIST", 70)
        await vehicle.params.set("GF_MAX_VER_DIST", 25)
        with pytest.raises(PlanFindings, match=r"up to 7[567] m from home; .* 70 m") as refused:
            await vehicle.guided.orbit(**circle, radius_m=20)
        assert refused.value.codes == ("radius_exceeded",)
        for command in (
            lambda: vehicle.guided.change_altitude(alt_home_m=30),
            lambda: vehicle.guided.goto(**{**near, "alt_home_m": 30}),
        ):
            with pytest.raises(PlanFindings, match=r"30 m above home; .* 25 m \(GF_MAX_VER_DIST\)"):
                await command()
        await vehicle.guided.goto(**near)
        await vehicle.params.set("GF_ACTION", 0)
        await vehicle.guided.change_altitude(alt_home_m=30)

    run_flying(run_simulated, scenario)


def test_targets_below_home_speeds_beyond_the_limit_and_wrong_modes_are_refused(run_simulated):
    async def scenario(rig):
        async def refused(words, route, body):
            with pytest.raises((InvalidRequest, Refused), match=words):
                await route("1", body, rig.station, ANNA)

        await refused(r"20\.0 m below home", command_routes.altitude, models.AltitudeRequest(alt_home_m=-20))
        far_up = models.AltitudeRequest(alt_amsl_m=5000)
        await refused(r"more than the allowed 1000 m", command_routes.altitude, far_up)
        await refused(r"at most 12 m/s", command_routes.speed, models.SpeedRequest(speed_m_s=15))
        too_fast = models.GotoRequest(**NORTH, alt_home_m=10, speed_m_s=15)
        await refused(r"at most 12 m/s", command_routes.goto, too_fast)
        far = models.HomeRequest(lat_deg=HOME_LAT_DEG + 1, lon_deg=HOME_LON_DEG)
        await refused(r"more than the allowed 1000 m", command_routes.home, far)
        rig.autopilot.mode = BY_NAME["rtl"].custom_mode
        await until(lambda: rig.vehicle.status.mode == "rtl", 5)
        await refused(r"in Hold and Mission only", command_routes.speed, models.SpeedRequest(speed_m_s=5))
        here = models.HomeRequest(here=True)
        await refused(r"refers to its present home", command_routes.home, here)
        for number in (DO_REPOSITION, DO_CHANGE_SPEED, DO_SET_HOME):
            assert not rig.autopilot.received_commands(number)

    run_with_routes(run_simulated, scenario)


def test_home_does_not_move_while_setpoints_are_streamed(run_simulated):
    async def scenario(rig):
        await rig.vehicle.offboard.start(stream_request())
        with pytest.raises(Refused, match="limits and altitudes refer to home"):
            await command_routes.home("1", models.HomeRequest(here=True), rig.station, ANNA)
        assert not rig.autopilot.received_commands(DO_SET_HOME)

    run_with_routes(run_simulated, scenario)


@pytest.mark.parametrize("route", ["altitude", "heading", "speed", "orbit"])
def test_a_vehicle_on_the_ground_is_not_guided(run_simulated, route):
    bodies = {
        "altitude": models.AltitudeRequest(alt_home_m=10),
        "heading": models.HeadingRequest(yaw_ned_deg=0),
        "speed": models.SpeedRequest(speed_m_s=3),
        "orbit": ORBIT,
    }

    async def scenario(rig):
        with pytest.raises(Refused, match="not flying"):
            await getattr(command_routes, route)("1", bodies[route], rig.station, ANNA)

    run_with_routes(run_simulated, scenario, flying=False)


@pytest.mark.parametrize(
    "body",
    [
        {"here": True, "lat_deg": 47.0, "lon_deg": 8.0},
        {},
        {"lat_deg": 47.0},
        {"here": True, "alt_amsl_m": 480.0},
    ],
)
def test_a_home_request_has_exactly_one_position(body):
    with pytest.raises(ValueError, match="here: true"):
        models.HomeRequest.model_validate(body)
