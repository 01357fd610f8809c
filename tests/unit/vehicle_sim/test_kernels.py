"""Compiled loops: each equals its formula in NumPy, separately for every vehicle."""

from pathlib import Path

import numpy as np
import pytest

from vehicle_sim import frames, kernels, rotations
from vehicle_sim.estimator.kalman import Kalman
from vehicle_sim.estimator.kalman_loops import ACCEL_BIAS, GYRO_BIAS, POSITION, SIZE, UNUSED, VELOCITY
from vehicle_sim.parameters import Parameters
from vehicle_sim.simulation import Simulation
from vehicle_sim.state import vehicle_estimates

GENERATOR = np.random.default_rng(4)
VEHICLES = 3


def random_attitudes() -> np.ndarray:
    return frames.normalized(GENERATOR.normal(size=(VEHICLES, 4)))


def random_filters() -> Kalman:
    """Filters whose covariances are positive and full."""
    filters = Kalman(VEHICLES, 0.008, random_attitudes())
    for i in range(VEHICLES):
        filters.configure(i, Parameters())
    roots = GENERATOR.normal(size=(VEHICLES, SIZE, SIZE)) * 0.1
    filters.covariance[:] = roots @ roots.transpose(0, 2, 1) + 0.01 * np.eye(SIZE)
    return filters


def test_rotations_of_one_vehicle_equal_the_rotations_of_a_fleet() -> None:
    q, other_q, vector = random_attitudes(), random_attitudes(), GENERATOR.normal(size=(VEHICLES, 3))
    matrix = np.zeros((3, 3))
    for i in range(VEHICLES):
        rotations.write_matrix(q[i], matrix)
        assert matrix == pytest.approx(frames.rotation_matrix(q)[i])
        assert rotations.quaternion_product(*q[i], *other_q[i]) == pytest.approx(
            frames.quaternion_product(q, other_q)[i]
        )
        assert rotations.rotated(matrix, *vector[i]) == pytest.approx(matrix @ vector[i])
        assert rotations.rotated_back(matrix, *vector[i]) == pytest.approx(matrix.T @ vector[i])
        assert rotations.heading(q[i]) == pytest.approx(frames.yaw_of(q)[i])
        rotated_q = q[i].copy()
        rotations.rotate_attitude(rotated_q, *(0.01 * vector[i]))
        expected = frames.normalized(q + frames.quaternion_rate(q, 0.01 * vector))[i]
        assert rotated_q == pytest.approx(expected)


def test_sequential_measurements_equal_simultaneous_measurements() -> None:
    filters = random_filters()
    prior, vector_before = filters.covariance.copy(), filters.vector.copy()
    innovation = GENERATOR.normal(size=(VEHICLES, 6)) * 0.1
    variance = GENERATOR.uniform(0.1, 1.0, (VEHICLES, 6))
    variance[1, 2:] = UNUSED
    variance[2] = np.inf
    filters.fuse_states(VELOCITY, innovation, variance)
    for i, used_rows in enumerate((range(6), range(2), range(0))):
        states = [VELOCITY + k for k in used_rows]
        innovation_covariance = prior[i][np.ix_(states, states)] + np.diag(variance[i, list(used_rows)])
        gain = prior[i][:, states] @ np.linalg.inv(innovation_covariance)
        assert filters.covariance[i] == pytest.approx(prior[i] - gain @ prior[i][states], abs=1e-12)
        change = (gain @ innovation[i, list(used_rows)])[VELOCITY:GYRO_BIAS]
        assert filters.vector[i, :6] == pytest.approx(vector_before[i, :6] + change, abs=1e-12)


@pytest.mark.parametrize("measurement_count", [1, 2, 3])
def test_a_masked_gain_gives_the_covariance_of_the_joseph_form(measurement_count: int) -> None:
    filters = random_filters()
    prior = filters.covariance.copy()
    sensitivity = GENERATOR.normal(size=(VEHICLES, measurement_count, SIZE))
    correctable = np.ones((VEHICLES, SIZE))
    correctable[0, :POSITION] = 0.0
    correctable[2] = 0.0
    cross_covariance, innovation_covariance = filters.measurement_covariances(
        sensitivity, np.full(VEHICLES, 0.3)
    )
    filters.fuse_measurements(
        cross_covariance, innovation_covariance, np.zeros((VEHICLES, measurement_count)), correctable
    )
    for i in range(VEHICLES):
        h = sensitivity[i]
        gain = (
            prior[i]
            @ h.T
            @ np.linalg.inv(h @ prior[i] @ h.T + 0.3 * np.eye(measurement_count))
            * correctable[i][:, None]
        )
        identity_minus_gain = np.eye(SIZE) - gain @ h
        joseph = identity_minus_gain @ prior[i] @ identity_minus_gain.T + 0.3 * gain @ gain.T
        assert filters.covariance[i] == pytest.approx(joseph, abs=1e-12)


def test_the_covariance_is_propagated_by_the_state_transition() -> None:
    filters = random_filters()
    prior, dt_s = filters.covariance.copy(), 0.008
    filters.predict(np.zeros((VEHICLES, 3)), GENERATOR.normal(size=(VEHICLES, 3)))
    impulse = filters.velocity_change - [0.0, 0.0, frames.GRAVITY_M_S2 * dt_s]
    filters.propagate_covariance()
    for i in range(VEHICLES):
        rotation_effect, impulse_cross = -dt_s * filters.matrix[i], np.cross(np.eye(3), impulse[i]).T
        transition = np.eye(SIZE)
        transition[:3, GYRO_BIAS:ACCEL_BIAS] = rotation_effect
        transition[VELOCITY:POSITION, :3], transition[VELOCITY:POSITION, ACCEL_BIAS : ACCEL_BIAS + 3] = (
            impulse_cross,
            rotation_effect,
        )
        transition[POSITION:GYRO_BIAS, :3] = 0.5 * dt_s * impulse_cross
        transition[POSITION:GYRO_BIAS, VELOCITY:POSITION] = dt_s * np.eye(3)
        transition[POSITION:GYRO_BIAS, ACCEL_BIAS : ACCEL_BIAS + 3] = 0.5 * dt_s * rotation_effect
        added_noise = filters.covariance[i] - transition @ prior[i] @ transition.T
        assert added_noise == pytest.approx(np.diag(np.diag(added_noise)), abs=1e-12)
        assert 0.0 <= np.diag(added_noise).max() < 1e-3


def test_estimates_as_plain_numbers_equal_the_rows_of_the_arrays() -> None:
    simulation = Simulation(2, yaw_ned_rad=np.array([0.3, -2.0]))
    for _ in range(60):
        simulation.step()
    rows = vehicle_estimates(simulation.estimate)
    angles = frames.euler_of(simulation.estimate.q_ned_frd)
    for i, row in enumerate(rows):
        assert row.position_ned_m == tuple(simulation.estimate.position_ned_m[i])
        assert (row.roll_rad, row.pitch_rad, row.yaw_ned_rad) == pytest.approx(angles[i])
        assert row.valid_attitude is True


def test_compiled_code_is_stored_in_a_writable_folder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    file = tmp_path / "a file, not a folder"
    file.touch()
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(kernels, "PACKAGE", file)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = kernels._cache_folder()
    assert folder is not None
    assert folder.parent == tmp_path / "offboard-gcs"
    monkeypatch.setenv("XDG_CACHE_HOME", str(file))
    assert kernels._cache_folder() is None
