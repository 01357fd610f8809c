"""The extended Kalman filter of N vehicles: 21 error states in the order of PX4's EKF2, wind left out.

Attitude is kept as a quaternion, its error as a rotation in NED; everything else is additive. The strapdown
prediction runs at half the IMU rate, the covariance catches up just before something is fused. Noise figures
are PX4's EKF2_* parameters.
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
"""PX4 adds its process noise once a filter step; this makes it a density."""
BAD_ACCEL_NOISE_M_S2 = 4.9
"""Noise of the vertical accelerometer while it is known to be wrong (EKF2's BADACC_BIAS_PNOISE)."""
ACCEL_SMOOTHING_S = 1.0
_MAG_NOISE_START_GAUSS = 0.01
_LEAST_VARIANCE = 1e-12
UNUSED = 1e18
"""Variance of a measurement that is not to count."""


def _diagonal(matrices: FloatArray) -> FloatArray:
    """(N, m) of (N, m, m), to read and to write."""
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
        """(N, 3, 3) of the attitude."""
        self.vector = np.zeros((count, SIZE - VELOCITY))
        """(N, 18) everything but the attitude; the attributes below are views of it."""
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
        """(N,) the vertical accelerometer is known to be wrong: hardly believed, its bias not learned."""
        self.gained = np.zeros((count, 3))
        """(N, 3) velocity gained by the newest prediction [m/s]."""
        self.level_accel_m_s2 = np.zeros((count, 2))
        """(N, 2) horizontal acceleration over the last second: where there is some, the heading shows."""
        self._impulse = np.zeros((count, 3))
        self._waiting_s = 0.0
        self._noise = np.zeros((count, SIZE))
        self._start = np.zeros((count, SIZE))
        self._bias_limit = np.full((count, 6), np.inf)
        self._variances = _diagonal(self.covariance)
        # What a fusion works in.
        self._gain, self._change = np.zeros((count, SIZE, 3)), np.zeros((count, SIZE, 3))
        self._inverse = np.zeros((count, 3, 3))

    def _view(self, first: int) -> FloatArray:
        return self.vector[:, first - VELOCITY : first - VELOCITY + 3]

    def configure(self, i: int, parameters: Parameters) -> None:
        """Read EKF2_* noise figures and limits of vehicle `i`."""
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
        start = self._start[i]
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
        """Vehicle `i` knows nothing but that it stands."""
        self.vector[i] = 0.0
        self.covariance[i] = np.diag(self._start[i])
        self.bad_accel[i] = False
        self._impulse[i] = self.level_accel_m_s2[i] = 0.0

    def reset_covariance(self, mask: BoolArray, first: int, variance: FloatArray | float) -> None:
        """Three states from `first` on are known this well (N, 3) and depend on no other, where `mask` is."""
        rows = np.flatnonzero(mask)
        self.covariance[rows, first : first + 3, :] = 0.0
        self.covariance[rows, :, first : first + 3] = 0.0
        for k in range(3):
            given = np.broadcast_to(variance, (len(mask), 3))[rows, k]
            self.covariance[rows, first + k, first + k] = given

    def reset_one(self, mask: BoolArray, index: int, value: FloatArray | float, variance: FloatArray) -> None:
        """State `index` takes this value (N,) with this variance (N,), where `mask` is."""
        rows = np.flatnonzero(mask)
        self.vector[rows, index - VELOCITY] = np.broadcast_to(value, mask.shape)[rows]
        self.covariance[rows, index, :] = 0.0
        self.covariance[rows, :, index] = 0.0
        self.covariance[rows, index, index] = np.broadcast_to(variance, mask.shape)[rows]

    def forget_field(self, mask: BoolArray) -> None:
        """Covariance of field and magnetometer bias as at the start, where `mask` is."""
        for first in (FIELD, MAG_BIAS):
            self.reset_covariance(mask, first, self._start[:, FIELD : FIELD + 3])

    def variances(self, first: int, last: int) -> FloatArray:
        """(N, m) of neighbouring states, a view; `last` is the first one that does not belong to them."""
        return self._variances[:, first:last]

    # --- prediction ------------------------------------------------------------------------------------

    def predict(self, delta_angle: FloatArray, delta_velocity: FloatArray) -> None:
        """Move all states by one step.

        Args:
            delta_angle: (N, 3) the body's turn by the gyroscopes [rad].
            delta_velocity: (N, 3) its gain of velocity by the accelerometers [m/s].
        """
        _strapdown(
            self._dt_s, delta_angle, delta_velocity, self.q_ned_frd, self.matrix, self.vector, self.gained,
            self._impulse,
        )  # fmt: skip
        self._waiting_s += self._dt_s

    def catch_up(self) -> None:
        """Let the covariance grow over the predictions since the last call."""
        dt_s, self._waiting_s = self._waiting_s, 0.0
        if dt_s == 0.0:
            return
        _catch_up(
            dt_s,
            self.matrix,
            self._impulse,
            self.level_accel_m_s2,
            self.bad_accel,
            self._noise,
            self.covariance,
        )

    # --- fusion ----------------------------------------------------------------------------------------

    def variance(self, index: int) -> FloatArray:
        """(N,) of one state, a view."""
        return self.covariance[:, index, index]

    def fuse(self, index: int, innovation: FloatArray, variance: FloatArray) -> None:
        """Take a measurement of one state.

        Args:
            index: which.
            innovation: (N,) measured minus believed.
            variance: (N,) of the measurement; UNUSED and more leave a vehicle alone.
        """
        self.fuse_states(index, innovation[:, None], variance[:, None])

    def fuse_states(self, first: int, innovation: FloatArray, variance: FloatArray) -> None:
        """Take measurements of neighbouring states at once.

        Args:
            first: index of the first.
            innovation: (N, m) measured minus believed, m up to 6.
            variance: (N, m) of the measurements; UNUSED and more leave a state alone.
        """
        _fuse_states(
            first, np.ascontiguousarray(innovation), np.ascontiguousarray(variance), self.bad_accel,
            self._bias_limit, self.covariance, self._change, self.vector, self.q_ned_frd, self.matrix,
        )  # fmt: skip

    def sight(self, sensitivity: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How measurements depend on the states.

        Args:
            sensitivity: (N, m, 21) of m measurements on the error states.
            variance: (N,) of each.

        Returns:
            Covariance of states and measurements (N, 21, m), and of the innovations (N, m, m).
        """
        count, measured = sensitivity.shape[:2]
        seen, total = np.empty((count, SIZE, measured)), np.empty((count, measured, measured))
        _sight(self.covariance, sensitivity, variance, seen, total)
        return seen, total

    def fuse_seen(
        self, seen: FloatArray, total: FloatArray, innovation: FloatArray, learns: FloatArray
    ) -> None:
        """Take measurements of mixtures of states.

        Args:
            seen: (N, 21, m) and
            total: (N, m, m), both of `sight`.
            innovation: (N, m) measured minus believed.
            learns: (N, 21) 1 for a state that they may correct, 0 for one they must leave.
        """
        _fuse_seen(
            seen, total, np.ascontiguousarray(innovation), learns, self.bad_accel, self._bias_limit,
            self.covariance, self._gain, self._change, self._inverse, self.vector, self.q_ned_frd,
            self.matrix,
        )  # fmt: skip

    def straighten(self) -> None:
        """Undo what rounding does to a covariance in a long flight; a few times a second."""
        _straighten(self.covariance)

    def reset_heading(self, mask: BoolArray, down_rad: FloatArray, variance: FloatArray) -> None:
        """Turn by any angle (N,) about down, and take that for known this well (N,), where `mask` is."""
        half = 0.5 * np.where(mask, down_rad, 0.0)
        delta = np.zeros_like(self.q_ned_frd)
        delta[:, 0], delta[:, 3] = np.cos(half), np.sin(half)
        self.q_ned_frd[:] = quaternion_product(delta, self.q_ned_frd)
        self.matrix[:] = rotation_matrix(self.q_ned_frd)
        rows = np.flatnonzero(mask)
        self.covariance[rows, YAW, :] = self.covariance[rows, :, YAW] = 0.0
        self.covariance[rows, YAW, YAW] = variance[rows]


@formula
def _corrected(
    change: Blocks, bad_accel: bool, bias_limit: Column, vector: Column, q: Column, matrix: Rows
) -> None:
    """Moves the states by the first column of `change` (21, m), and the attitude by a small turn."""
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
def _advanced(dt_s: float, turned: Rows, lean: Rows, states: Column) -> None:
    """How one step moves the errors (21,): attitude by gyro bias, velocity and position by what is before."""
    tilt_n, tilt_e, tilt_d = states[0], states[1], states[2]
    for k in range(3):
        by_lean = lean[k, 0] * tilt_n + lean[k, 1] * tilt_e + lean[k, 2] * tilt_d
        by_bias = 0.0
        for j in range(3):
            states[TILT + k] += turned[k, j] * states[GYRO_BIAS + j]
            by_bias += turned[k, j] * states[ACCEL_BIAS + j]
        states[POSITION + k] += dt_s * states[VELOCITY + k] + 0.5 * dt_s * (by_lean + by_bias)
        states[VELOCITY + k] += by_lean + by_bias


@formula
def _invert(total: Rows, count: int, inverse: Rows) -> None:
    """The inverse of a symmetric positive matrix of up to three rows, into the corner of (3, 3)."""
    a, b, c, d, e, f = total[0, 0], 0.0, 0.0, 1.0, 0.0, 1.0
    if count > 1:
        b, d = total[0, 1], total[1, 1]
    if count > 2:
        c, e, f = total[0, 2], total[1, 2], total[2, 2]
    inverse[0, 0], inverse[1, 1], inverse[2, 2] = d * f - e * e, a * f - c * c, a * d - b * b
    inverse[0, 1], inverse[0, 2], inverse[1, 2] = c * e - b * f, b * e - c * d, b * c - a * e
    determinant = a * inverse[0, 0] + b * inverse[0, 1] + c * inverse[0, 2]
    for j in range(3):
        for k in range(j, 3):
            inverse[j, k] = inverse[k, j] = inverse[j, k] / determinant


@kernel
def _strapdown(
    dt_s: float, delta_angle: Rows, delta_velocity: Rows, q: Rows, matrix: Blocks, vector: Rows, gained: Rows,
    impulse: Rows,
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
        felt = rotated(
            matrix[i],
            delta_velocity[i, 0] - vector[i, accel] * dt_s,
            delta_velocity[i, 1] - vector[i, accel + 1] * dt_s,
            delta_velocity[i, 2] - vector[i, accel + 2] * dt_s,
        )
        for k in range(3):
            impulse[i, k] += felt[k]
            gained[i, k] = felt[k] + (GRAVITY_M_S2 * dt_s if k == 2 else 0.0)
            vector[i, POSITION - VELOCITY + k] += dt_s * vector[i, k]
            vector[i, k] += gained[i, k]


@kernel
def _catch_up(
    dt_s: float, matrix: Blocks, impulse: Rows, level_accel: Rows, bad_accel: Flags, noise: Rows,
    covariance: Blocks,
) -> None:  # fmt: skip
    """The covariance after a step, which is the same for its columns and for its rows."""
    turned, lean, states = np.empty((3, 3)), np.zeros((3, 3)), np.empty(SIZE)
    for i in range(covariance.shape[0]):
        for j in range(3):
            for k in range(3):
                turned[j, k] = -dt_s * matrix[i, j, k]
        north, east, down = impulse[i, 0], impulse[i, 1], impulse[i, 2]
        lean[0, 1], lean[0, 2], lean[1, 2] = down, -east, north
        lean[1, 0], lean[2, 0], lean[2, 1] = -down, east, -north
        for k in range(2):
            level_accel[i, k] += impulse[i, k] - dt_s / ACCEL_SMOOTHING_S * level_accel[i, k]
        impulse[i] = 0.0
        for column in range(SIZE):
            for k in range(SIZE):
                states[k] = covariance[i, k, column]
            _advanced(dt_s, turned, lean, states)
            for k in range(SIZE):
                covariance[i, k, column] = states[k]
        for row in range(SIZE):
            _advanced(dt_s, turned, lean, covariance[i, row])
        for k in range(SIZE):
            covariance[i, k, k] += noise[i, k] * dt_s
        if bad_accel[i]:
            covariance[i, VELOCITY + 2, VELOCITY + 2] += BAD_ACCEL_NOISE_M_S2**2 * PREDICTION_S * dt_s


@kernel
def _fuse_states(
    first: int, innovation: Rows, variance: Rows, bad_accel: Flags, bias_limit: Rows, covariance: Blocks,
    change: Blocks, vector: Rows, q: Rows, matrix: Blocks,
) -> None:  # fmt: skip
    """One measurement after the other: where their noise is independent that is the same as all at once."""
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
            left = innovation[i, m] - change[i, state, 0]
            for k in range(SIZE):
                change[i, k, 1] = covariance[i, state, k]
            for k in range(SIZE):
                gain = change[i, k, 1] * scale
                change[i, k, 0] += gain * left
                for j in range(SIZE):
                    covariance[i, k, j] -= gain * change[i, j, 1]
        if taken:
            _corrected(change[i], bad_accel[i], bias_limit[i], vector[i], q[i], matrix[i])


@kernel
def _sight(covariance: Blocks, sensitivity: Blocks, variance: Column, seen: Blocks, total: Blocks) -> None:
    measured = sensitivity.shape[1]
    for i in range(covariance.shape[0]):
        for k in range(SIZE):
            for m in range(measured):
                value = 0.0
                for j in range(SIZE):
                    value += covariance[i, k, j] * sensitivity[i, m, j]
                seen[i, k, m] = value
        for m in range(measured):
            for n in range(measured):
                value = variance[i] if m == n else 0.0
                for j in range(SIZE):
                    value += sensitivity[i, m, j] * seen[i, j, n]
                total[i, m, n] = value


@kernel
def _fuse_seen(
    seen: Blocks, total: Blocks, innovation: Rows, learns: Rows, bad_accel: Flags, bias_limit: Rows,
    covariance: Blocks, gain: Blocks, change: Blocks, inverse: Blocks, vector: Rows, q: Rows, matrix: Blocks,
) -> None:  # fmt: skip
    """Joseph's form: right for any gain."""
    measured = innovation.shape[1]
    for i in range(covariance.shape[0]):
        taken = False
        for k in range(SIZE):
            taken = taken or learns[i, k] != 0.0
        if not taken:
            continue
        _invert(total[i], measured, inverse[i])
        for k in range(SIZE):
            for m in range(measured):
                value = 0.0
                for n in range(measured):
                    value += seen[i, k, n] * inverse[i, n, m]
                gain[i, k, m] = value * learns[i, k]
        # What is added to seen: half of gain times total, so that one product serves both sides.
        for k in range(SIZE):
            for m in range(measured):
                value = seen[i, k, m]
                for n in range(measured):
                    value -= 0.5 * gain[i, k, n] * total[i, n, m]
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
        _corrected(change[i], bad_accel[i], bias_limit[i], vector[i], q[i], matrix[i])


@kernel
def _straighten(covariance: Blocks) -> None:
    for i in range(covariance.shape[0]):
        for k in range(SIZE):
            for j in range(k):
                covariance[i, k, j] = covariance[i, j, k] = 0.5 * (covariance[i, k, j] + covariance[i, j, k])
            covariance[i, k, k] = max(covariance[i, k, k], _LEAST_VARIANCE)
