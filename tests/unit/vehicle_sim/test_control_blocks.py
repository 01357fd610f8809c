"""Each controller alone: saturation, filters, and values that are not finite."""

import math

import numpy as np
import pytest

from vehicle_sim import frames
from vehicle_sim.control.allocation import Allocation, mixer_from_parameters
from vehicle_sim.control.attitude import AttitudeControl
from vehicle_sim.estimator.gyro_filter import GyroFilter
from vehicle_sim.parameters import Parameters
from vehicle_sim.simulation import ControlLevel, Simulation


def configured_allocation(count: int = 1) -> Allocation:
    block = Allocation(count)
    for i in range(count):
        block.configure(i, Parameters())
    return block


def motor_signals(block: Allocation, torque: np.ndarray, thrust: np.ndarray) -> np.ndarray:
    motors = np.zeros((len(thrust), 4))
    block.update(np.ones(len(thrust), dtype=np.bool_), torque, thrust, motors)
    return motors


def rate_setpoints(control: AttitudeControl, q: np.ndarray, setpoint: np.ndarray, yaw_rate: np.ndarray):
    rates = np.zeros((len(q), 3))
    control.update(np.ones(len(q), dtype=np.bool_), q, setpoint, yaw_rate, rates)
    return rates


def test_the_mixer_is_the_normalised_quad_x():
    s = math.sqrt(0.5)
    assert mixer_from_parameters(Parameters()) == pytest.approx(
        np.array([[-s, s, s, -s], [s, -s, s, -s], [1, 1, -1, -1], [1, 1, 1, 1]])
    )


def test_rotors_in_a_line_are_refused():
    overrides = {f"CA_ROTOR{k}_PY": 0.0 for k in range(4)}
    with pytest.raises(ValueError, match="CA_ROTOR"):
        mixer_from_parameters(Parameters(overrides))


def test_demands_within_the_motor_limits_are_allocated_exactly():
    motors = motor_signals(configured_allocation(), np.array([[0.05, -0.02, 0.03]]), np.array([0.5]))
    expected = 0.5 + np.array([0.05, -0.02, 0.03]) @ mixer_from_parameters(Parameters())[:3]
    assert motors[0] == pytest.approx(expected)


def test_roll_has_priority_over_thrust_at_full_thrust():
    block = configured_allocation()
    motors = motor_signals(block, np.array([[0.2, 0.0, 0.0]]), np.array([1.0]))
    assert motors.max() == pytest.approx(1.0)
    assert motors[0, 1] - motors[0, 0] == pytest.approx(0.2 * 2 * math.sqrt(0.5))
    assert block.unallocated[0] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)


def test_torque_is_zero_at_zero_thrust_without_airmode():
    block = configured_allocation()
    motors = motor_signals(block, np.array([[0.3, 0.3, 0.3]]), np.array([0.0]))
    assert motors[0] == pytest.approx(np.zeros(4), abs=1e-9)
    assert np.all(block.unallocated[0] > 0.1)


def test_roll_has_priority_over_yaw():
    motors = motor_signals(configured_allocation(), np.array([[0.2, 0.0, 0.9]]), np.array([0.5]))
    roll = (motors[0] @ np.array([-1, 1, 1, -1])) / (4 * math.sqrt(0.5))
    yaw = (motors[0] @ np.array([1, 1, -1, -1])) / 4
    assert roll == pytest.approx(0.2, abs=0.03)
    assert 0.1 < yaw < 0.6


def test_motor_signals_of_random_demands_stay_within_their_limits():
    generator = np.random.default_rng(1)
    block = configured_allocation(200)
    for _ in range(20):
        motors = motor_signals(block, generator.uniform(-2, 2, (200, 3)), generator.uniform(0, 1, 200))
        assert motors.min() >= 0.0
        assert motors.max() <= 1.0


def test_an_attitude_error_is_corrected_by_the_shortest_rotation():
    control = AttitudeControl(2)
    for i in range(2):
        control.configure(i, Parameters())
    level = frames.quaternion_from_yaw(np.zeros(2))
    setpoint = np.stack(
        [frames.quaternion_from_euler(0.1, 0.0, 0.0), frames.quaternion_from_euler(0.0, 0.0, 0.1)]
    )
    rates = rate_setpoints(control, level, setpoint, np.full(2, np.nan))
    assert rates[0] == pytest.approx([4.0 * 2 * math.sin(0.05), 0.0, 0.0], abs=1e-6)
    # MC_ROLL_P is 4.0, MC_YAW_P is 2.8; the yaw weight reduces the angle, and the gain compensates it.
    assert rates[1] == pytest.approx([0.0, 0.0, 2.8 * 0.1], abs=1e-3)
    assert rate_setpoints(control, level, -setpoint, np.full(2, np.nan)) == pytest.approx(rates)


def test_a_yaw_rate_is_fed_forward_about_the_vertical():
    control = AttitudeControl(2)
    for i in range(2):
        control.configure(i, Parameters())
    level = frames.quaternion_from_yaw(np.zeros(2))
    rates = rate_setpoints(control, level, level, np.array([0.5, np.nan]))
    assert rates == pytest.approx(np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 0.0]]), abs=1e-9)


@pytest.mark.parametrize("yaw", [0.3, 2.0, -3.0])
@pytest.mark.parametrize(("roll", "pitch"), [(0.4, -0.2), (-1.0, 0.6), (3.0, 0.1)])
def test_attitude_control_reaches_the_setpoint_from_any_attitude(roll, pitch, yaw):
    control = AttitudeControl(1)
    control.configure(0, Parameters())
    q = frames.quaternion_from_euler(roll, pitch, yaw)[None, :]
    setpoint = frames.quaternion_from_euler(0.1, -0.1, -0.5)[None, :]
    for _ in range(1500):
        q = frames.normalized(
            q + 0.004 * frames.quaternion_rate(q, rate_setpoints(control, q, setpoint, np.zeros(1)))
        )
    assert abs(float(q[0] @ setpoint[0])) == pytest.approx(1.0, abs=1e-5)


def test_the_gyro_filter_passes_low_and_attenuates_high_frequencies():
    times = 0.004 * np.arange(2000)

    def gain(frequency_hz: float) -> tuple[float, float]:
        filters = GyroFilter(1, 0.004)
        filters.configure(0, 40.0, 30.0)
        rates, slopes = np.zeros((1, 3)), np.zeros((1, 3))
        outputs = []
        for t in times:
            filters.update(np.full((1, 3), math.sin(2 * math.pi * frequency_hz * t)), rates, slopes)
            outputs.append((rates[0, 0], slopes[0, 0]))
        settled = np.abs(np.array(outputs)[1000:])
        return float(settled[:, 0].max()), float(settled[:, 1].max())

    low_frequency_gain, low_frequency_slope = gain(1.0)
    assert low_frequency_gain == pytest.approx(1.0, abs=0.01)
    assert low_frequency_slope == pytest.approx(2 * math.pi, rel=0.02)
    assert gain(40.0)[0] == pytest.approx(math.sqrt(0.5), abs=0.02)
    assert gain(100.0)[0] < 0.05


@pytest.mark.parametrize("level", [ControlLevel.RATES, ControlLevel.ATTITUDE, ControlLevel.TRAJECTORY])
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_setpoints_that_are_not_finite_leave_the_state_finite(level, value):
    sim = Simulation(2, start_ned_m=np.array([[0.0, 0.0, -20.0], [0.0, 3.0, -20.0]]))
    setpoints = sim.setpoints
    setpoints.armed[:] = True
    setpoints.level[:] = level
    setpoints.thrust[:] = 0.49
    setpoints.position_ned_m[1] = (0.0, 0.0, -20.0)
    for values in (
        setpoints.rates_frd_rad_s,
        setpoints.q_ned_frd,
        setpoints.position_ned_m,
        setpoints.velocity_ned_m_s,
        setpoints.acceleration_ned_m_s2,
        setpoints.thrust,
        setpoints.yaw_ned_rad,
        setpoints.yaw_rate_ned_rad_s,
    ):
        values[0] = value
    for _ in range(100):
        sim.step()
    assert np.isfinite(sim.truth.position_ned_m).all()
    assert np.isfinite(sim.truth.q_ned_frd).all()
    assert np.isfinite(sim.motors_us).all()


def test_a_nan_gain_is_stored_but_not_used():
    parameters = Parameters({"MC_ROLLRATE_P": math.nan, "EKF2_ACC_NOISE": math.inf, "MPC_VELD_LP": math.nan})
    assert math.isnan(parameters.get("MC_ROLLRATE_P"))
    sim = Simulation(parameters=[parameters])
    sim.setpoints.armed[:] = True
    sim.setpoints.level[:] = ControlLevel.TRAJECTORY
    sim.setpoints.position_ned_m[:] = (0.0, 0.0, -3.0)
    for _ in range(1000):
        sim.step()
    assert sim.truth.position_ned_m[0, 2] == pytest.approx(-2.5, abs=1.2)
