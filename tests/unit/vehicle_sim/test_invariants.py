"""Properties that the physics of any quadrotor and any estimator have."""

import math

import numpy as np
import pytest

from vehicle_sim import frames
from vehicle_sim.simulation import ControlLevel, Simulation

pytestmark = pytest.mark.flight

MASS_KG, THRUST_MAX_N, DRAG_N_PER_M_S = 1.0, 5.0, 1.0
"""Defaults of SIH_MASS, SIH_T_MAX and SIH_KDV; `test_the_constants_equal_the_default_parameters` checks
this."""


def run_simulation(sim, seconds):
    for _ in range(round(seconds / sim.dt_s)):
        sim.step()


HEIGHT_M = 4.0


def hovering_simulation(count=1, *, noise=False, seed=0):
    sim = Simulation(count, sensor_noise=noise, seed=seed, start_ned_m=np.zeros((count, 3)))
    run_simulation(sim, 1.0)
    sim.setpoints.armed[:] = True
    sim.setpoints.level[:] = ControlLevel.TRAJECTORY
    sim.setpoints.position_ned_m[:] = (0.0, 0.0, -HEIGHT_M)
    sim.setpoints.yaw_ned_rad[:] = 0.0
    run_simulation(sim, 8.0)
    return sim


def test_the_constants_equal_the_default_parameters():
    get = Simulation().parameters[0].get
    values = [get(name) for name in ("SIH_MASS", "SIH_T_MAX", "SIH_KDV")]
    assert values == pytest.approx([MASS_KG, THRUST_MAX_N, DRAG_N_PER_M_S])


def test_the_energy_lost_in_a_fall_is_the_work_of_drag():
    sim = Simulation(start_ned_m=np.array([[0.0, 0.0, -300.0]]), sensor_noise=False)
    drag_work_j = 0.0
    for _ in range(1000):
        velocity = sim.truth.velocity_ned_m_s[0].copy()
        sim.step()
        drag_work_j += DRAG_N_PER_M_S * float(velocity @ velocity) * sim.dt_s
    fallen_m = 300.0 + float(sim.truth.position_ned_m[0, 2])
    speed = float(np.linalg.norm(sim.truth.velocity_ned_m_s[0]))
    lost_energy_j = MASS_KG * frames.GRAVITY_M_S2 * fallen_m - 0.5 * MASS_KG * speed**2
    assert lost_energy_j == pytest.approx(drag_work_j, rel=0.01)


def test_a_vehicle_on_the_ground_does_not_drift():
    sim = Simulation(seed=3)
    run_simulation(sim, 30.0)
    assert np.array_equal(sim.truth.position_ned_m[0], np.zeros(3))
    assert np.abs(sim.estimate.position_ned_m[0, :2]).max() < 1.5
    assert np.abs(frames.euler_of(sim.estimate.q_ned_frd)[0, :2]).max() < math.radians(2.0)


def test_a_hover_without_noise_does_not_drift():
    sim = hovering_simulation()
    run_simulation(sim, 8.0)
    position_before = sim.truth.position_ned_m[0].copy()
    run_simulation(sim, 5.0)
    assert np.abs(sim.truth.position_ned_m[0] - position_before).max() < 0.05


def test_a_descending_vehicle_stops_on_the_ground():
    sim = hovering_simulation()
    sim.setpoints.position_ned_m[:] = np.nan
    sim.setpoints.velocity_ned_m_s[:] = (0.0, 0.0, 0.3)
    sim.setpoints.climb_limit_m_s[:] = np.nan
    sim.setpoints.position_ned_m[:, 2] = -0.5
    run_simulation(sim, 6.0)
    sim.setpoints.position_ned_m[:, 2] = np.nan
    run_simulation(sim, 6.0)
    assert sim.truth.position_ned_m[0, 2] <= 0.01


def test_steps_in_four_directions_have_the_same_response():
    sim = hovering_simulation(4)
    steps = np.array([[5.0, 0.0, 0.0], [-5.0, 0.0, 0.0], [0.0, 5.0, 0.0], [0.0, -5.0, 0.0]])
    start = sim.truth.position_ned_m.copy()
    sim.setpoints.position_ned_m[:] = steps + np.array([0.0, 0.0, -HEIGHT_M])
    progress = []
    for _ in range(500):
        sim.step()
        progress.append(((sim.truth.position_ned_m - start) * steps).sum(axis=1) / 25.0)
    progress = np.array(progress)
    assert progress.max() > 0.5
    assert np.abs(progress - progress[:, :1]).max() < 0.02


def test_thrust_and_torque_bypass_the_rate_controller():
    sim = hovering_simulation()
    sim.setpoints.level[:] = ControlLevel.THRUST_TORQUE
    sim.setpoints.thrust[:] = 0.49
    sim.setpoints.torque_frd[:] = (0.0, 0.0, 0.05)
    run_simulation(sim, 0.5)
    p, q, r = sim.truth.rates_frd_rad_s[0]
    assert r > 0.1, "the vehicle does not turn clockwise"
    assert max(abs(p), abs(q)) < 0.02
    sim.setpoints.torque_frd[:] = (np.nan, 0.02, 0.0)
    run_simulation(sim, 0.2)
    assert sim.truth.rates_frd_rad_s[0, 1] > 0.2, "the vehicle does not pitch up"
    assert abs(sim.truth.rates_frd_rad_s[0, 0]) < 0.05


def test_motor_setpoints_bypass_the_mixer_and_nan_stops_a_motor():
    sim = hovering_simulation()
    sim.setpoints.level[:] = ControlLevel.MOTORS
    sim.setpoints.motors[:] = (0.25, np.nan, -0.5, 2.0)
    sim.step()
    sim.step()
    assert sim.motors_us[0] == pytest.approx([1250.0, 900.0, 900.0, 2000.0])
    run_simulation(sim, 0.5)
    assert sim.truth.rotor_thrust[0] == pytest.approx([0.25, 0.0, 0.0, 1.0], abs=0.01)


def test_a_lasting_gps_offset_is_rejected_and_finally_accepted():
    sim = hovering_simulation(noise=True)
    sim.set_gps_offset(0, np.array([60.0, 0.0, 0.0]))
    run_simulation(sim, 3.0)
    assert sim.estimate.gps_rejected[0]
    assert sim.estimate.innovation_ratio_position[0] > 1.0
    assert abs(sim.estimate.position_ned_m[0, 0] - sim.truth.position_ned_m[0, 0]) < 2.0
    assert sim.estimate.valid_position[0], "the GPS velocity was not used"
    run_simulation(sim, 12.0)
    error = sim.estimate.position_ned_m[0, 0] - sim.truth.position_ned_m[0, 0]
    assert error == pytest.approx(60.0, abs=4.0), "not reset to the position of GPS"
    assert not sim.estimate.gps_rejected[0]


def test_a_short_gps_glitch_has_no_lasting_effect():
    sim = hovering_simulation(noise=True)
    sim.set_gps_offset(0, np.array([0.0, -40.0, 0.0]))
    run_simulation(sim, 2.0)
    sim.set_gps_offset(0, np.zeros(3))
    run_simulation(sim, 2.0)
    assert not sim.estimate.gps_rejected[0]
    assert np.abs(sim.truth.position_ned_m[0] - (0.0, 0.0, -HEIGHT_M)).max() < 1.5


@pytest.mark.story
def test_gusts_depend_on_the_seed_and_can_be_stopped():
    first, same_seed, other_seed = (hovering_simulation(seed=seed) for seed in (4, 4, 5))
    for sim in (first, same_seed, other_seed):
        sim.set_gusts(3.0)
        run_simulation(sim, 3.0)
    assert np.array_equal(first.truth.position_ned_m, same_seed.truth.position_ned_m)
    assert not np.array_equal(first.truth.position_ned_m, other_seed.truth.position_ned_m)
    assert np.abs(first.truth.velocity_ned_m_s).max() > 0.05
    first.set_gusts(0.0)
    run_simulation(first, 10.0)
    assert np.abs(first.truth.velocity_ned_m_s).max() < 0.03
    with pytest.raises(ValueError, match=r"the gusts' standard deviation is -1\.0 m/s"):
        first.set_gusts(-1.0)
