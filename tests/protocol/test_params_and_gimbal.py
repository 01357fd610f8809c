"""Single parameters and the gimbal of a scripted autopilot, with packet loss and refusals."""

import math

import pytest

from gcs_server.api import command_routes, models
from gcs_server.errors import InvalidRequest, NoReply, Refused, Rejected
from gcs_server.mavlink import dialect as d
from gcs_server.vehicle.services.gimbal import Roi
from tests.protocol.api_calls import ANNA, run_with_routes
from tests.protocol.command_numbers import DO_SET_ROI_LOCATION, GIMBAL_PITCHYAW
from tests.protocol.fake_autopilot import INT32
from tests.protocol.one_vehicle import PACKET_LOSS_CASES, run_scenario

SERVER, OTHER_STATION = (255, 190), (42, 99)
"""System and component of each."""


@pytest.mark.parametrize(("loss", "seed"), PACKET_LOSS_CASES)
def test_parameters_are_read_and_written_bit_for_bit(run_simulated, loss, seed):
    async def scenario(testbed, vehicle, autopilot):
        assert (await vehicle.params.get("MPC_XY_VEL_MAX")).value == 12.0
        assert (await vehicle.params.set("MPC_XY_VEL_MAX", 9.3)).value == pytest.approx(9.3, abs=1e-6)
        for value in (-1, 0, 77, -8388607, 2**31 - 1):
            param = await vehicle.params.set("NAV_DLL_ACT", value)
            assert (param.value, param.is_integer) == (value, True)
            assert autopilot.params["NAV_DLL_ACT"] == (INT32, value)

    run_scenario(run_simulated, scenario, loss=loss, seed=seed)


def test_requests_of_invalid_parameters_and_values_are_refused(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        with pytest.raises(NoReply, match="NO_SUCH"):
            await vehicle.params.get("NO_SUCH")
        for name in ("", "WAY_TOO_LONG_FOR_A_NAME", "SPACE D", "Ä"):
            with pytest.raises(InvalidRequest):
                await vehicle.params.get(name)
        for value in (math.nan, math.inf, 1.5, 2.0**40):
            with pytest.raises(InvalidRequest):
                await vehicle.params.set("NAV_DLL_ACT", value)
        autopilot.decoded_value = lambda m: 12.0
        with pytest.raises(Rejected, match="still has MPC_XY_VEL_MAX = 12"):
            await vehicle.params.set("MPC_XY_VEL_MAX", 50)

    run_scenario(run_simulated, scenario)


def test_a_parameter_error_is_reported_at_once_unless_it_is_for_another_station(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        receiver = [*SERVER]

        def refuse(message):
            if message.get_type() not in ("PARAM_REQUEST_READ", "PARAM_SET"):
                return False
            is_read = message.get_type() == "PARAM_REQUEST_READ"
            error = d.MAV_PARAM_ERROR_DOES_NOT_EXIST if is_read else d.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE
            name = message.param_id.encode()
            autopilot.send(d.MAVLink_param_error_message(*receiver, name, -1, error))
            return message.param_id not in autopilot.params or receiver == [*SERVER]

        autopilot.handlers.append(refuse)
        with pytest.raises(Rejected, match="refuses parameter NO_SUCH: it has no parameter of that name"):
            await vehicle.params.get("NO_SUCH")
        receiver[:] = OTHER_STATION
        assert (await vehicle.params.get("MPC_XY_VEL_MAX")).value == 12.0
        receiver[:] = SERVER
        with pytest.raises(Rejected, match="MPC_XY_VEL_MAX: the value is out of its range"):
            await vehicle.params.set("MPC_XY_VEL_MAX", 500)

    run_scenario(run_simulated, scenario)


@pytest.mark.parametrize(("loss", "seed"), PACKET_LOSS_CASES)
def test_gimbal_control_is_taken_used_and_released(run_simulated, loss, seed):
    async def scenario(testbed, vehicle, autopilot):
        with pytest.raises(Refused, match="not controlled"):
            await vehicle.gimbal.set_angles(-30, 0)
        autopilot.gimbal_control = (7, 8)
        with pytest.raises(Refused, match="system 7, component 8"):
            await vehicle.gimbal.set_rates(5, 5)
        await vehicle.gimbal.take_control()
        assert autopilot.gimbal_control == SERVER
        await vehicle.gimbal.set_angles(-30, 190, yaw_lock=True)
        command = autopilot.received_commands(GIMBAL_PITCHYAW)[-1]
        assert (command.param1, command.param2, command.param5) == (
            -30,
            pytest.approx(-170),
            d.GIMBAL_MANAGER_FLAGS_YAW_LOCK,
        )
        await vehicle.gimbal.set_rates(10, -5)
        command = autopilot.received_commands(GIMBAL_PITCHYAW)[-1]
        assert (command.param3, command.param4) == (10, -5)
        assert command.param5 == d.GIMBAL_MANAGER_FLAGS_YAW_LOCK, "the active lock was dropped"
        await vehicle.gimbal.set_rates(10, -5, yaw_lock=False)
        assert autopilot.received_commands(GIMBAL_PITCHYAW)[-1].param5 == 0
        await vehicle.gimbal.set_angles(-20, 10, roll_deg=5)
        assert autopilot.gimbal_q[1] != 0
        await vehicle.gimbal.set_roi(47.3982, 8.5456, 490)
        assert autopilot.received_commands(DO_SET_ROI_LOCATION)[-1].get_type() == "COMMAND_INT"
        assert vehicle.gimbal.roi == Roi(47.3982, 8.5456, 490)
        await vehicle.gimbal.clear_roi()
        assert vehicle.gimbal.roi is None
        await vehicle.gimbal.set_roi(47.3982, 8.5456, 490)
        await vehicle.gimbal.set_rates(0, 0)
        assert vehicle.gimbal.roi is None
        await vehicle.gimbal.release_control()
        assert autopilot.gimbal_control == (0, 0)

    run_scenario(run_simulated, scenario, loss=loss, seed=seed)


def test_invalid_gimbal_angles_and_a_missing_gimbal_are_refused(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        for pitch, yaw in ((math.nan, 0), (-150, 0), (0, 400), (0, math.inf)):
            with pytest.raises(InvalidRequest):
                await vehicle.gimbal.set_angles(pitch, yaw)
        autopilot.has_gimbal = False
        with pytest.raises(NoReply, match="gimbal"):
            await vehicle.gimbal.take_control()
        with pytest.raises(NoReply, match="gimbal"):
            await vehicle.gimbal.set_angles(0, 0)

    run_scenario(run_simulated, scenario)


def simulate_turning(autopilot, *, pitch_min_deg, rate_deg_s=60.0):
    """Makes the gimbal turn at this rate and stop at an unreported limit; it accepts any angle."""
    angles_deg = {"pitch": 0.0, "setpoint": 0.0}

    def take_setpoint(message):
        if getattr(message, "command", None) == GIMBAL_PITCHYAW:
            angles_deg["setpoint"] = max(pitch_min_deg, message.param1)
        return False

    def step():
        angles_deg["pitch"] += max(
            -rate_deg_s * 0.05, min(rate_deg_s * 0.05, angles_deg["setpoint"] - angles_deg["pitch"])
        )
        half_rad = math.radians(angles_deg["pitch"]) / 2
        autopilot.gimbal_q = [math.cos(half_rad), 0.0, math.sin(half_rad), 0.0]

    autopilot.handlers.append(take_setpoint)
    autopilot._every(0.05, step)


@pytest.mark.parametrize(("loss", "seed"), PACKET_LOSS_CASES)
def test_a_gimbal_that_stops_at_an_unreported_limit_is_reported_as_limited(run_simulated, loss, seed):
    async def scenario(testbed, vehicle, autopilot):
        simulate_turning(autopilot, pitch_min_deg=-45.0)
        await vehicle.gimbal.take_control()
        limit_reached = await vehicle.gimbal.set_angles(-90, 0)
        assert limit_reached.pitch_deg == pytest.approx(-45.0, abs=0.2)
        assert (limit_reached.asked_pitch_deg, limit_reached.asked_yaw_deg) == (-90, 0)
        assert "pitch -45° instead of -90°" in limit_reached.text
        assert await vehicle.gimbal.set_angles(-30, 0) is None

    run_scenario(run_simulated, scenario, loss=loss, seed=seed)


def test_without_wait_a_gimbal_command_returns_at_its_acknowledgement(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        simulate_turning(autopilot, pitch_min_deg=-90.0, rate_deg_s=10.0)
        await vehicle.gimbal.take_control()
        began_s = testbed.loop.time()
        assert await vehicle.gimbal.set_angles(-90, 0, wait=False) is None
        assert testbed.loop.time() - began_s < 0.3

    run_scenario(run_simulated, scenario)


def test_a_gimbal_that_is_slow_or_does_not_report_is_not_reported_as_limited(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        simulate_turning(autopilot, pitch_min_deg=-90.0, rate_deg_s=10.0)
        await vehicle.gimbal.take_control()
        began_s = testbed.loop.time()
        assert await vehicle.gimbal.set_angles(-90, 0) is None
        assert testbed.loop.time() - began_s < 4.0
        autopilot.send_gimbal_attitude = lambda: None
        assert await vehicle.gimbal.set_angles(0, 0) is None

    run_scenario(run_simulated, scenario)


def test_rates_without_a_yaw_lock_keep_the_active_lock(run_simulated):
    """Without the lock, the camera would turn by the vehicle's heading."""

    async def scenario(rig):
        gimbal, body = (None, None), models.GimbalRates(pitch_rate_deg_s=5, yaw_rate_deg_s=0)
        await rig.vehicle.gimbal.take_control()
        for lock in (True, False):
            await rig.vehicle.gimbal.set_angles(-30, 60, yaw_lock=lock, wait=False)
            await command_routes.gimbal_rates("1", body, rig.station, ANNA, *gimbal)
            flags = d.GIMBAL_MANAGER_FLAGS_YAW_LOCK if lock else 0
            assert rig.autopilot.received_commands(GIMBAL_PITCHYAW)[-1].param5 == flags

    run_with_routes(run_simulated, scenario)
