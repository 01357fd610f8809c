"""The extended Kalman filter of N vehicles: 21 error states in the order of PX4's EKF2, wind left out.

Attitude is kept as a quaternion, its error as a rotation in NED; everything else is additive. The strapdown
prediction runs at half the IMU rate, the covariance catches up just before something is fused, so that an
update costs the same for one vehicle as for a hundred. Noise figures are PX4's EKF2_* parameters.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.frames import (
    GRAVITY_M_S2,
    cross_table,
    quaternion_product,
    quaternion_rate,
    rotate,
    rotation_matrix,
    row_norm,
)
from vehicle_sim.masks import any_of
from vehicle_sim.parameters import Parameters

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

TILT, YAW, VELOCITY, POSITION, GYRO_BIAS, ACCEL_BIAS, FIELD, MAG_BIAS, SIZE = 0, 2, 3, 6, 9, 12, 15, 18, 21
"""First index of each error state; TILT and YAW are the rotation about north, east and down."""
_MOVING = 9
"""States that a prediction couples: attitude, velocity, position."""
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
        self._dt_s = np.array(dt_s)
        self._step_s = dt_s
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
        self._gravity = np.tile([0.0, 0.0, GRAVITY_M_S2 * dt_s], (count, 1))
        self._advance = np.zeros((count, _MOVING, SIZE))
        self._advance[:, range(_MOVING), range(_MOVING)] = 1.0
        # Views of arrays that are only ever written in place.
        advance = self._advance
        self._turned = advance[:, TILT:VELOCITY, GYRO_BIAS:ACCEL_BIAS]
        self._leant = advance[:, VELOCITY:POSITION, TILT:VELOCITY]
        self._pushed = advance[:, VELOCITY:POSITION, ACCEL_BIAS:FIELD]
        self._moved_by_lean = advance[:, POSITION:GYRO_BIAS, TILT:VELOCITY]
        self._moved_by_push = advance[:, POSITION:GYRO_BIAS, ACCEL_BIAS:FIELD]
        self._coasted = _diagonal(advance[:, POSITION:GYRO_BIAS, VELOCITY:POSITION])
        self._variances = _diagonal(self.covariance)
        # Row j, columns (k, i): how a turn about i moves a gain of velocity along j to k.
        self._lean = cross_table().transpose(1, 2, 0).reshape(3, 9)
        self._biases = self.vector[:, GYRO_BIAS - VELOCITY : FIELD - VELOCITY]
        self._correction = np.zeros((count, SIZE))
        self._delta = np.ones((count, 4))
        # Room for changes of the covariance: a large fleet's are so large that to make them costs more than
        # to fill them.
        self._change, self._other = np.zeros((2, count, SIZE, SIZE))
        self._moved = np.zeros((count, _MOVING, SIZE))
        self._moved_back = np.zeros((count, SIZE, _MOVING))

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
        q = self.q_ned_frd
        q += quaternion_rate(q, delta_angle - self.gyro_bias * self._dt_s)
        q /= row_norm(q)
        self.matrix = rotation_matrix(q)
        gained = rotate(self.matrix, delta_velocity - self.accel_bias * self._dt_s)
        self._impulse += gained
        gained += self._gravity
        self.gained = gained
        self.position += self._dt_s * self.velocity
        self.velocity += gained
        self._waiting_s += self._step_s

    def catch_up(self) -> None:
        """Let the covariance grow over the predictions since the last call."""
        dt_s, self._waiting_s = self._waiting_s, 0.0
        if dt_s == 0.0:
            return
        advance, turned = self._advance, self.matrix * -dt_s
        lean = (self._impulse[:, None, :] @ self._lean).reshape(-1, 3, 3)
        self._turned[:] = self._pushed[:] = turned
        self._leant[:] = lean
        np.multiply(lean, 0.5 * dt_s, out=self._moved_by_lean)
        np.multiply(turned, 0.5 * dt_s, out=self._moved_by_push)
        self._coasted[:] = dt_s
        self.level_accel_m_s2 += self._impulse[:, :2] - dt_s / ACCEL_SMOOTHING_S * self.level_accel_m_s2
        self._impulse.fill(0.0)
        covariance = self.covariance
        covariance[:, :_MOVING, :] = np.matmul(advance, covariance, out=self._moved)
        back = np.matmul(covariance, advance.transpose(0, 2, 1), out=self._moved_back)
        covariance[:, :, :_MOVING] = back
        diagonal = self._variances
        diagonal += self._noise * dt_s
        if any_of(self.bad_accel):
            diagonal[self.bad_accel, VELOCITY + 2] += BAD_ACCEL_NOISE_M_S2**2 * PREDICTION_S * dt_s

    # --- fusion ----------------------------------------------------------------------------------------

    def variance(self, index: int) -> FloatArray:
        """(N,) of one state, a view."""
        return self.covariance[:, index, index]

    def fuse(self, index: int, innovation: FloatArray, variance: FloatArray) -> None:
        """Take a measurement of one state.

        Args:
            index: which.
            innovation: (N,) measured minus believed.
            variance: (N,) of the measurement; infinite leaves a vehicle alone.
        """
        column = self.covariance[:, index, :].copy()
        gain = column / (column[:, index] + variance)[:, None]
        self.covariance -= np.multiply(gain[:, :, None], column[:, None, :], out=self._change)
        self._correct(gain * innovation[:, None])

    def fuse_states(self, first: int, innovation: FloatArray, variance: FloatArray) -> None:
        """Take measurements of neighbouring states at once.

        Args:
            first: index of the first.
            innovation: (N, m) measured minus believed.
            variance: (N, m) of the measurements; UNUSED leaves a state alone.
        """
        count = innovation.shape[1]
        seen = self.covariance[:, :, first : first + count].copy()
        total = seen[:, first : first + count].copy()
        diagonal = _diagonal(total)
        diagonal += variance
        gain = seen @ np.linalg.inv(total)
        self.covariance -= np.matmul(gain, seen.transpose(0, 2, 1), out=self._change)
        self._correct((gain @ innovation[:, :, None])[:, :, 0])

    def sight(self, sensitivity: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How measurements depend on the states.

        Args:
            sensitivity: (N, m, 21) of m measurements on the error states.
            variance: (N,) of each.

        Returns:
            Covariance of states and measurements (N, 21, m), and of the innovations (N, m, m).
        """
        seen = self.covariance @ sensitivity.transpose(0, 2, 1)
        total = sensitivity @ seen
        diagonal = _diagonal(total)
        diagonal += variance[:, None]
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
        gain = (seen @ np.linalg.inv(total)) * learns[:, :, None]
        # Joseph's form: right for any gain.
        change, both = self._change, self._other
        np.matmul(gain, seen.transpose(0, 2, 1), out=change)
        self.covariance -= np.add(change, change.transpose(0, 2, 1), out=both)
        self.covariance += np.matmul(gain @ total, gain.transpose(0, 2, 1), out=change)
        self._correct((gain @ innovation[:, :, None])[:, :, 0])

    def straighten(self) -> None:
        """Undo what rounding does to a covariance in a long flight; a few times a second."""
        covariance = self.covariance
        np.copyto(self._change, covariance.transpose(0, 2, 1))
        covariance += self._change
        covariance *= 0.5
        np.maximum(self._variances, _LEAST_VARIANCE, out=self._variances)

    def _correct(self, correction: FloatArray) -> None:
        if any_of(self.bad_accel):
            correction[self.bad_accel, ACCEL_BIAS + 2] = 0.0
        self.vector += correction[:, VELOCITY:]
        np.clip(self._biases, -self._bias_limit, self._bias_limit, out=self._biases)
        self.turn(correction[:, :VELOCITY])

    def turn(self, turn_ned_rad: FloatArray) -> None:
        """Turn the attitudes by small angles (N, 3) about north, east and down."""
        turned = np.logical_or.reduce(turn_ned_rad, axis=1, keepdims=True)
        self._delta[:, 1:] = 0.5 * turn_ned_rad
        q = quaternion_product(self._delta, self.q_ned_frd)
        # Who is not turned keeps its last bit, whoever else is.
        np.copyto(self.q_ned_frd, q / row_norm(q), where=turned)
        self.matrix = rotation_matrix(self.q_ned_frd)

    def reset_heading(self, mask: BoolArray, down_rad: FloatArray, variance: FloatArray) -> None:
        """Turn by any angle (N,) about down, and take that for known this well (N,), where `mask` is."""
        half = 0.5 * np.where(mask, down_rad, 0.0)
        delta = np.zeros_like(self._delta)
        delta[:, 0], delta[:, 3] = np.cos(half), np.sin(half)
        self.q_ned_frd[:] = quaternion_product(delta, self.q_ned_frd)
        self.matrix = rotation_matrix(self.q_ned_frd)
        rows = np.flatnonzero(mask)
        self.covariance[rows, YAW, :] = self.covariance[rows, :, YAW] = 0.0
        self.covariance[rows, YAW, YAW] = variance[rows]
