"""Futures of commands to a simulated PX4 vehicle: what the server knows of it becomes their begin, and the
vehicle then flies inside the corridor."""

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest

from gcs_server.api import futures_routes, models
from gcs_server.api.futures_routes import FuturesRequest
from gcs_server.errors import Refused
from gcs_server.flights import futures_state, futures_worker
from gcs_server.plans import typed_values
from gcs_server.streamer.values.limit_values import OperatorLimits
from missions.fence import CircleFence
from missions.setpoints import Position, Velocity
from missions.values import Altitude, Obstacle, Point
from tests.protocol.api_calls import ANNA, new_station
from tests.protocol.offboard_testbed import sleep
from tests.protocol.simulated_testbed import SimulatedTestbed

HOME_LAT_DEG, HOME_LON_DEG = 47.397742, 8.545594
NORTH_M = 30.0
NORTH_DEG = HOME_LAT_DEG + math.degrees(NORTH_M / 6_371_000.0)
GOTO = {"lat_deg": NORTH_DEG, "lon_deg": HOME_LON_DEG, "alt_home_m": 12}


class InlineFutures:
    """Flies futures in the process of the test."""

    async def fly(self, task, client_key):
        answer = futures_worker.answer(typed_values.to_bytes(task))
        if answer[:1] == b"-":
            raise Refused(answer[1:].decode())
        return answer[1:]

    def close(self):
        """Nothing is running."""


def run_flying(run_simulated, scenario, count=1):
    async def run():
        testbed = SimulatedTestbed(count)
        vehicle = await testbed.take_off()
        station = new_station(testbed)
        station.flights.futures = InlineFutures()
        await scenario(testbed, vehicle, Routes(station))
        await testbed.close()

    run_simulated(run)


class Routes:
    def __init__(self, station):
        self.station = station

    async def futures(self, vehicle_id="1", **body):
        request = FuturesRequest(**{"flights": 40, **body})
        response = await futures_routes.futures(vehicle_id, request, self.station, ANNA)
        return json.loads(response.body)


def test_a_go_to_flies_inside_the_corridor_of_its_futures(run_simulated):
    async def scenario(testbed, vehicle, routes):
        answer = await routes.futures(goto=models.GotoRequest(**GOTO))
        assert (answer["vehicle_id"], answer["command"], answer["flights"]) == ("1", "goto", 40)
        assert answer["arrived"] == 40
        assert answer["assumed"] == ["The parameters of vehicle 1 have not been read: PX4's defaults are "
                                     "taken.", *answer["assumed"][1:]]  # fmt: skip
        await vehicle.guided.goto(**GOTO)
        corridor = answer["corridor"]
        mean, radius = np.array(corridor["position_ned_m"]), np.array(corridor["horizontal_m"])
        arrived_s = None
        for at in range(1, len(mean)):
            await sleep(0.2)
            position = np.array(vehicle.topic("local_position").value.position_ned_m)
            assert math.hypot(*(position - mean[at])[:2]) < radius[at] + 1.0, at
            if at == 20:
                land = await routes.futures(mode="land")
                assert "descent may begin some seconds later" in land["assumed"][-1]
            if arrived_s is None and math.dist(position, answer["target_ned_m"]) < 1.0:
                arrived_s = 0.2 * at
        assert answer["arrival_s"]["p5"] - 0.5 < arrived_s < answer["arrival_s"]["p95"] + 1.0

    run_flying(run_simulated, scenario)


def test_an_orbit_flies_inside_the_corridor_of_its_futures(run_simulated):
    async def scenario(testbed, vehicle, routes):
        body = {**GOTO, "radius_m": 15.0, "speed_m_s": 3.0}
        answer = await routes.futures(orbit=models.OrbitRequest(**body), horizon_s=25)
        await vehicle.guided.orbit(**body)
        mean, radius = (np.array(answer["corridor"][name]) for name in ("position_ned_m", "horizontal_m"))
        for at in range(5, len(mean), 5):
            await sleep(1.0)
            position = np.array(vehicle.topic("local_position").value.position_ned_m)
            assert math.hypot(*(position - mean[at])[:2]) < radius[at] + 1.5, at
        assert radius.max() < 8.0

    run_flying(run_simulated, scenario)


def test_known_parameters_and_battery_are_the_begin_and_nothing_reaches_the_vehicle(run_simulated):
    async def scenario(testbed, vehicle, routes):
        await vehicle.params.refresh()
        before = vehicle.status.mode
        answer = await routes.futures(mode="hold", horizon_s=5)
        assert answer["assumed"] == []
        assert answer["battery_start_share"] > answer["battery_end_share"]["p50"]
        assert answer["origin"]["alt_amsl_m"] > 400.0
        climb = await routes.futures(altitude=models.AltitudeRequest(alt_home_m=20), horizon_s=15)
        assert climb["corridor"]["position_ned_m"][-1][2] < -18.0
        land = await routes.futures(mode="land", horizon_s=30)
        assert (land["landed"], land["touched_ground"], land["assumed"]) == (40, 0, [])
        await sleep(1.0)
        assert vehicle.status.mode == before
        assert abs(vehicle.topic("local_position").value.position_ned_m[2] + 10.0) < 2.0

    run_flying(run_simulated, scenario)


def test_limits_of_the_stream_reduce_its_futures_and_the_fence_is_near(run_simulated):
    async def scenario(testbed, vehicle, routes):
        offboard = routes.station.offboard("1")
        velocity = Velocity((8.0, 0.0, 0.0))
        free = await routes.futures(setpoint=velocity, horizon_s=10)
        assert free["limited"] == []
        fence = CircleFence(HOME_LAT_DEG, HOME_LON_DEG, 25.0)
        await offboard.operator_limits.set(OperatorLimits(speed_max_m_s=3.0, fence=fence), by="test")
        limited = await routes.futures(setpoint=velocity, horizon_s=10)
        assert any("3" in each for each in limited["limited"]), limited["limited"]
        assert limited["corridor"]["position_ned_m"][-1][0] < 25.0 < free["corridor"]["position_ned_m"][-1][0]
        assert 0.0 < limited["fence"]["distance_m"] < 25.0
        assert "The setpoint is renewed for the whole time." in limited["assumed"]
        inside = await routes.futures(setpoint=Position((5.0, 0.0, -10.0)), horizon_s=10)
        assert inside["target_ned_m"] == [5.0, 0.0, -10.0]
        assert inside["arrived"] == 40

    run_flying(run_simulated, scenario)


def test_obstacles_and_another_vehicle_are_compared(run_simulated):
    async def scenario(testbed, vehicle, routes):
        corners = [(NORTH_DEG - 1e-4, -3e-5), (NORTH_DEG - 8e-5, -3e-5), (NORTH_DEG - 8e-5, 3e-5)]
        tower = Obstacle(
            name="Tower",
            polygon=tuple(Point(lat_deg=lat, lon_deg=HOME_LON_DEG + lon) for lat, lon in corners),
            top=Altitude(value_m=40, reference="home"),
        )
        answer = await routes.futures(goto=models.GotoRequest(**GOTO), obstacles=[tower])
        assert answer["obstacle"]["name"] == "Tower"
        assert answer["obstacle"]["touched"] > 20
        assert not answer["clear"]
        assert answer["vehicle"]["name"] == "2"
        assert 2.0 < answer["vehicle"]["distance_m"] < 15.0, "it stands on the ground 3 m to the east"

    run_flying(run_simulated, scenario, count=2)


def test_a_vehicle_on_the_ground_or_without_a_position_has_no_futures(run_simulated):
    async def scenario(testbed, vehicle, routes):
        for vehicle_id, reason in (("2", "not flying"), ("1", "no valid position")):
            if vehicle_id == "1":
                testbed.loss = 1.0
                await sleep(2.5)
            with pytest.raises(Refused, match=reason):
                await routes.futures(vehicle_id, mode="hold")

    run_flying(run_simulated, scenario, count=2)


def test_the_body_of_a_real_vehicle_is_said_to_be_assumed(run_simulated):
    async def scenario(testbed, vehicle, routes):
        known = {"MPC_THR_HOVER": 0.25, "MPC_XY_CRUISE": 7.0, "MC_ROLLRATE_P": 9.0}
        assumed = []

        class Real:
            id = "1"
            identity = vehicle.identity

            params = SimpleNamespace(
                all=lambda: [SimpleNamespace(name=name, value=value) for name, value in known.items()]
            )

        values = futures_state._parameters(Real, routes.station.flights.models, assumed)
        assert values["SIH_T_MAX"] * 4 * 0.25 == 9.80665
        assert (values["MPC_XY_CRUISE"], "MC_ROLLRATE_P" in values) == (7.0, False)
        assert "PX4's simulated quadrotor is taken" in assumed[0]

    run_flying(run_simulated, scenario)
