"""A vehicle follows a device by the positions that the device reports, on simulated time; when they stop, are
old, inaccurate, far away or jump, it holds."""

import math

import pytest

from gcs_server.errors import InvalidRequest, NotYet, Refused
from gcs_server.streamer.values.limit_values import OperatorLimits
from gcs_server.streamer.values.stream_request import OnExpiry, StreamRequest
from missions.fence import CircleFence
from missions.geodesy import distance_m
from missions.setpoints import FollowDevice, Position
from tests.protocol.offboard_testbed import offboard_event_codes, sleep
from tests.protocol.simulated_testbed import SimulatedTestbed, until
from tests.unit.vehicle_sim.prepared_stations import station_in_hover
from tests.unit.vehicle_sim.sim_station import Station

METRES_PER_DEGREE = 111_195
SIDE_M = (0.0, -12.0)
"""The vehicle stays this far north, east of the device."""


def run_with_hovering_vehicle(run_simulated, scenario):
    async def run():
        testbed = SimulatedTestbed(sim=station_in_hover(Station, 8.0).sim)
        try:
            vehicle = await testbed.wait_for_vehicle()
            await until(lambda: vehicle.status.mode == "hold" and vehicle.topic("home"), 10)
            await scenario(vehicle)
        finally:
            await testbed.close()

    run_simulated(run)


def place(vehicle, north_m, east_m=12.0):
    """A position north and east of home."""
    home = vehicle.topic("home").value
    lon_deg = home.lon_deg + east_m / METRES_PER_DEGREE / math.cos(math.radians(home.lat_deg))
    return {"lat_deg": home.lat_deg + north_m / METRES_PER_DEGREE, "lon_deg": lon_deg}


def request(vehicle, north_m, east_m=12.0, *, valid_for_s=4.0, **fields):
    values = {"accuracy_m": 5.0, "offset_ne_m": SIDE_M, "alt_home_m": 10.0, "yaw": "face", **fields}
    device = FollowDevice(**place(vehicle, north_m, east_m), **values)
    return StreamRequest(device, valid_for_s, OnExpiry(hold_for_s=2.0), "test")


def off_m(vehicle, north_m):
    """Distance over the ground of the vehicle from where it should be."""
    position, target = vehicle.topic("global_position").value, place(vehicle, north_m, 0.0)
    return distance_m(position.lat_deg, position.lon_deg, target["lat_deg"], target["lon_deg"])


def test_the_vehicle_stays_beside_a_walking_device_until_its_positions_stop(run_simulated):
    async def scenario(vehicle):
        assert (await vehicle.offboard.start(request(vehicle, 0.0))).ordered_type == "follow_device"
        for second in range(12):
            walked_m = 1.5 * second
            fields = {"velocity_ne_m_s": (1.5, 0.0), "age_s": 0.2}
            status = await vehicle.offboard.setpoint(request(vehicle, walked_m, **fields))
            assert (status.state, status.setpoint["type"]) == ("streaming", "trajectory")
            await sleep(1.0)
        assert off_m(vehicle, 18.0) < 1.5
        position, attitude = vehicle.topic("global_position").value, vehicle.topic("attitude").value
        assert position.alt_home_m == pytest.approx(10.0, abs=0.7)
        assert attitude.yaw_ned_rad == pytest.approx(math.pi / 2, abs=0.15)  # towards the device, in the east
        await sleep(3.5)
        assert off_m(vehicle, 16.5 + 1.5 * 1.5) < 1.5  # where it was extrapolated for 1.5 s, and not farther
        assert vehicle.status.mode == "offboard"
        await until(lambda: vehicle.status.mode == "hold", 6)
        assert "expired" in offboard_event_codes(vehicle)
        assert off_m(vehicle, 18.75) < 2.5

    run_with_hovering_vehicle(run_simulated, scenario)


def test_positions_that_cannot_be_used_are_refused_and_the_vehicle_then_holds(run_simulated):
    async def scenario(vehicle):
        with pytest.raises(InvalidRequest, match="at most 5 s"):
            await vehicle.offboard.start(request(vehicle, 0.0, valid_for_s=60.0))
        with pytest.raises(Refused, match="from the vehicle; it may be at most 200 m"):
            await vehicle.offboard.start(request(vehicle, 250.0))
        await vehicle.offboard.start(request(vehicle, 0.0))
        await sleep(1.0)
        for fields, text in (
            ({"accuracy_m": 35.0}, "accurate to 35 m"),
            ({"accuracy_m": 13.0}, "no less than the distance from the device"),
            ({"age_s": 9.0}, "9 s old"),
        ):
            with pytest.raises(Refused, match=text):
                await vehicle.offboard.setpoint(request(vehicle, 1.0, **fields))
        with pytest.raises(Refused, match="jumped by 60 m"):
            await vehicle.offboard.setpoint(request(vehicle, 60.0))
        assert (await vehicle.offboard.setpoint(request(vehicle, 10.0))).state == "streaming"  # by bicycle
        await until(lambda: vehicle.status.mode == "hold", 10)
        assert off_m(vehicle, 10.0) < 2.0

    run_with_hovering_vehicle(run_simulated, scenario)


def test_it_never_leaves_the_fence_nor_another_command_of_its_client(run_simulated):
    async def scenario(vehicle):
        home = vehicle.topic("home").value
        limits = OperatorLimits(fence=CircleFence(home.lat_deg, home.lon_deg, 20.0))
        await vehicle.offboard.operator_limits.set(limits, by="test")
        await vehicle.offboard.start(request(vehicle, 0.0))
        for second in range(14):
            await vehicle.offboard.setpoint(request(vehicle, 3.0 * second))
            await sleep(1.0)
        position = vehicle.topic("global_position").value
        assert 14 < distance_m(position.lat_deg, position.lon_deg, home.lat_deg, home.lon_deg) < 20
        assert vehicle.offboard.status().limited
        held = StreamRequest(Position((0.0, 0.0, -9.0)), 60.0, OnExpiry(), "test")
        await vehicle.offboard.setpoint(held)
        await sleep(6.0)
        assert vehicle.offboard.status().ordered_type == "position"
        assert off_m(vehicle, 0.0) < 1.5

    run_with_hovering_vehicle(run_simulated, scenario)


def test_without_home_there_is_no_height_to_fly_at(run_simulated):
    async def scenario(vehicle):
        device = request(vehicle, 0.0)
        vehicle.offboard._estimates.home = lambda: None
        with pytest.raises(NotYet, match="home"):
            vehicle.offboard.check(device)

    run_with_hovering_vehicle(run_simulated, scenario)
