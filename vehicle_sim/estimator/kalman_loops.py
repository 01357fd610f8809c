"""Compiled loops of the Kalman filter (`kalman.py`): prediction, covariance and fusion of each vehicle."""

from __future__ import annotations

import math

import numpy as np

from vehicle_sim.frames import GRAVITY_M_S2
from vehicle_sim.kernels import Blocks, Column, Flags, Rows, formula, kernel
from vehicle_sim.rotations import constrain, quaternion_product, rotate_attitude, rotated, write_matrix

TILT, YAW, VELOCITY, POSITION, GYRO_BIAS, ACCEL_BIAS, EARTH_FIELD, MAG_BIAS = 0, 2, 3, 6, 9, 12, 15, 18
"""First index of each group of error states. TILT is the rotation about north and east, YAW about down."""
SIZE = 21
"""Number of error states."""
PREDICTION_S = 0.008
"""PX4 adds its process noise once per filter step; this step length converts it to a density."""
BAD_ACCEL_NOISE_M_S2 = 4.9
"""Noise of all accelerometers while the vertical accelerometer is marked faulty (BADACC_BIAS_PNOISE). With
this noise the horizontal speed accuracy grows as recorded."""
ACCEL_SMOOTHING_S = 1.0
"""Time constant of the smoothed horizontal acceleration."""
_MIN_VARIANCE = 1e-12
UNUSED = 1e18
"""Variance of a measurement that must not be fused."""


@formula
def _apply_correction(
    correction: Rows, bad_accel: bool, bias_limit: Column, vector: Column, q: Column, matrix: Rows
) -> None:
    """Adds the first column of `correction` (21, m) to the states, and rotates the attitude by it."""
    for k in range(SIZE - VELOCITY):
        if not (bad_accel and ACCEL_BIAS <= VELOCITY + k < EARTH_FIELD):
            vector[k] += correction[VELOCITY + k, 0]
    for k in range(6):
        index = GYRO_BIAS - VELOCITY + k
        vector[index] = constrain(vector[index], -bias_limit[k], bias_limit[k])
    half_n, half_e = 0.5 * correction[TILT, 0], 0.5 * correction[TILT + 1, 0]
    half_d = 0.5 * correction[YAW, 0]
    if half_n == 0.0 and half_e == 0.0 and half_d == 0.0:
        return
    w, x, y, z = quaternion_product(1.0, half_n, half_e, half_d, q[0], q[1], q[2], q[3])
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    q[0], q[1], q[2], q[3] = w / norm, x / norm, y / norm, z / norm
    write_matrix(q, matrix)


@formula
def _propagate_errors(dt_s: float, bias_effect: Rows, tilt_effect: Rows, states: Column) -> None:
    """Propagates the error states (21,) by one step: gyroscope bias changes attitude; tilt and accelerometer
    bias change velocity; velocity changes position."""
    tilt_n, tilt_e, tilt_d = states[0], states[1], states[2]
    for k in range(3):
        tilt_change = tilt_effect[k, 0] * tilt_n + tilt_effect[k, 1] * tilt_e + tilt_effect[k, 2] * tilt_d
        bias_change = 0.0
        for j in range(3):
            states[TILT + k] += bias_effect[k, j] * states[GYRO_BIAS + j]
            bias_change += bias_effect[k, j] * states[ACCEL_BIAS + j]
        states[POSITION + k] += dt_s * states[VELOCITY + k] + 0.5 * dt_s * (tilt_change + bias_change)
        states[VELOCITY + k] += tilt_change + bias_change


@formula
def _propagate_columns(
    dt_s: float, bias_effect: Rows, tilt_effect: Rows, covariance: Rows, tilts: Rows, changes: Rows
) -> None:
    """Runs `_propagate_errors` for each column of `covariance` (21, 21), in loops along contiguous rows.

    `tilts` (3, 21) and `changes` (2, 21) are work arrays.
    """
    for k in range(3):
        for c in range(SIZE):
            tilts[k, c] = covariance[TILT + k, c]
    for k in range(3):
        north, east, down = tilt_effect[k, 0], tilt_effect[k, 1], tilt_effect[k, 2]
        for c in range(SIZE):
            changes[0, c] = north * tilts[0, c] + east * tilts[1, c] + down * tilts[2, c]
            changes[1, c] = 0.0
        for j in range(3):
            effect = bias_effect[k, j]
            for c in range(SIZE):
                covariance[TILT + k, c] += effect * covariance[GYRO_BIAS + j, c]
                changes[1, c] += effect * covariance[ACCEL_BIAS + j, c]
        for c in range(SIZE):
            change = changes[0, c] + changes[1, c]
            covariance[POSITION + k, c] += dt_s * covariance[VELOCITY + k, c] + 0.5 * dt_s * change
            covariance[VELOCITY + k, c] += change


@formula
def _invert(innovation_covariance: Rows, size: int, inverse: Rows) -> None:
    """Writes the inverse of a symmetric positive (size, size) matrix into `inverse` (3, 3)."""
    a, b, c, d, e, f = innovation_covariance[0, 0], 0.0, 0.0, 1.0, 0.0, 1.0
    if size > 1:
        b, d = innovation_covariance[0, 1], innovation_covariance[1, 1]
    if size > 2:
        c, e, f = innovation_covariance[0, 2], innovation_covariance[1, 2], innovation_covariance[2, 2]
    inverse[0, 0], inverse[1, 1], inverse[2, 2] = d * f - e * e, a * f - c * c, a * d - b * b
    inverse[0, 1], inverse[0, 2], inverse[1, 2] = c * e - b * f, b * e - c * d, b * c - a * e
    determinant = a * inverse[0, 0] + b * inverse[0, 1] + c * inverse[0, 2]
    for j in range(3):
        for k in range(j, 3):
            inverse[j, k] = inverse[k, j] = inverse[j, k] / determinant


@kernel
def strapdown(
    dt_s: float, delta_angle: Rows, delta_velocity: Rows, q: Rows, matrix: Blocks, vector: Rows,
    velocity_change: Rows, force_integral: Rows,
) -> None:  # fmt: skip
    for i in range(q.shape[0]):
        gyro_index, accel_index = GYRO_BIAS - VELOCITY, ACCEL_BIAS - VELOCITY
        rotate_attitude(
            q[i],
            delta_angle[i, 0] - vector[i, gyro_index] * dt_s,
            delta_angle[i, 1] - vector[i, gyro_index + 1] * dt_s,
            delta_angle[i, 2] - vector[i, gyro_index + 2] * dt_s,
        )
        write_matrix(q[i], matrix[i])
        delta_ned = rotated(
            matrix[i],
            delta_velocity[i, 0] - vector[i, accel_index] * dt_s,
            delta_velocity[i, 1] - vector[i, accel_index + 1] * dt_s,
            delta_velocity[i, 2] - vector[i, accel_index + 2] * dt_s,
        )
        for k in range(3):
            force_integral[i, k] += delta_ned[k]
            velocity_change[i, k] = delta_ned[k] + (GRAVITY_M_S2 * dt_s if k == 2 else 0.0)
            vector[i, POSITION - VELOCITY + k] += dt_s * vector[i, k]
            vector[i, k] += velocity_change[i, k]


@kernel
def propagate_covariance(
    dt_s: float, matrix: Blocks, force_integral: Rows, horizontal_accel: Rows, bad_accel: Flags,
    noise_density: Rows, covariance: Blocks,
) -> None:  # fmt: skip
    """Propagates the covariance: applies the error propagation to its columns, then to its rows."""
    bias_effect, tilt_effect = np.empty((3, 3)), np.zeros((3, 3))
    tilts, changes = np.empty((3, SIZE)), np.empty((2, SIZE))
    for i in range(covariance.shape[0]):
        for j in range(3):
            for k in range(3):
                bias_effect[j, k] = -dt_s * matrix[i, j, k]
        north, east, down = force_integral[i, 0], force_integral[i, 1], force_integral[i, 2]
        tilt_effect[0, 1], tilt_effect[0, 2], tilt_effect[1, 2] = down, -east, north
        tilt_effect[1, 0], tilt_effect[2, 0], tilt_effect[2, 1] = -down, east, -north
        for k in range(2):
            horizontal_accel[i, k] += force_integral[i, k] - dt_s / ACCEL_SMOOTHING_S * horizontal_accel[i, k]
        force_integral[i] = 0.0
        _propagate_columns(dt_s, bias_effect, tilt_effect, covariance[i], tilts, changes)
        for row in range(SIZE):
            _propagate_errors(dt_s, bias_effect, tilt_effect, covariance[i, row])
        for k in range(SIZE):
            covariance[i, k, k] += noise_density[i, k] * dt_s
        if bad_accel[i]:
            for k in range(VELOCITY, POSITION):
                covariance[i, k, k] += BAD_ACCEL_NOISE_M_S2**2 * PREDICTION_S * dt_s


@kernel
def fuse_states(
    first: int, innovation: Rows, variance: Rows, bad_accel: Flags, bias_limit: Rows, covariance: Blocks,
    correction: Blocks, vector: Rows, q: Rows, matrix: Blocks,
) -> None:  # fmt: skip
    """Fuses one measurement after the other; with independent noise, all together give the same."""
    state_covariance = np.empty(SIZE)  # contiguous, so that the loop over the covariance runs fast
    for i in range(covariance.shape[0]):
        has_measurement = False
        for m in range(innovation.shape[1]):
            if not variance[i, m] < UNUSED:
                continue
            if not has_measurement:
                for k in range(SIZE):
                    correction[i, k, 0] = 0.0
                has_measurement = True
            index = first + m
            inverse_variance = 1.0 / (covariance[i, index, index] + variance[i, m])
            residual = innovation[i, m] - correction[i, index, 0]
            for k in range(SIZE):
                state_covariance[k] = covariance[i, index, k]
            for k in range(SIZE):
                gain = state_covariance[k] * inverse_variance
                correction[i, k, 0] += gain * residual
                for j in range(SIZE):
                    covariance[i, k, j] -= gain * state_covariance[j]
        if has_measurement:
            _apply_correction(correction[i], bad_accel[i], bias_limit[i], vector[i], q[i], matrix[i])


@kernel
def measurement_covariances(
    covariance: Blocks,
    sensitivity: Blocks,
    variance: Column,
    cross_covariance: Blocks,
    innovation_covariance: Blocks,
) -> None:
    measurement_count = sensitivity.shape[1]
    for i in range(covariance.shape[0]):
        for k in range(SIZE):
            for m in range(measurement_count):
                value = 0.0
                for j in range(SIZE):
                    value += covariance[i, k, j] * sensitivity[i, m, j]
                cross_covariance[i, k, m] = value
        for m in range(measurement_count):
            for n in range(measurement_count):
                value = variance[i] if m == n else 0.0
                for j in range(SIZE):
                    value += sensitivity[i, m, j] * cross_covariance[i, j, n]
                innovation_covariance[i, m, n] = value


@kernel
def fuse_measurements(
    cross_covariance: Blocks, innovation_covariance: Blocks, innovation: Rows, correctable: Rows,
    bad_accel: Flags, bias_limit: Rows, covariance: Blocks, gain: Blocks, work: Blocks, inverse: Blocks,
    vector: Rows, q: Rows, matrix: Blocks,
) -> None:  # fmt: skip
    """Updates states and covariance, the covariance in Joseph's form, which is valid for any gain.

    Joseph's form P - K Cᵀ - C Kᵀ + K S Kᵀ equals P - K Wᵀ - W Kᵀ with W = C - K S / 2 (C: cross covariance,
    S: innovation covariance, K: gain). `work` first contains W, then the correction of the states.
    """
    measurement_count = innovation.shape[1]
    gain_rows, work_rows, update = np.empty((3, SIZE)), np.empty((3, SIZE)), np.empty(SIZE)
    for i in range(covariance.shape[0]):
        is_correctable = False
        for k in range(SIZE):
            is_correctable = is_correctable or correctable[i, k] != 0.0
        if not is_correctable:
            continue
        _invert(innovation_covariance[i], measurement_count, inverse[i])
        for k in range(SIZE):
            for m in range(measurement_count):
                value = 0.0
                for n in range(measurement_count):
                    value += cross_covariance[i, k, n] * inverse[i, n, m]
                gain[i, k, m] = value * correctable[i, k]
        for k in range(SIZE):
            for m in range(measurement_count):
                value = cross_covariance[i, k, m]
                for n in range(measurement_count):
                    value -= 0.5 * gain[i, k, n] * innovation_covariance[i, n, m]
                work[i, k, m] = value
        for k in range(SIZE):
            for m in range(measurement_count):
                gain_rows[m, k], work_rows[m, k] = gain[i, k, m], work[i, k, m]
        # The update is symmetric to the last bit, so only one half is computed.
        for k in range(SIZE):
            for j in range(k + 1):
                update[j] = 0.0
            for m in range(measurement_count):
                for j in range(k + 1):
                    update[j] += gain_rows[m, k] * work_rows[m, j] + work_rows[m, k] * gain_rows[m, j]
            for j in range(k + 1):
                covariance[i, k, j] -= update[j]
            for j in range(k):
                covariance[i, j, k] -= update[j]
        for k in range(SIZE):
            value = 0.0
            for m in range(measurement_count):
                value += gain[i, k, m] * innovation[i, m]
            work[i, k, 0] = value
        _apply_correction(work[i], bad_accel[i], bias_limit[i], vector[i], q[i], matrix[i])


@kernel
def restore_symmetry(covariance: Blocks) -> None:
    for i in range(covariance.shape[0]):
        for k in range(SIZE):
            for j in range(k):
                covariance[i, k, j] = covariance[i, j, k] = 0.5 * (covariance[i, k, j] + covariance[i, j, k])
            covariance[i, k, k] = max(covariance[i, k, k], _MIN_VARIANCE)
