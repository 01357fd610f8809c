"""The loops of the Kalman filter compute each element of the covariance exactly as the formula does."""

from __future__ import annotations

import numpy as np
import pytest

from vehicle_sim.estimator import kalman_loops
from vehicle_sim.estimator.kalman_loops import ACCEL_BIAS, GYRO_BIAS, POSITION, SIZE, TILT, VELOCITY

DT_S = 0.02
Matrix = list[list[float]]


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def almost_symmetric_covariance(rng: np.random.Generator) -> np.ndarray:
    """A covariance with the rounding errors that it has in flight."""
    root = rng.normal(size=(SIZE, SIZE))
    return (root @ root.T + 1e-9 * rng.normal(size=(SIZE, SIZE)))[None]


def propagate_errors(errors: list[float], bias_effect: Matrix, tilt_effect: Matrix) -> list[float]:
    """The error states after one step."""
    states, tilt = list(errors), errors[TILT : TILT + 3]
    for k in range(3):
        by_tilt = tilt_effect[k][0] * tilt[0] + tilt_effect[k][1] * tilt[1] + tilt_effect[k][2] * tilt[2]
        by_bias = 0.0
        for j in range(3):
            states[TILT + k] += bias_effect[k][j] * states[GYRO_BIAS + j]
            by_bias += bias_effect[k][j] * states[ACCEL_BIAS + j]
        states[POSITION + k] += DT_S * states[VELOCITY + k] + 0.5 * DT_S * (by_tilt + by_bias)
        states[VELOCITY + k] += by_tilt + by_bias
    return states


def test_the_covariance_is_propagated_along_its_columns_and_then_its_rows(rng: np.random.Generator) -> None:
    covariance, matrix = almost_symmetric_covariance(rng), rng.normal(size=(1, 3, 3))
    impulse, noise = rng.normal(size=(1, 3)), rng.random((1, SIZE))
    north, east, down = impulse[0].tolist()
    tilt_effect = [[0.0, down, -east], [-down, 0.0, north], [east, -north, 0.0]]
    bias_effect = (-DT_S * matrix[0]).tolist()
    columns = [propagate_errors(column, bias_effect, tilt_effect) for column in covariance[0].T.tolist()]
    expected = [propagate_errors(row, bias_effect, tilt_effect) for row in np.array(columns).T.tolist()]
    for k in range(SIZE):
        expected[k][k] += float(noise[0, k]) * DT_S
    kalman_loops.propagate_covariance(
        DT_S, matrix, impulse, np.zeros((1, 2)), np.zeros(1, dtype=np.bool_), noise, covariance
    )
    assert covariance[0].tolist() == expected


@pytest.mark.parametrize("measurement_count", [1, 3])
def test_a_fusion_updates_both_halves_of_the_covariance_equally(
    measurement_count: int, rng: np.random.Generator
) -> None:
    covariance, cross = almost_symmetric_covariance(rng), rng.normal(size=(1, SIZE, measurement_count))
    innovation_covariance = np.diag(1.0 + rng.random(measurement_count))[None]
    expected = covariance[0].tolist()
    gain, change = np.zeros((1, SIZE, 3)), np.zeros((1, SIZE, 3))
    kalman_loops.fuse_measurements(
        cross, innovation_covariance, np.zeros((1, measurement_count)), np.ones((1, SIZE)),
        np.zeros(1, dtype=np.bool_), np.full((1, 6), np.inf), covariance, gain, change, np.zeros((1, 3, 3)),
        np.zeros((1, SIZE - VELOCITY)), np.array([[1.0, 0.0, 0.0, 0.0]]), np.eye(3)[None],
    )  # fmt: skip
    gains, cross_rows, s = gain[0].tolist(), cross[0].tolist(), innovation_covariance[0].tolist()
    corrected_rows = [list(row) for row in cross_rows]
    for k in range(SIZE):
        for m in range(measurement_count):
            for n in range(measurement_count):
                corrected_rows[k][m] -= 0.5 * gains[k][n] * s[n][m]
    for k in range(SIZE):
        for j in range(SIZE):
            correction = 0.0
            for m in range(measurement_count):
                correction += gains[k][m] * corrected_rows[j][m] + corrected_rows[k][m] * gains[j][m]
            expected[k][j] -= correction
    assert covariance[0].tolist() == expected
