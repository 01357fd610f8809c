"""The extended Kalman filter of N vehicles: 21 error states in the order of PX4's EKF2, without wind.

The attitude is a quaternion and its error a rotation in NED; all other states are additive. The strapdown
prediction runs at half the IMU rate. The covariance is propagated only before a fusion. Noise figures are
PX4's EKF2_* parameters.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.frames import GRAVITY_M_S2, quaternion_product, rotation_matrix
from vehicle_sim.kernels import Blocks, Column, Flags, Rows, formula, kernel
from vehicle_sim.parameters import Parameters
from vehicle_sim.rotations import product, rotated, turn, within, write_matrix

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

TILT, YAW, VELOCITY, POSITION, GYRO_BIAS, ACCEL_BIAS, FIELD, MAG_BIAS, SIZE = 0, 2, 3, 6, 9, 12, 15, 18, 21
"""First index of each error state; TILT and YAW are the rotation about north, east and down."""
PREDICTION_S = 0.008
"""PX4 adds its process noise once per filter step; this step length converts it to a density."""
BAD_ACCEL_NOISE_M_S2 = 4.9
"""Noise of the vertical accelerometer while it is marked faulty (EKF2's BADACC_BIAS_PNOISE)."""
ACCEL_SMOOTHING_S = 1.0
_MAG_NOISE_START_GAUSS = 0.01
_LEAST_VARIANCE = 1e-12
UNUSED = 1e18
"""Variance of a measurement that must not be fused."""


def _diagonal(matrices: FloatArray) -> FloatArray:
    """(N, m) diagonals of (N, m, m), readable and writable."""
    return np.einsum("nii->ni", matrices)


class Kalman:
    """States and covariance of N vehicles.

    Args:
        count: N.
        dt_s: interval of the strapdown prediction.
        q_ned_frd: (N, 4) attitudes, corrected in place.
    """

    def __init__(self, count: int, dt_s: float, q_ned_frd: FloatArray) -> None:
        self._dt_s = dt_s
        self.q_ned_frd = q_ned_frd
        self.matrix = rotation_matrix(q_ned_frd)
        """(N, 3, 3) rotation matrices of the attitudes."""
        self.vector = np.zeros((count, SIZE - VELOCITY))
        """(N, 18) all states except the attitude; the attributes below are views of it."""
        self.motion = self.vector[:, :6].reshape(count, 2, 3)
        """(N, 2, 3) velocity [m/s] and position [m], NED."""
        self.velocity = self._view(VELOCITY)
        self.position = self._view(POSITION)
        self.gyro_bias = self._view(GYRO_BIAS)
        self.accel_bias = self._view(ACCEL_BIAS)
        self.field = self._view(FIELD)
        self.mag_bias = self._view(MAG_BIAS)
        self.covariance = np.zeros((count, SIZE, SIZE))
        self.bad_accel = np.zeros(count, dtype=np.bool_)
        """(N,) the vertical accelerometer is marked faulty: its noise is raised and its bias is not
        estimated."""
        self.velocity_change = np.zeros((count, 3))
        """(N, 3) change of velocity in the newest prediction [m/s]."""
        self.horizontal_accel_m_s2 = np.zeros((count, 2))
        """(N, 2) horizontal acceleration over the last second; GNSS shows the heading only while it is large.
        """
        self._impulse = np.zeros((count, 3))
        self._pending_s = 0.0
        self._noise = np.zeros((count, SIZE))
        self._initial_variance = np.zeros((count, SIZE))
        self._bias_limit = np.full((count, 6), np.inf)
        self._variances = _diagonal(self.covariance)
        # Work arrays of a fusion.
        self._gain, self._change = np.zeros((count, SIZE, 3)), np.zeros((count, SIZE, 3))
        self._inverse = np.zeros((count, 3, 3))

    def _view(self, first: int) -> FloatArray:
        return self.vector[:, first - VELOCITY : first - VELOCITY + 3]

    def configure(self, i: int, parameters: Parameters) -> None:
        """Reads noise figures and limits EKF2_* of vehicle `i`."""
        value = parameters.usable
        noise = self._noise[i]
        for first, name in (
            (TILT, "EKF2_GYR_NOISE"),
            (VELOCITY, "EKF2_ACC_NOISE"),
            (GYRO_BIAS, "EKF2_GYR_B_NOISE"),
            (ACCEL_BIAS, "EKF2_ACC_B_NOISE"),
            (FIELD, "EKF2_MAG_E_NOISE"),
            (MAG_BIAS, "EKF2_MAG_B_NOISE"),
        ):
            noise[first : first + 3] = value(name) ** 2 * PREDICTION_S
        start = self._initial_variance[i]
        start[TILT : TILT + 2] = value("EKF2_ANGERR_INIT") ** 2
        start[YAW] = max(value("EKF2_HEAD_NOISE"), 0.01) ** 2
        start[VELOCITY:POSITION] = max(value("EKF2_GPS_V_NOISE"), 0.01) ** 2
        start[POSITION:GYRO_BIAS] = max(value("EKF2_GPS_P_NOISE"), 0.01) ** 2
        start[GYRO_BIAS:ACCEL_BIAS] = value("EKF2_GBIAS_INIT") ** 2
        start[ACCEL_BIAS:FIELD] = value("EKF2_ABIAS_INIT") ** 2
        start[FIELD:] = max(value("EKF2_MAG_NOISE"), _MAG_NOISE_START_GAUSS) ** 2
        self._bias_limit[i, :3] = value("EKF2_GYR_B_LIM")
        self._bias_limit[i, 3:] = value("EKF2_ABL_LIM")
        if not self.covariance[i].any():
            self.reset(i)

    def reset(self, i: int) -> None:
        """Resets vehicle `i` to rest, with the initial covariance."""
        self.vector[i] = 0.0
        self.covariance[i] = np.diag(self._initial_variance[i])
        self.bad_accel[i] = False
        self._impulse[i] = self.horizontal_accel_m_s2[i] = 0.0

    def reset_covariance(self, mask: BoolArray, first: int, variance: FloatArray | float) -> None:
        """Sets the variances (N, 3) of three states from `first` on and clears their correlations, where
        `mask` is set."""
        rows = np.flatnonzero(mask)
        self.covariance[rows, first : first + 3, :] = 0.0
        self.covariance[rows, :, first : first + 3] = 0.0
        for k in range(3):
            new_variance = np.broadcast_to(variance, (len(mask), 3))[rows, k]
            self.covariance[rows, first + k, first + k] = new_variance

    def reset_one(self, mask: BoolArray, index: int, value: FloatArray | float, variance: FloatArray) -> None:
        """Sets state `index` to this value (N,) with this variance (N,), where `mask` is set."""
        rows = np.flatnonzero(mask)
        self.vector[rows, index - VELOCITY] = np.broadcast_to(value, mask.shape)[rows]
        self.covariance[rows, index, :] = 0.0
        self.covariance[rows, :, index] = 0.0
        self.covariance[rows, index, index] = np.broadcast_to(variance, mask.shape)[rows]

    def reset_field_covariance(self, mask: BoolArray) -> None:
        """Resets the covariance of field and magnetometer bias to its initial value, where `mask` is set."""
        for first in (FIELD, MAG_BIAS):
            self.reset_covariance(mask, first, self._initial_variance[:, FIELD : FIELD + 3])

    def variances(self, first: int, last: int) -> FloatArray:
        """(N, m) variances of adjacent states, a view; `last` is exclusive."""
        return self._variances[:, first:last]

    # --- prediction ------------------------------------------------------------------------------------

    def predict(self, delta_angle: FloatArray, delta_velocity: FloatArray) -> None:
        """Advances all states by one step.

        Args:
            delta_angle: (N, 3) rotation of the body measured by the gyroscopes [rad].
            delta_velocity: (N, 3) change of velocity measured by the accelerometers [m/s].
        """
        _strapdown(
            self._dt_s, delta_angle, delta_velocity, self.q_ned_frd, self.matrix, self.vector,
            self.velocity_change, self._impulse,
        )  # fmt: skip
        self._pending_s += self._dt_s

    def propagate_covariance(self) -> None:
        """Propagates the covariance over the predictions since the last call."""
        dt_s, self._pending_s = self._pending_s, 0.0
        if dt_s == 0.0:
            return
        _propagate_covariance(
            dt_s,
            self.matrix,
            self._impulse,
            self.horizontal_accel_m_s2,
            self.bad_accel,
            self._noise,
            self.covariance,
        )

    # --- fusion ----------------------------------------------------------------------------------------

    def variance(self, index: int) -> FloatArray:
        """(N,) variance of one state, a view."""
        return self.covariance[:, index, index]

    def fuse(self, index: int, innovation: FloatArray, variance: FloatArray) -> None:
        """Fuses a measurement of one state.

        Args:
            index: of the state.
            innovation: (N,) measured minus predicted.
            variance: (N,) of the measurement; vehicles with UNUSED or more are not changed.
        """
        self.fuse_states(index, innovation[:, None], variance[:, None])

    def fuse_states(self, first: int, innovation: FloatArray, variance: FloatArray) -> None:
        """Fuses measurements of adjacent states.

        Args:
            first: index of the first state.
            innovation: (N, m) measured minus predicted, m up to 6.
            variance: (N, m) of the measurements; those with UNUSED or more are not fused.
        """
        _fuse_states(
            first, np.ascontiguousarray(innovation), np.ascontiguousarray(variance), self.bad_accel,
            self._bias_limit, self.covariance, self._change, self.vector, self.q_ned_frd, self.matrix,
        )  # fmt: skip

    def measurement_covariances(
        self, sensitivity: FloatArray, variance: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Covariances of measurements that depend on several states.

        Args:
            sensitivity: (N, m, 21) of m measurements to the error states.
            variance: (N,) of each measurement.

        Returns:
            Covariance of states and measurements (N, 21, m), and of the innovations (N, m, m).
        """
        count, measured = sensitivity.shape[:2]
        cross_covariance, innovation_covariance = (
            np.empty((count, SIZE, measured)),
            np.empty((count, measured, measured)),
        )
        _measurement_covariances(
            self.covariance, sensitivity, variance, cross_covariance, innovation_covariance
        )
        return cross_covariance, innovation_covariance

    def fuse_measurements(
        self,
        cross_covariance: FloatArray,
        innovation_covariance: FloatArray,
        innovation: FloatArray,
        correctable: FloatArray,
    ) -> None:
        """Fuses measurements that depend on several states.

        Args:
            cross_covariance: (N, 21, m) from `measurement_covariances`.
            innovation_covariance: (N, m, m) from `measurement_covariances`.
            innovation: (N, m) measured minus predicted.
            correctable: (N, 21) 1 for a state that the measurements may correct, 0 for others.
        """
        _fuse_measurements(
            cross_covariance, innovation_covariance, np.ascontiguousarray(innovation), correctable,
            self.bad_accel, self._bias_limit, self.covariance, self._gain, self._change, self._inverse,
            self.vector, self.q_ned_frd, self.matrix,
        )  # fmt: skip

    def restore_symmetry(self) -> None:
        """Corrects rounding errors of the covariance; called a few times per second."""
        _restore_symmetry(self.covariance)

    def reset_heading(self, mask: BoolArray, down_rad: FloatArray, variance: FloatArray) -> None:
        """Rotates the attitudes by angles (N,) of any size about down and sets the heading's variance, where
        `mask` is set."""
        half = 0.5 * np.where(mask, down_rad, 0.0)
        delta = np.zeros_like(self.q_ned_frd)
        delta[:, 0], delta[:, 3] = np.cos(half), np.sin(half)
        self.q_ned_frd[:] = quaternion_product(delta, self.q_ned_frd)
        self.matrix[:] = rotation_matrix(self.q_ned_frd)
        rows = np.flatnonzero(mask)
        self.covariance[rows, YAW, :] = self.covariance[rows, :, YAW] = 0.0
        self.covariance[rows, YAW, YAW] = variance[rows]


@formula
def _apply_correction(
    change: Blocks, bad_accel: bool, bias_limit: Column, vector: Column, q: Column, matrix: Rows
) -> None:
    """Corrects the states by the first column of `change` (21, m), and the attitude by a small rotation."""
    for k in range(SIZE - VELOCITY):
        if not (bad_accel and k == ACCEL_BIAS + 2 - VELOCITY):
            vector[k] += change[VELOCITY + k, 0]
    for k in range(6):
        bias = GYRO_BIAS - VELOCITY + k
        vector[bias] = within(vector[bias], -bias_limit[k], bias_limit[k])
    north, east, down = 0.5 * change[TILT, 0], 0.5 * change[TILT + 1, 0], 0.5 * change[YAW, 0]
    if north == 0.0 and east == 0.0 and down == 0.0:
        return
    w, x, y, z = product(1.0, north, east, down, q[0], q[1], q[2], q[3])
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    q[0], q[1], q[2], q[3] = w / norm, x / norm, y / norm, z / norm
    write_matrix(q, matrix)


@formula
def _propagate_errors(dt_s: float, bias_effect: Rows, tilt_effect: Rows, states: Column) -> None:
    """Propagates the error states (21,) by one step: gyro bias changes attitude, tilt and bias change
    velocity, velocity changes position."""
    tilt_n, tilt_e, tilt_d = states[0], states[1], states[2]
    for k in range(3):
        by_tilt = tilt_effect[k, 0] * tilt_n + tilt_effect[k, 1] * tilt_e + tilt_effect[k, 2] * tilt_d
        by_bias = 0.0
        for j in range(3):
            states[TILT + k] += bias_effect[k, j] * states[GYRO_BIAS + j]
            by_bias += bias_effect[k, j] * states[ACCEL_BIAS + j]
        states[POSITION + k] += dt_s * states[VELOCITY + k] + 0.5 * dt_s * (by_tilt + by_bias)
        states[VELOCITY + k] += by_tilt + by_bias


@formula
def _invert(innovation_covariance: Rows, count: int, inverse: Rows) -> None:
    """Writes the inverse of a symmetric positive matrix of up to three rows into the first rows of (3, 3)."""
    a, b, c, d, e, f = innovation_covariance[0, 0], 0.0, 0.0, 1.0, 0.0, 1.0
    if count > 1:
        b, d = innovation_covariance[0, 1], innovation_covariance[1, 1]
    if count > 2:
        c, e, f = innovation_covariance[0, 2], innovation_covariance[1, 2], innovation_covariance[2, 2]
    inverse[0, 0], inverse[1, 1], inverse[2, 2] = d * f - e * e, a * f - c * c, a * d - b * b
    inverse[0, 1], inverse[0, 2], inverse[1, 2] = c * e - b * f, b * e - c * d, b * c - a * e
    determinant = a * inverse[0, 0] + b * inverse[0, 1] + c * inverse[0, 2]
    for j in range(3):
        for k in range(j, 3):
            inverse[j, k] = inverse[k, j] = inverse[j, k] / determinant


@kernel
def _strapdown(
    dt_s: float, delta_angle: Rows, delta_velocity: Rows, q: Rows, matrix: Blocks, vector: Rows,
    velocity_change: Rows, impulse: Rows,
) -> None:  # fmt: skip
    for i in range(q.shape[0]):
        gyro, accel = GYRO_BIAS - VELOCITY, ACCEL_BIAS - VELOCITY
        turn(
            q[i],
            delta_angle[i, 0] - vector[i, gyro] * dt_s,
            delta_angle[i, 1] - vector[i, gyro + 1] * dt_s,
            delta_angle[i, 2] - vector[i, gyro + 2] * dt_s,
        )
        write_matrix(q[i], matrix[i])
        delta_ned = rotated(
            matrix[i],
            delta_velocity[i, 0] - vector[i, accel] * dt_s,
            delta_velocity[i, 1] - vector[i, accel + 1] * dt_s,
            delta_velocity[i, 2] - vector[i, accel + 2] * dt_s,
        )
        for k in range(3):
            impulse[i, k] += delta_ned[k]
            velocity_change[i, k] = delta_ned[k] + (GRAVITY_M_S2 * dt_s if k == 2 else 0.0)
            vector[i, POSITION - VELOCITY + k] += dt_s * vector[i, k]
            vector[i, k] += velocity_change[i, k]


@kernel
def _propagate_covariance(
    dt_s: float, matrix: Blocks, impulse: Rows, horizontal_accel: Rows, bad_accel: Flags, noise: Rows,
    covariance: Blocks,
) -> None:  # fmt: skip
    """Propagates the covariance: the same step is applied to its columns and to its rows."""
    bias_effect, tilt_effect, states = np.empty((3, 3)), np.zeros((3, 3)), np.empty(SIZE)
    for i in range(covariance.shape[0]):
        for j in range(3):
            for k in range(3):
                bias_effect[j, k] = -dt_s * matrix[i, j, k]
        north, east, down = impulse[i, 0], impulse[i, 1], impulse[i, 2]
        tilt_effect[0, 1], tilt_effect[0, 2], tilt_effect[1, 2] = down, -east, north
        tilt_effect[1, 0], tilt_effect[2, 0], tilt_effect[2, 1] = -down, east, -north
        for k in range(2):
            horizontal_accel[i, k] += impulse[i, k] - dt_s / ACCEL_SMOOTHING_S * horizontal_accel[i, k]
        impulse[i] = 0.0
        for column in range(SIZE):
            for k in range(SIZE):
                states[k] = covariance[i, k, column]
            _propagate_errors(dt_s, bias_effect, tilt_effect, states)
            for k in range(SIZE):
                covariance[i, k, column] = states[k]
        for row in range(SIZE):
            _propagate_errors(dt_s, bias_effect, tilt_effect, covariance[i, row])
        for k in range(SIZE):
            covariance[i, k, k] += noise[i, k] * dt_s
        if bad_accel[i]:
            covariance[i, VELOCITY + 2, VELOCITY + 2] += BAD_ACCEL_NOISE_M_S2**2 * PREDICTION_S * dt_s


@kernel
def _fuse_states(
    first: int, innovation: Rows, variance: Rows, bad_accel: Flags, bias_limit: Rows, covariance: Blocks,
    change: Blocks, vector: Rows, q: Rows, matrix: Blocks,
) -> None:  # fmt: skip
    """Fuses the measurements one after the other; with independent noise this equals fusing all at once."""
    for i in range(covariance.shape[0]):
        taken = False
        for m in range(innovation.shape[1]):
            if not variance[i, m] < UNUSED:
                continue
            if not taken:
                for k in range(SIZE):
                    change[i, k, 0] = 0.0
                taken = True
            state = first + m
            scale = 1.0 / (covariance[i, state, state] + variance[i, m])
            residual = innovation[i, m] - change[i, state, 0]
            for k in range(SIZE):
                change[i, k, 1] = covariance[i, state, k]
            for k in range(SIZE):
                gain = change[i, k, 1] * scale
                change[i, k, 0] += gain * residual
                for j in range(SIZE):
                    covariance[i, k, j] -= gain * change[i, j, 1]
        if taken:
            _apply_correction(change[i], bad_accel[i], bias_limit[i], vector[i], q[i], matrix[i])


@kernel
def _measurement_covariances(
    covariance: Blocks,
    sensitivity: Blocks,
    variance: Column,
    cross_covariance: Blocks,
    innovation_covariance: Blocks,
) -> None:
    measured = sensitivity.shape[1]
    for i in range(covariance.shape[0]):
        for k in range(SIZE):
            for m in range(measured):
                value = 0.0
                for j in range(SIZE):
                    value += covariance[i, k, j] * sensitivity[i, m, j]
                cross_covariance[i, k, m] = value
        for m in range(measured):
            for n in range(measured):
                value = variance[i] if m == n else 0.0
                for j in range(SIZE):
                    value += sensitivity[i, m, j] * cross_covariance[i, j, n]
                innovation_covariance[i, m, n] = value


@kernel
def _fuse_measurements(
    cross_covariance: Blocks, innovation_covariance: Blocks, innovation: Rows, correctable: Rows,
    bad_accel: Flags, bias_limit: Rows, covariance: Blocks, gain: Blocks, change: Blocks, inverse: Blocks,
    vector: Rows, q: Rows, matrix: Blocks,
) -> None:  # fmt: skip
    """Updates the covariance in Joseph's form, which is valid for any gain."""
    measured = innovation.shape[1]
    for i in range(covariance.shape[0]):
        taken = False
        for k in range(SIZE):
            taken = taken or correctable[i, k] != 0.0
        if not taken:
            continue
        _invert(innovation_covariance[i], measured, inverse[i])
        for k in range(SIZE):
            for m in range(measured):
                value = 0.0
                for n in range(measured):
                    value += cross_covariance[i, k, n] * inverse[i, n, m]
                gain[i, k, m] = value * correctable[i, k]
        # Subtracts half of gain times innovation_covariance, so that one product serves both sides.
        for k in range(SIZE):
            for m in range(measured):
                value = cross_covariance[i, k, m]
                for n in range(measured):
                    value -= 0.5 * gain[i, k, n] * innovation_covariance[i, n, m]
                change[i, k, m] = value
        for k in range(SIZE):
            for j in range(SIZE):
                value = 0.0
                for m in range(measured):
                    value += gain[i, k, m] * change[i, j, m] + change[i, k, m] * gain[i, j, m]
                covariance[i, k, j] -= value
        for k in range(SIZE):
            value = 0.0
            for m in range(measured):
                value += gain[i, k, m] * innovation[i, m]
            change[i, k, 0] = value
        _apply_correction(change[i], bad_accel[i], bias_limit[i], vector[i], q[i], matrix[i])


@kernel
def _restore_symmetry(covariance: Blocks) -> None:
    for i in range(covariance.shape[0]):
        for k in range(SIZE):
            for j in range(k):
                covariance[i, k, j] = covariance[i, j, k] = 0.5 * (covariance[i, k, j] + covariance[i, j, k])
            covariance[i, k, k] = max(covariance[i, k, k], _LEAST_VARIANCE)
