"""A simulated PX4 flies every type of setpoint that the server sends, on simulated time."""

import asyncio
import math

import pytest

from gcs_server.errors import Refused
from gcs_server.streamer.values.limit_values import OperatorLimits
from gcs_server.streamer.values.stream_request import OnExpiry, StreamRequest
from missions.fence import CircleFence
from missions.frames import q_from_euler
from missions.setpoints import (
    Acceleration,
    Attitude,
    Follow,
    Path,
    PathPoint,
    Position,
    PositionBody,
    PositionGlobal,
    Rates,
    Trajectory,
    Velocity,
    VelocityBody,
)
from tests.protocol.offboard_testbed import offboard_event_codes, sleep
from tests.protocol.simulated_testbed import SimulatedTestbed, until
from tests.unit.vehicle_sim.prepared_stations import station_in_hover
from tests.unit.vehicle_sim.sim_station import Station

METRES_PER_DEGREE = 111_195


def run_with_hovering_vehicle(run_simulated, scenario, alt_home_m=8.0):
    """Runs a test that begins with one vehicle in Hold at this altitude above home."""

    async def run():
        testbed = SimulatedTestbed(sim=station_in_hover(Station, alt_home_m).sim)
        try:
            vehicle = await testbed.wait_for_vehicle()
            await until(lambda: vehicle.status.mode == "hold" and vehicle.topic("home"), 10)
            await scenario(testbed, vehicle)
        finally:
            await testbed.close()

    run_simulated(run)


def local_position(vehicle):
    return vehicle.topic("local_position").value


def attitude(vehicle):
    return vehicle.topic("attitude").value


def stream_request(setpoint, valid_for_s=60.0, **expiry):
    return StreamRequest(setpoint, valid_for_s, OnExpiry(**expiry), "test")


async def fly(vehicle, setpoint, duration_s):
    """Sends a setpoint on the running stream and flies it."""
    await vehicle.offboard.setpoint(stream_request(setpoint))
    await sleep(duration_s)
    status = vehicle.offboard.status()
    assert status.state == "streaming", (setpoint, status.ended, offboard_event_codes(vehicle))
    assert vehicle.status.mode == "offboard"
    return status


def distance_m(vehicle, position_ned_m):
    return math.dist(local_position(vehicle).position_ned_m, position_ned_m)


@pytest.mark.story
def test_position_velocity_and_acceleration_setpoints_are_flown(run_simulated):
    async def scenario(testbed, vehicle):
        status = await vehicle.offboard.start(stream_request(Position((3.0, 2.0, -8.0), yaw_ned_rad=1.0)))
        assert status.ordered_type == "position"
        await sleep(6)
        assert distance_m(vehicle, (3.0, 2.0, -8.0)) < 0.6
        assert attitude(vehicle).yaw_ned_rad == pytest.approx(1.0, abs=0.1)
        health = vehicle.offboard.status().health
        assert health.echo.position_ned_m == pytest.approx((3.0, 2.0, -8.0), abs=1e-3)
        assert health.echo.yaw_ned_rad == pytest.approx(1.0, abs=1e-3)
        assert health.position_error_m == pytest.approx(distance_m(vehicle, (3.0, 2.0, -8.0)), abs=0.3)
        assert health.rate_achieved_hz == pytest.approx(50, rel=0.05)
        assert 0.9 < health.failsafe_in_s <= 1.0

        home = vehicle.topic("home").value
        target = PositionGlobal(home.lat_deg, home.lon_deg + 5e-5, alt_home_m=9.0, yaw_ned_rad=math.pi / 2)
        await fly(vehicle, target, 6)
        position = vehicle.topic("global_position").value
        assert (position.lat_deg, position.lon_deg) == pytest.approx((home.lat_deg, target.lon_deg), abs=1e-5)
        assert position.alt_home_m == pytest.approx(9.0, abs=0.6)

        start_ned_m = local_position(vehicle).position_ned_m
        await fly(vehicle, PositionBody((4.0, 0.0, 1.0)), 6)  # the heading is east: forward is east
        assert distance_m(vehicle, (start_ned_m[0], start_ned_m[1] + 4.0, start_ned_m[2] + 1.0)) < 0.9

        await fly(vehicle, Velocity((2.0, 0.0, 0.0), yaw_ned_rad=math.pi / 2), 4)
        n, e, d = local_position(vehicle).velocity_ned_m_s
        assert n == pytest.approx(1.75, abs=0.3)
        assert (e, d) == pytest.approx((0.0, 0.0), abs=0.3)
        await fly(vehicle, VelocityBody((2.0, 0.0, 0.0), yaw_ned_rad=math.pi / 2), 4)
        n, e, d = local_position(vehicle).velocity_ned_m_s
        assert e == pytest.approx(1.75, abs=0.3)
        assert (n, d) == pytest.approx((0.0, 0.0), abs=0.3)

        await fly(vehicle, Velocity((0.0, 0.0, 0.0), yaw_rate_ned_rad_s=0.4), 2)
        assert attitude(vehicle).rates_frd_rad_s[2] == pytest.approx(0.4, abs=0.1)

        north_m_s = local_position(vehicle).velocity_ned_m_s[0]
        await fly(vehicle, Acceleration((-0.8, 0.0, 0.0)), 2)
        change_m_s = local_position(vehicle).velocity_ned_m_s[0] - north_m_s
        assert -1.7 < change_m_s < -0.5  # drag and delay make the change smaller than 1.6 m/s

        down_m = local_position(vehicle).position_ned_m[2]
        mixed_setpoint = Trajectory((None, None, down_m), (1.0, 0.0, None), (0.0, 0.0, None), yaw_ned_rad=0.0)
        await fly(vehicle, mixed_setpoint, 4)
        assert local_position(vehicle).velocity_ned_m_s[0] == pytest.approx(0.9, abs=0.25)
        assert local_position(vehicle).position_ned_m[2] == pytest.approx(down_m, abs=0.5)
        await vehicle.offboard.stop()
        assert vehicle.status.mode == "hold"

    run_with_hovering_vehicle(run_simulated, scenario)


@pytest.mark.story
def test_attitude_and_rates_setpoints_are_flown_and_expire(run_simulated):
    async def scenario(testbed, vehicle):
        thrust = 0.49
        await vehicle.offboard.start(stream_request(Position((0.0, 0.0, -12.0), yaw_ned_rad=0.0)))
        await fly(vehicle, Attitude(q_from_euler(math.radians(6), 0.0, 0.0), thrust), 1.5)
        assert math.degrees(attitude(vehicle).roll_rad) == pytest.approx(6, abs=1.5)
        health = vehicle.offboard.status().health
        assert health.attitude_error_rad < math.radians(4)
        assert health.echo.thrust == pytest.approx(thrust, abs=0.01)
        await fly(vehicle, Attitude((1.0, 0.0, 0.0, 0.0), thrust, yaw_rate_ned_rad_s=0.0), 1)
        await fly(vehicle, Rates((0.0, 0.0, 0.6), thrust), 1.5)
        assert attitude(vehicle).rates_frd_rad_s[2] == pytest.approx(0.6, abs=0.1)
        expiring_request = stream_request(
            Attitude((1.0, 0.0, 0.0, 0.0), thrust), 0.5, action="hold", hold_for_s=4.0
        )
        await vehicle.offboard.setpoint(expiring_request)
        await sleep(0.8)
        status = vehicle.offboard.status()
        assert (status.state, status.setpoint["type"]) == ("holding", "position")
        hold_position_ned_m = status.setpoint["position_ned_m"]
        await sleep(3)
        assert distance_m(vehicle, hold_position_ned_m) < 1.0
        await until(lambda: vehicle.status.mode == "hold", 5)

    run_with_hovering_vehicle(run_simulated, scenario, 12.0)


def test_thrust_torque_and_motor_setpoints_of_another_program_are_detected(run_simulated):
    """The simulator accepts these setpoints only by its internal interface. While the vehicle follows them,
    the server detects that another program uses Offboard, and sends nothing."""

    async def scenario(testbed, vehicle):
        offboard = testbed.sim.autopilots[0].offboard

        async def call_repeatedly(send, duration_s):
            for _ in range(int(duration_s / 0.02)):
                send()
                await asyncio.sleep(0.02)

        def hover():
            offboard.thrust_torque((0.0, 0.0, -0.49), (0.0, 0.0, 0.0))

        async with asyncio.TaskGroup() as group:
            streaming = group.create_task(call_repeatedly(hover, 2.5))
            await sleep(1.2)
            await vehicle.command.set_mode("offboard")
            with pytest.raises(Refused, match="another program"):
                await vehicle.offboard.start(stream_request(Position((0.0, 0.0, -8.0))))
            await sleep(0.6)
            assert abs(local_position(vehicle).position_ned_m[2] + 8) < 2
            await streaming
        motors = (0.5, 0.5, 0.5, 0.5)
        await call_repeatedly(lambda: offboard.actuators(motors), 0.3)
        assert vehicle.topic("motors").value.pwm_us[:4] == pytest.approx([1500] * 4, abs=120)
        await vehicle.command.hold()

    run_with_hovering_vehicle(run_simulated, scenario)


def test_a_path_is_flown_to_its_end_without_further_messages_of_the_client(run_simulated):
    async def scenario(testbed, vehicle):
        begin_ned_m = local_position(vehicle).position_ned_m
        corners = ((0, 0), (6, 0), (6, 6), (0, 6), (0, 0))
        points = tuple(
            PathPoint(4.0 * index, (begin_ned_m[0] + n, begin_ned_m[1] + e, begin_ned_m[2]))
            for index, (n, e) in enumerate(corners)
        )
        status = await vehicle.offboard.start(stream_request(Path(points), valid_for_s=1.0, hold_for_s=1.0))
        assert status.valid_left_s == pytest.approx(17.0, abs=0.1)
        max_distance_m = 0.0
        for index in range(1, 5):
            await sleep(4)
            max_distance_m = max(max_distance_m, distance_m(vehicle, points[index].position_ned_m))
            assert vehicle.offboard.status().ordered_type == "path"
        assert max_distance_m < 1.6  # the vehicle lags behind a moving setpoint
        await sleep(0.5)
        assert distance_m(vehicle, points[-1].position_ned_m) < 1.0
        await until(lambda: vehicle.status.mode == "hold", 6)  # expired a second after the path's end
        await sleep(0.3)
        assert offboard_event_codes(vehicle) == ["expired", "held"]
        with pytest.raises(Refused, match="begins 2"):
            far_points = tuple(
                PathPoint(p.t_s, (p.position_ned_m[0] + 20.0, *p.position_ned_m[1:])) for p in points
            )
            await vehicle.offboard.start(stream_request(Path(far_points)))
        with pytest.raises(Refused, match="m/s are allowed"):
            fast_points = (
                PathPoint(0.0, local_position(vehicle).position_ned_m),
                PathPoint(1.0, points[2].position_ned_m),
            )
            await vehicle.offboard.operator_limits.set(OperatorLimits(speed_max_m_s=5.0), by="test")
            await vehicle.offboard.start(stream_request(Path(fast_points)))

    run_with_hovering_vehicle(run_simulated, scenario)


@pytest.mark.story
def test_a_fence_stops_the_vehicle_and_targets_outside_are_refused(run_simulated):
    async def scenario(testbed, vehicle):
        home = vehicle.topic("home").value
        await vehicle.offboard.operator_limits.set(
            OperatorLimits(fence=CircleFence(home.lat_deg, home.lon_deg, 25.0), height_max_m=12.0), by="test"
        )
        with pytest.raises(Refused, match="outside the operator's geofence"):
            await vehicle.offboard.start(stream_request(Position((40.0, 0.0, -8.0))))
        with pytest.raises(Refused, match="altitude limits"):
            await vehicle.offboard.start(stream_request(Position((10.0, 0.0, -14.0))))
        await vehicle.offboard.start(stream_request(Velocity((6.0, 0.0, -1.0), yaw_ned_rad=0.0)))
        farthest_m = highest_m = 0.0
        for _ in range(160):
            await sleep(0.1)
            n, e, d = local_position(vehicle).position_ned_m
            farthest_m, highest_m = max(farthest_m, math.hypot(n, e)), max(highest_m, -d)
        assert 20 < farthest_m < 25.2
        assert 10.5 < highest_m < 12.5  # the estimated altitude drifts by a few decimetres
        status = vehicle.offboard.status()
        assert any("before the geofence" in text for text in status.limited)
        assert math.hypot(*local_position(vehicle).velocity_ned_m_s[:2]) < 0.4
        assert "limited" in offboard_event_codes(vehicle)
        # Attitude setpoints control no position: the server stops the vehicle before the fence.
        await fly(vehicle, Position((5.0, 0.0, -8.0), yaw_ned_rad=0.0), 8)
        await vehicle.offboard.setpoint(
            stream_request(Attitude(q_from_euler(0.0, math.radians(-12), 0.0), 0.505))
        )
        farthest_m = 0.0
        for _ in range(120):
            await sleep(0.1)
            n, e, _ = local_position(vehicle).position_ned_m
            farthest_m = max(farthest_m, math.hypot(n, e))
        assert "fence" in offboard_event_codes(vehicle)
        assert farthest_m < 25.2
        await until(lambda: vehicle.status.mode == "hold", 8)

    run_with_hovering_vehicle(run_simulated, scenario)


@pytest.mark.story
def test_one_vehicle_follows_another_until_the_other_is_lost(run_simulated):
    async def run():
        testbed = SimulatedTestbed(2)
        try:
            await fly_beside_leader(testbed)
        finally:
            await testbed.close()

    async def fly_beside_leader(testbed):
        leader, follower = await testbed.take_off("1", 8), await testbed.take_off("2", 11)
        await leader.offboard.start(stream_request(Velocity((0.0, 0.0, 0.0), yaw_ned_rad=0.0)))
        beside_leader = Follow("1", offset_ned_m=(0.0, 4.0, -3.0), yaw="same")
        await follower.offboard.start(stream_request(beside_leader, valid_for_s=300, hold_for_s=2.0))
        await sleep(4)
        await leader.offboard.setpoint(stream_request(Velocity((2.0, 1.0, 0.0), yaw_ned_rad=0.5)))
        await sleep(8)
        leader_position, follower_position = (
            leader.topic("global_position").value,
            follower.topic("global_position").value,
        )
        north_m = (follower_position.lat_deg - leader_position.lat_deg) * METRES_PER_DEGREE
        east_m = (
            (follower_position.lon_deg - leader_position.lon_deg)
            * METRES_PER_DEGREE
            * math.cos(math.radians(leader_position.lat_deg))
        )
        assert (north_m, east_m) == pytest.approx((0.0, 4.0), abs=1.3)
        assert follower_position.alt_amsl_m - leader_position.alt_amsl_m == pytest.approx(3.0, abs=0.8)
        assert attitude(follower).yaw_ned_rad == pytest.approx(0.5, abs=0.15)
        testbed.sim.set_link_up(0, "gcs", False)
        await sleep(2.5)
        assert "leader_lost" in offboard_event_codes(follower)
        assert follower.offboard.status().state in ("holding", "to_hold", "idle")
        await until(lambda: follower.status.mode == "hold", 6)

    run_simulated(run)
