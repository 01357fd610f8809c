"""Properties of the simulated vehicle's motion: balance, signs, symmetry, determinism."""

import math

import numpy as np
import pytest

from vehicle_sim import frames
from vehicle_sim.parameters import Parameters
from vehicle_sim.sensors.suite import BARO_TEMPERATURE_DEG_C
from vehicle_sim.simulation import ControlLevel, Simulation
from vehicle_sim.state import SimulationOrigin

pytestmark = pytest.mark.flight


def run(sim: Simulation, seconds: float) -> None:
    for _ in range(round(seconds / sim.dt_s)):
        sim.step()


def hovering_sim(count: int = 1, *, noise: bool = False, seconds: float = 10.0, **arguments) -> Simulation:
    """N vehicles that hover 10 m above their estimated start, heading north."""
    sim = Simulation(count, sensor_noise=noise, **arguments)
    run(sim, 1.0)
    sim.setpoints.armed[:] = True
    sim.setpoints.level[:] = ControlLevel.TRAJECTORY
    sim.setpoints.position_ned_m[:] = sim.estimate.position_ned_m + np.array([0.0, 0.0, -10.0])
    sim.setpoints.yaw_ned_rad[:] = 0.0
    run(sim, seconds)
    return sim


def test_disarmed_vehicles_on_the_ground_do_not_move():
    sim = Simulation(2)
    run(sim, 5.0)
    assert np.all(sim.truth.position_ned_m == np.array([[0.0, 0.0, 0.0], [0.0, 3.0, 0.0]]))
    assert sim.truth.on_ground.all()
    assert np.all(np.abs(sim.estimate.position_ned_m) < 1.5)
    assert np.all(np.abs(sim.estimate.velocity_ned_m_s) < 0.3)
    assert np.all(sim.motors_us == 900.0)
    assert sim.estimate.valid_position.all()


def test_motors_idle_when_armed_without_a_setpoint():
    sim = Simulation()
    sim.setpoints.armed[:] = True
    run(sim, 1.0)
    assert np.all(sim.motors_us == 1000.0)
    assert sim.truth.on_ground.all()


def test_position_is_valid_soon_after_boot_and_equals_home():
    sim = Simulation(origin=SimulationOrigin(10.0, 20.0, 100.0), sensor_noise=False)
    run(sim, 0.3)
    assert not sim.estimate.valid_position[0]
    assert math.isnan(sim.estimate.lat_deg[0])
    run(sim, 0.6)
    assert sim.estimate.valid_position[0]
    assert sim.estimate.lat_deg[0] == pytest.approx(10.0, abs=1e-7)
    assert sim.estimate.alt_amsl_m[0] == pytest.approx(100.0, abs=0.01)


@pytest.mark.story
def test_the_hover_thrust_balances_the_weight():
    sim = hovering_sim(seconds=40.0)
    # 1 kg on four rotors of 5 N.
    assert sim.target.thrust[0] == pytest.approx(frames.GRAVITY_M_S2 / 20.0, abs=0.002)
    assert sim.target.hover_thrust[0] == pytest.approx(0.4903, abs=0.003)
    assert sim.truth.position_ned_m[0] == pytest.approx([0.0, 0.0, -10.0], abs=0.05)
    assert np.all(np.abs(sim.truth.velocity_ned_m_s) < 0.02)


@pytest.mark.story
def test_a_hover_with_noise_drifts_less_than_1_6_m():
    sim = hovering_sim(4, noise=True, seed=3)
    start = sim.truth.position_ned_m.copy()
    largest_error_m = np.zeros(4)
    for _ in range(10):
        run(sim, 1.0)
        error_m = sim.estimate.position_ned_m - sim.setpoints.position_ned_m
        largest_error_m = np.maximum(largest_error_m, np.abs(error_m).max(axis=1))
        assert np.all(np.abs(sim.truth.position_ned_m - start) < 1.6)
    assert np.all(largest_error_m < 0.8)


def test_a_yaw_setpoint_turns_clockwise_with_the_right_motors():
    sim = hovering_sim()
    sim.setpoints.yaw_ned_rad[:] = math.radians(30.0)
    run(sim, 0.2)
    front_right, rear_left, front_left, rear_right = sim.motors_us[0]
    assert min(front_right, rear_left) > max(front_left, rear_right)
    run(sim, 4.0)
    assert frames.yaw_of(sim.truth.q_ned_frd)[0] == pytest.approx(math.radians(30.0), abs=0.03)


def test_velocity_north_pitches_down_and_settles_below_the_setpoint():
    sim = hovering_sim()
    sim.setpoints.position_ned_m[:] = np.nan
    sim.setpoints.velocity_ned_m_s[:] = (1.0, 0.0, 0.0)
    run(sim, 0.4)
    assert frames.euler_of(sim.truth.q_ned_frd)[0, 1] < -0.05
    run(sim, 3.0)
    assert 0.79 < sim.truth.velocity_ned_m_s[0, 0] < 0.92
    assert abs(sim.truth.velocity_ned_m_s[0, 1]) < 0.02


def test_position_steps_east_and_west_mirror_each_other():
    sim = hovering_sim(2)
    sim.setpoints.position_ned_m[0, 1] += 4.0
    sim.setpoints.position_ned_m[1, 1] -= 4.0
    start = sim.truth.position_ned_m.copy()
    for _ in range(8):
        run(sim, 0.5)
        moved_ned_m = sim.truth.position_ned_m - start
        assert moved_ned_m[0, 1] == pytest.approx(-moved_ned_m[1, 1], abs=0.01)
        assert moved_ned_m[0, 2] == pytest.approx(moved_ned_m[1, 2], abs=0.01)


def test_speed_is_limited_to_mpc_xy_vel_max():
    sim = hovering_sim(parameters=[Parameters({"MPC_XY_VEL_MAX": 4.0})])
    sim.setpoints.position_ned_m[:, 0] = 100.0
    run(sim, 6.0)
    assert 3.0 < sim.truth.velocity_ned_m_s[0, 0] < 4.1


def test_terminal_speed_of_a_fall_is_weight_over_drag():
    sim = Simulation(sensor_noise=False, parameters=[Parameters({"SIH_KDV": 2.0})])
    sim.truth.position_ned_m[0, 2] = -60.0
    run(sim, 6.0)
    assert sim.truth.velocity_ned_m_s[0, 2] == pytest.approx(frames.GRAVITY_M_S2 / 2.0, rel=1e-3)
    run(sim, 10.0)
    assert sim.truth.on_ground[0]
    assert sim.truth.position_ned_m[0, 2] == 0.0
    assert np.all(sim.truth.velocity_ned_m_s == 0.0)


@pytest.mark.story
def test_a_vehicle_keeps_its_position_in_wind():
    sim = hovering_sim(wind_ned_m_s=np.array([0.0, 4.0, 0.0]))
    run(sim, 10.0)
    assert frames.euler_of(sim.truth.q_ned_frd)[0, 0] < -math.radians(15.0), (
        "the vehicle does not tilt into the wind"
    )
    assert abs(sim.truth.velocity_ned_m_s[0, 1]) < 0.1


def test_body_rates_follow_their_setpoint():
    sim = hovering_sim()
    sim.setpoints.level[:] = ControlLevel.RATES
    sim.setpoints.thrust[:] = 0.49
    sim.setpoints.rates_frd_rad_s[:] = (1.0, 0.0, 0.0)
    run(sim, 0.3)
    assert sim.truth.rates_frd_rad_s[0] == pytest.approx([1.05, 0.0, 0.0], abs=0.1)


def test_the_attitude_follows_its_setpoint():
    sim = hovering_sim()
    sim.setpoints.level[:] = ControlLevel.ATTITUDE
    sim.setpoints.thrust[:] = 0.5
    sim.setpoints.q_ned_frd[:] = frames.quaternion_from_euler(math.radians(10), math.radians(-5), 0.0)
    run(sim, 1.0)
    assert np.degrees(frames.euler_of(sim.truth.q_ned_frd)[0]) == pytest.approx([10.0, -5.0, 0.0], abs=1.0)


@pytest.mark.parametrize("seed", [0, 1])
def test_the_same_seed_gives_the_same_flight(seed):
    first, second, other = (
        hovering_sim(2, noise=True, seed=s, seconds=2.0).truth.position_ned_m for s in (seed, seed, seed + 5)
    )
    assert np.array_equal(first, second)
    assert not np.array_equal(first, other)


def test_vehicles_of_a_fleet_fly_like_single_vehicles():
    targets = np.array([[3.0, 0.0, -8.0], [0.0, -6.0, -4.0], [20.0, 20.0, -12.0]])
    fleet = Simulation(3, sensor_noise=False, start_ned_m=np.zeros((3, 3)))
    singles = [Simulation(sensor_noise=False) for _ in range(3)]
    for sim, target in [(fleet, targets), *((a, targets[i : i + 1]) for i, a in enumerate(singles))]:
        run(sim, 1.0)
        sim.setpoints.armed[:] = True
        sim.setpoints.level[:] = ControlLevel.TRAJECTORY
        sim.setpoints.position_ned_m[:] = target
        sim.setpoints.yaw_ned_rad[:] = 0.7
        run(sim, 3.0)
    for i, sim in enumerate(singles):
        assert fleet.truth.position_ned_m[i] == pytest.approx(sim.truth.position_ned_m[0], abs=1e-6)
        assert fleet.estimate.q_ned_frd[i] == pytest.approx(sim.estimate.q_ned_frd[0], abs=1e-6)


def test_without_gps_the_position_becomes_invalid_and_the_attitude_stays_valid():
    sim = hovering_sim(noise=True)
    sim.set_gps_enabled(0, False)
    run(sim, 3.0)
    assert sim.sensors.gps_fix_type[0] == 0
    assert sim.estimate.valid_position[0]
    run(sim, 3.0)
    assert not sim.estimate.valid_position[0]
    assert not sim.estimate.valid_velocity[0]
    assert sim.estimate.valid_altitude[0]
    sim.setpoints.level[:] = ControlLevel.ATTITUDE
    sim.setpoints.thrust[:] = frames.GRAVITY_M_S2 / 20.0
    run(sim, 5.0)
    assert np.all(np.abs(frames.euler_of(sim.truth.q_ned_frd)[0, :2]) < math.radians(6.0))
    sim.set_gps_enabled(0, True)
    run(sim, 1.0)
    assert not sim.estimate.valid_position[0], "GPS was used less than a second after its return"
    run(sim, 0.4)
    assert sim.estimate.valid_position[0]
    error = (sim.estimate.position_ned_m - sim.truth.position_ned_m)[0]
    assert np.all(np.abs(error) < 2.0), "the GPS position is not used"


@pytest.mark.story
def test_the_battery_drains_while_armed_and_is_full_after_disarming():
    sim = Simulation(2)
    sim.setpoints.armed[0] = True
    run(sim, 6.0)
    # SIM_BAT_DRAIN 60 s, BAT1_N_CELLS 4.
    assert sim.battery.remaining[0] == pytest.approx(0.9 + 1.0 / 60.0, abs=0.002), "charge is not 1 s late"
    assert sim.battery.remaining[1] == 1.0
    assert sim.battery.voltage_v[1] == pytest.approx(16.2, abs=1e-3)
    assert sim.battery.voltage_v[0] < sim.battery.voltage_v[1]
    sim.set_battery_remaining(0, 0.505)
    run(sim, 2.0)
    assert sim.battery.remaining[0] == pytest.approx(0.5, abs=0.001), "SIM_BAT_MIN_PCT has no effect"
    sim.parameters[0].set("SIM_BAT_MIN_PCT", 80.0)
    sim.reload_parameters(0)
    sim.setpoints.armed[0] = False
    run(sim, 0.1)
    sim.setpoints.armed[0] = True
    run(sim, 15.0)
    assert sim.battery.remaining[0] == pytest.approx(0.8, abs=0.001)
    sim.parameters[0].set("SIM_BAT_MIN_PCT", 90.0)
    sim.reload_parameters(0)
    run(sim, 6.0)
    assert sim.battery.remaining[0] == pytest.approx(0.9, abs=0.002), (
        "a higher minimum did not raise the charge"
    )
    sim.setpoints.armed[0] = False
    run(sim, 6.0)
    assert sim.battery.remaining[0] == pytest.approx(1.0, abs=0.001)
    with pytest.raises(ValueError, match=r"0\.\.1"):
        sim.set_battery_remaining(0, 1.5)


def test_parameters_and_calibrations_of_the_simulated_sensors_have_the_same_effect_as_in_px4():
    sim = Simulation(1, sensor_noise=False)

    def sensors_with_parameters(**values: float):
        for name, value in values.items():
            sim.parameters[0].set(name, value)
        sim.reload_parameters(0)
        run(sim, 0.3)
        return sim.sensors

    run(sim, 0.3)
    before_m = float(sim.sensors.baro_alt_amsl_m[0])
    sensors = sensors_with_parameters(SIM_BARO_OFF_P=12.0, SIM_BARO_OFF_T=5.0)
    assert before_m - sensors.baro_alt_amsl_m[0] == pytest.approx(1.06, abs=0.02), "12 Pa are not 1 m"
    assert sensors.baro_temperature_deg_c[0] == pytest.approx(BARO_TEMPERATURE_DEG_C + 5.0, abs=0.01)
    sensors = sensors_with_parameters(CAL_ACC0_XOFF=0.3, CAL_ACC0_ZSCALE=1.1, CAL_GYRO0_YOFF=0.2)
    assert sensors.accel_frd_m_s2[0] == pytest.approx([-0.3, 0.0, -1.1 * frames.GRAVITY_M_S2], abs=1e-5)
    assert sensors.gyro_frd_rad_s[0] == pytest.approx([0.0, -0.2, 0.0], abs=1e-6)
    field_before = sensors.mag_frd_gauss[0].copy()
    assert sensors_with_parameters(SIM_MAG_OFFSET_Y=0.4).mag_frd_gauss[0] - field_before == pytest.approx(
        [0.0, 0.4, 0.0], abs=1e-6
    )
    sensors = sensors_with_parameters(SIM_GPS_USED=4)
    assert (sensors.gps_fix_type[0], sensors.gps_satellites[0]) == (3, 4)
    sensors = sensors_with_parameters(SIM_GPS_USED=3)
    assert (sensors.gps_fix_type[0], sensors.gps_horizontal_accuracy_m[0]) == (0, 100.0)
    assert sensors.gps_satellites[0] == 3
    assert sensors.gps_lat_deg[0] == pytest.approx(sim.origin.lat_deg), "no position was reported"


@pytest.mark.story
def test_parameters_take_effect_when_reloaded():
    sim = hovering_sim()
    sim.parameters[0].set("SIH_MASS", 1.2)
    assert sim.reload_parameters(0) is None
    run(sim, 10.0)
    assert sim.target.thrust[0] == pytest.approx(1.2 * frames.GRAVITY_M_S2 / 20.0, abs=0.005)
    sim.parameters[0].set("SIH_MASS", 0.0)
    reason = sim.reload_parameters(0)
    assert reason is not None
    assert "SIH_MASS is 0" in reason
    run(sim, 1.0)
    assert sim.target.thrust[0] == pytest.approx(1.2 * frames.GRAVITY_M_S2 / 20.0, abs=0.01), (
        "the invalid mass was used"
    )
    with pytest.raises(ValueError, match="SIH_MASS is 0"):
        Simulation(parameters=[sim.parameters[0]])


def test_a_partial_setpoint_controls_only_its_axes():
    sim = hovering_sim()
    sim.setpoints.position_ned_m[:] = (np.nan, np.nan, -12.0)
    sim.setpoints.velocity_ned_m_s[:] = (0.0, 2.0, np.nan)
    run(sim, 5.0)
    assert sim.truth.velocity_ned_m_s[0, 1] == pytest.approx(1.75, abs=0.15)
    assert sim.truth.position_ned_m[0, 2] == pytest.approx(-12.0, abs=0.2)
    assert np.all(np.isfinite(sim.motors_us))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"count": 0}, "count is 0"),
        ({"count": 2, "parameters": [Parameters()]}, "1 parameter stores for 2"),
        ({"count": 2, "start_ned_m": np.zeros((1, 3))}, "start_ned_m must be"),
    ],
)
def test_errors_about_invalid_arguments_name_the_arguments(arguments, message):
    with pytest.raises(ValueError, match=message):
        Simulation(**arguments)
