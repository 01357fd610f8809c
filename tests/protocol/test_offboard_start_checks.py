"""Checks before the start of a stream: available setpoints, limits, and the vehicle's own failsafe."""

import itertools

import pytest

from gcs_server.errors import InvalidRequest, Refused, Rejected
from gcs_server.streamer.values.limit_values import OperatorLimits
from gcs_server.streamer.values.stream_request import OnExpiry, StreamRequest
from gcs_server.vehicle.param_table import Param
from missions.fence import CircleFence
from missions.setpoints import (
    KINDS,
    Actuators,
    Attitude,
    Follow,
    Position,
    PositionGlobal,
    Rates,
    Trajectory,
    Velocity,
)
from tests.protocol.command_numbers import DO_SET_MODE
from tests.protocol.fake_autopilot import OFFBOARD_MODE, REAL32
from tests.protocol.offboard_testbed import offboard_event_codes, run_offboard, sleep, stream_request
from vehicle_sim.mavlink import generated_dialect as sim

LEVEL = (1.0, 0.0, 0.0, 0.0)
ATTITUDE, VELOCITY, POSITION, HEIGHT = 1, 2 | 4, 8 | 16, 32
"""Flags of ESTIMATOR_STATUS."""
RATES_ONLY, ATTITUDE_ONLY = 128, 7
"""type_mask of SET_ATTITUDE_TARGET."""


def send_estimator_flags(autopilot, flags):
    autopilot.send(sim.MAVLink_estimator_status_message(0, flags, 0, 0, 0, 0, 0, 0, 0, 0))


def unavailable_setpoints(vehicle):
    return {name for name, available in vehicle.offboard.available().items() if not available.can}


NEVER_AVAILABLE = {"thrust_torque", "actuators"}
NEED_POSITION = {"position", "position_global", "position_body", "path", "follow", "trajectory"}
NEED_POSITION |= {"follow_device"}


@pytest.mark.parametrize(
    ("flags", "expected"),
    [
        (ATTITUDE | VELOCITY | POSITION | HEIGHT, NEVER_AVAILABLE),
        (ATTITUDE | VELOCITY | HEIGHT, NEVER_AVAILABLE | NEED_POSITION),
        (ATTITUDE | VELOCITY | POSITION, NEVER_AVAILABLE | NEED_POSITION),
        (ATTITUDE, NEVER_AVAILABLE | NEED_POSITION | {"velocity", "velocity_body", "acceleration"}),
        (0, set(KINDS)),
    ],
)
def test_setpoints_are_unavailable_without_the_estimates_that_they_need(run_simulated, flags, expected):
    async def scenario(testbed, vehicle, autopilot, link):
        send_estimator_flags(autopilot, flags)
        await sleep(0.1)
        assert unavailable_setpoints(vehicle) == expected
        for name in expected - NEVER_AVAILABLE:
            assert "estimate" in vehicle.offboard.available()[name].why_not

    run_offboard(run_simulated, scenario)


def test_without_an_estimate_attitude_is_available_and_a_position_is_refused_before_anything_is_sent(
    run_simulated,
):
    async def scenario(testbed, vehicle, autopilot, link):
        autopilot.has_estimates = False
        await sleep(1.5)
        for setpoint, text in (
            (Position((0.0, 0.0, -5.0)), "no fresh position"),
            (Velocity((0.0, 0.0, 0.0)), "no fresh velocity"),
            (Trajectory((None, None, None), (1.0, 0.0, 0.0)), "no fresh velocity"),
        ):
            with pytest.raises(Refused, match=text):
                await vehicle.offboard.start(StreamRequest(setpoint))
        assert autopilot.received_commands(DO_SET_MODE) == []
        await vehicle.offboard.start(StreamRequest(Attitude(LEVEL, 0.5), 60.0))
        assert autopilot.mode == OFFBOARD_MODE

    run_offboard(run_simulated, scenario)


def test_setpoints_that_can_never_be_sent_are_refused_with_a_reason(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        for setpoint, error, text in (
            (Position((None, None, None), yaw_ned_rad=1.0), InvalidRequest, "only yaw is controlled"),
            (Position((1.0, None, -5.0)), InvalidRequest, "north and east are needed together"),
            (Actuators((0.5,)), Refused, "MAVLink link carries no actuators"),
            (Follow("1", (3.0, 0.0, 0.0)), InvalidRequest, "cannot follow itself"),
        ):
            with pytest.raises(error, match=f"(?i){text}"):
                await vehicle.offboard.start(StreamRequest(setpoint))
        assert autopilot.setpoints == []

    run_offboard(run_simulated, scenario)


def test_after_a_rates_setpoint_expires_without_an_estimate_the_stream_levels_the_vehicle_until_land(
    run_simulated,
):
    async def scenario(testbed, vehicle, autopilot, link):
        autopilot.has_estimates = False
        autopilot.params["MPC_THR_HOVER"] = (REAL32, 0.44)
        await sleep(1.5)
        targets = autopilot.attitude_and_global_setpoints
        await vehicle.offboard.start(StreamRequest(Rates((0.0, 0.0, 1.0), 0.6), 0.5, OnExpiry("hold", 1.0)))
        assert targets[-1][1].type_mask == RATES_ONLY
        autopilot.silent_commands.add(DO_SET_MODE)
        await sleep(1.0)
        assert "expired" in offboard_event_codes(vehicle)
        assert (targets[-1][1].type_mask, targets[-1][1].thrust) == (ATTITUDE_ONLY, pytest.approx(0.44))
        assert abs(targets[-1][1].q[1]) < 1e-6
        assert int(autopilot.received_commands(DO_SET_MODE)[-1].param3) == 6  # Land

    run_offboard(run_simulated, scenario)


def test_attitude_setpoints_continue_during_a_short_stall_and_stop_after_a_long_stall(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        targets = autopilot.attitude_and_global_setpoints
        await vehicle.offboard.start(StreamRequest(Attitude(LEVEL, 0.5), 60.0))
        update_snapshots, testbed.streamer._streams.update_snapshots = (
            testbed.streamer._streams.update_snapshots,
            lambda snapshots: None,
        )
        await sleep(0.4)
        assert max(b[0] - a[0] for a, b in itertools.pairwise(targets[-15:])) < 0.03
        await sleep(1.6)
        assert testbed.loop.time() - targets[-1][0] > 0.3
        testbed.streamer._streams.update_snapshots = update_snapshots
        await sleep(0.2)
        assert "server_silent" in offboard_event_codes(vehicle)

    run_offboard(run_simulated, scenario)


def test_the_lower_of_the_vehicles_and_the_operators_limit_applies(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        autopilot.params |= {
            "MPC_XY_VEL_MAX": (REAL32, 4.0),
            "MPC_TILTMAX_AIR": (REAL32, 30.0),
            "GF_MAX_HOR_DIST": (REAL32, 60.0),
        }
        await vehicle.offboard.start(stream_request(velocity=(9.0, 0.0, 0.0)))
        await sleep(0.2)
        status = vehicle.offboard.status()
        assert status.setpoint["velocity_ned_m_s"] == pytest.approx((4.0, 0.0, 0.0))
        assert status.limited == ("speed limited to 4 m/s",)
        await vehicle.offboard.operator_limits.set(
            OperatorLimits(speed_max_m_s=2.0, slew_velocity_m_s2=1.0), by="test"
        )
        limits = vehicle.offboard.limits()
        assert limits.vehicle.tilt_max_rad == pytest.approx(0.5236, abs=1e-3)
        assert limits.vehicle.distance_max_m == 60.0
        await sleep(0.5)
        assert autopilot.setpoints[-1][1].vx == pytest.approx(2.0, abs=0.01)
        await vehicle.offboard.setpoint(stream_request(velocity=(-2.0, 0.0, 0.0)))
        await sleep(1.0)
        assert autopilot.setpoints[-1][1].vx == pytest.approx(1.0, abs=0.1)  # slew rate 1 m/s²
        with pytest.raises(Refused, match="limit of 60 m from home"):
            await vehicle.offboard.setpoint(stream_request(position=(70.0, 0.0, -5.0)))

    run_offboard(run_simulated, scenario)


def test_position_limits_that_cannot_be_enforced_are_refused_before_the_start(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        autopilot.has_estimates = False
        await vehicle.offboard.operator_limits.set(
            OperatorLimits(fence=CircleFence(47.397742, 8.545594, 50.0)), by="test"
        )
        await sleep(1.5)
        with pytest.raises(Refused, match="limits cannot be enforced"):
            await vehicle.offboard.start(StreamRequest(Attitude(LEVEL, 0.5)))
        assert autopilot.received_commands(DO_SET_MODE) == []

    run_offboard(run_simulated, scenario)


def test_an_altitude_above_home_is_converted_to_an_altitude_above_sea_level(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        targets = autopilot.attitude_and_global_setpoints
        setpoint = PositionGlobal(47.397742, 8.545594, alt_home_m=7.0)
        await vehicle.offboard.start(StreamRequest(setpoint, 60.0))
        assert (targets[-1][1].coordinate_frame, targets[-1][1].alt) == (
            sim.MAV_FRAME_GLOBAL_INT,
            pytest.approx(496.0),
        )
        assert vehicle.offboard.status().setpoint["alt_amsl_m"] == pytest.approx(496.0)

    run_offboard(run_simulated, scenario)


def test_the_failsafe_is_shown_before_the_start_and_its_parameters_are_set_and_verified(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        await vehicle.offboard.ensure_parameters()
        before = vehicle.offboard.failsafe()
        assert (before.action, before.after_s, before.transmitter) == ("position", 1.0, False)
        assert "lands at its current position" in before.words
        after = await vehicle.offboard.set_failsafe("hold", 2.0)
        assert (after.action, after.after_s) == ("hold", 2.0)
        assert (autopilot.params["COM_OBL_RC_ACT"][1], autopilot.params["COM_OF_LOSS_T"][1]) == (5, 2.0)
        assert "after 2 s the vehicle holds its position" in vehicle.offboard.status().if_stream_stops
        with pytest.raises(InvalidRequest, match="no action"):
            await vehicle.offboard.set_failsafe("disarm", None)
        await vehicle.offboard.start(stream_request(), rate_hz=3.0)
        with pytest.raises(Refused, match="too few"):
            await vehicle.offboard.set_failsafe(None, 0.5)
        autopilot.decoded_value = lambda message: 2.0  # the vehicle keeps its value
        with pytest.raises(Rejected, match="still has COM_OF_LOSS_T"):
            await vehicle.offboard.set_failsafe(None, 5.0)

    run_offboard(run_simulated, scenario)


def test_health_reports_the_time_until_the_failsafe(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        assert vehicle.offboard.status().health.failsafe_in_s is None
        autopilot.params["COM_OF_LOSS_T"] = (REAL32, 0.5)
        await vehicle.offboard.start(stream_request(valid_for_s=3.0))
        await sleep(1.0)
        health = vehicle.offboard.status().health
        assert health.rate_achieved_hz == pytest.approx(50, rel=0.05)
        assert 0.45 < health.failsafe_in_s <= 0.5
        assert health.setpoint_age_s == pytest.approx(1.0, abs=0.05)
        assert health.valid_left_s == pytest.approx(2.0, abs=0.05)
        assert health.sent_age_s < 0.03
        assert health.echo is None  # this vehicle sends no POSITION_TARGET_LOCAL_NED
        assert health.position_error_m == pytest.approx(0.0, abs=0.01)

    run_offboard(run_simulated, scenario)


def test_a_limit_changed_in_flight_applies_at_once(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        await vehicle.offboard.start(stream_request(velocity=(9.0, 0.0, 0.0)))
        values = {"MPC_XY_VEL_MAX": 3.0, "COM_OBL_RC_ACT": 4}
        known = {name: Param(name, value, is_integer=False) for name, value in values.items()}
        vehicle.params.known_each = lambda names: tuple(map(known.get, names))
        await sleep(0.3)
        assert autopilot.setpoints[-1][1].vx == pytest.approx(3.0)
        assert vehicle.offboard.failsafe().action == "land"

    run_offboard(run_simulated, scenario)


def test_a_setpoint_after_the_end_is_refused_with_the_reason(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        await vehicle.offboard.start(stream_request(valid_for_s=0.5, hold_for_s=0.5, client="anna"))
        await sleep(3)
        with pytest.raises(
            Refused, match=r"no setpoint stream.*in Hold.*the setpoint of anna expired after 0.5 s"
        ):
            await vehicle.offboard.setpoint(stream_request())

    run_offboard(run_simulated, scenario)
