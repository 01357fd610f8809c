"""The extended Kalman filter of N vehicles: 21 error states in the order of PX4's EKF2, without wind.

The attitude is a quaternion and its error is a rotation in NED; all other states are additive. The strapdown
prediction runs at half the IMU rate. The covariance is propagated only before a fusion. PX4's EKF2_*
parameters give the noise.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.estimator import kalman_loops
from vehicle_sim.estimator.kalman_loops import (
    ACCEL_BIAS,
    EARTH_FIELD,
    GYRO_BIAS,
    MAG_BIAS,
    POSITION,
    PREDICTION_S,
    SIZE,
    TILT,
    VELOCITY,
    YAW,
)
from vehicle_sim.frames import quaternion_product, rotation_matrix
from vehicle_sim.parameters import Parameters

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_MIN_MAG_NOISE_GAUSS = 0.01


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
        """(N, 18) all states except the attitude; the attributes from `motion` to `mag_bias` are views of
        it."""
        self.motion = self.vector[:, :6].reshape(count, 2, 3)
        """(N, 2, 3) velocity [m/s] and position [m], NED."""
        self.velocity = self._view(VELOCITY)
        self.position = self._view(POSITION)
        self.gyro_bias = self._view(GYRO_BIAS)
        self.accel_bias = self._view(ACCEL_BIAS)
        self.earth_field = self._view(EARTH_FIELD)
        self.mag_bias = self._view(MAG_BIAS)
        self.covariance = np.zeros((count, SIZE, SIZE))
        self.bad_accel = np.zeros(count, dtype=np.bool_)
        """(N,) vehicles with a faulty vertical accelerometer: the noise of all three accelerometers is
        raised, and their biases are not estimated."""
        self.velocity_change = np.zeros((count, 3))
        """(N, 3) change of velocity in the newest prediction [m/s]."""
        self.horizontal_accel_m_s2 = np.zeros((count, 2))
        """(N, 2) horizontal acceleration, smoothed over ACCEL_SMOOTHING_S; GNSS makes the heading observable
        only during a large acceleration."""
        self.reset_shift = np.zeros((count, 2, 3))
        """(N, 2, 3) how far resets have moved velocity and position; the estimator clears the array."""
        self._reset_shift_rows = self.reset_shift.reshape(count, 6)
        """(N, 6) a view of `reset_shift`."""
        self._force_integral = np.zeros((count, 3))
        """(N, 3) integral of the specific force since the last covariance propagation [m/s], NED."""
        self._unpropagated_s = 0.0
        """Time since the last covariance propagation."""
        self._noise_density = np.zeros((count, SIZE))
        self._initial_variance = np.zeros((count, SIZE))
        self._bias_limit = np.full((count, 6), np.inf)
        self._variances = _diagonal(self.covariance)
        # Work arrays of a fusion.
        self._gain_work, self._correction_work = np.zeros((count, SIZE, 3)), np.zeros((count, SIZE, 3))
        self._inverse_work = np.zeros((count, 3, 3))

    def _view(self, first: int) -> FloatArray:
        return self.vector[:, first - VELOCITY : first - VELOCITY + 3]

    def configure(self, i: int, parameters: Parameters) -> None:
        """Reads noise and limits (EKF2_*) of vehicle `i`."""
        value = parameters.finite_value
        noise_density = self._noise_density[i]
        for first, name in (
            (TILT, "EKF2_GYR_NOISE"),
            (VELOCITY, "EKF2_ACC_NOISE"),
            (GYRO_BIAS, "EKF2_GYR_B_NOISE"),
            (ACCEL_BIAS, "EKF2_ACC_B_NOISE"),
            (EARTH_FIELD, "EKF2_MAG_E_NOISE"),
            (MAG_BIAS, "EKF2_MAG_B_NOISE"),
        ):
            noise_density[first : first + 3] = value(name) ** 2 * PREDICTION_S
        initial = self._initial_variance[i]
        initial[TILT : TILT + 2] = value("EKF2_ANGERR_INIT") ** 2
        initial[YAW] = max(value("EKF2_HEAD_NOISE"), 0.01) ** 2
        initial[VELOCITY:POSITION] = max(value("EKF2_GPS_V_NOISE"), 0.01) ** 2
        initial[POSITION:GYRO_BIAS] = max(value("EKF2_GPS_P_NOISE"), 0.01) ** 2
        initial[GYRO_BIAS:ACCEL_BIAS] = value("EKF2_GBIAS_INIT") ** 2
        initial[ACCEL_BIAS:EARTH_FIELD] = value("EKF2_ABIAS_INIT") ** 2
        initial[EARTH_FIELD:] = max(value("EKF2_MAG_NOISE"), _MIN_MAG_NOISE_GAUSS) ** 2
        self._bias_limit[i, :3] = value("EKF2_GYR_B_LIM")
        self._bias_limit[i, 3:] = value("EKF2_ABL_LIM")
        if not self.covariance[i].any():
            self.covariance[i] = np.diag(initial)

    def reset_covariance(self, mask: BoolArray, first: int, variance: FloatArray | float) -> None:
        """Sets the variances (N, 3) of three states from `first` on and clears their correlations, where
        `mask` is set."""
        rows = np.flatnonzero(mask)
        self.covariance[rows, first : first + 3, :] = 0.0
        self.covariance[rows, :, first : first + 3] = 0.0
        for k in range(3):
            new_variance = np.broadcast_to(variance, (len(mask), 3))[rows, k]
            self.covariance[rows, first + k, first + k] = new_variance

    def reset_state(
        self, mask: BoolArray, index: int, value: FloatArray | float, variance: FloatArray
    ) -> None:
        """Sets velocity or position `index` to a value (N,) with a variance (N,), where `mask` is set."""
        rows = np.flatnonzero(mask)
        new_value = np.broadcast_to(value, mask.shape)[rows]
        self._reset_shift_rows[rows, index - VELOCITY] += new_value - self.vector[rows, index - VELOCITY]
        self.vector[rows, index - VELOCITY] = new_value
        self.covariance[rows, index, :] = 0.0
        self.covariance[rows, :, index] = 0.0
        self.covariance[rows, index, index] = np.broadcast_to(variance, mask.shape)[rows]

    def reset_field_covariance(self, field_resets: BoolArray, bias_resets: BoolArray | None = None) -> None:
        """Resets the covariances of earth field and magnetometer bias to their initial values.

        Args:
            field_resets: (N,) vehicles whose field covariance is reset.
            bias_resets: (N,) vehicles whose bias covariance is reset; None: the same vehicles.
        """
        initial = self._initial_variance[:, EARTH_FIELD : EARTH_FIELD + 3]
        self.reset_covariance(field_resets, EARTH_FIELD, initial)
        bias_resets = field_resets if bias_resets is None else bias_resets
        self.reset_covariance(bias_resets, MAG_BIAS, initial)

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
        kalman_loops.strapdown(
            self._dt_s, delta_angle, delta_velocity, self.q_ned_frd, self.matrix, self.vector,
            self.velocity_change, self._force_integral,
        )  # fmt: skip
        self._unpropagated_s += self._dt_s

    def propagate_covariance(self) -> None:
        """Propagates the covariance over the predictions since the last call."""
        dt_s, self._unpropagated_s = self._unpropagated_s, 0.0
        if dt_s == 0.0:
            return
        kalman_loops.propagate_covariance(
            dt_s,
            self.matrix,
            self._force_integral,
            self.horizontal_accel_m_s2,
            self.bad_accel,
            self._noise_density,
            self.covariance,
        )

    # --- fusion ----------------------------------------------------------------------------------------

    def variance(self, index: int) -> FloatArray:
        """(N,) variance of one state, a view."""
        return self.covariance[:, index, index]

    def fuse(self, index: int, innovation: FloatArray, variance: FloatArray) -> None:
        """Fuses a measurement of one state.

        Args:
            index: index of the state.
            innovation: (N,) measured value minus predicted value.
            variance: (N,) variance of the measurement; vehicles with UNUSED or more are not changed.
        """
        self.fuse_states(index, innovation[:, None], variance[:, None])

    def fuse_states(self, first: int, innovation: FloatArray, variance: FloatArray) -> None:
        """Fuses measurements of adjacent states.

        Args:
            first: index of the first state.
            innovation: (N, m) measured values minus predicted values, m up to 6.
            variance: (N, m) variances; measurements with UNUSED or more are not fused.
        """
        kalman_loops.fuse_states(
            first, np.ascontiguousarray(innovation), np.ascontiguousarray(variance), self.bad_accel,
            self._bias_limit, self.covariance, self._correction_work, self.vector, self.q_ned_frd,
            self.matrix,
        )  # fmt: skip

    def measurement_covariances(
        self, sensitivity: FloatArray, variance: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Covariances of measurements that depend on several states.

        Args:
            sensitivity: (N, m, 21) sensitivity of m measurements to the error states.
            variance: (N,) variance of each measurement.

        Returns:
            Covariance of states and measurements (N, 21, m), and covariance of the innovations (N, m, m).
        """
        count, measurement_count = sensitivity.shape[:2]
        cross_covariance, innovation_covariance = (
            np.empty((count, SIZE, measurement_count)),
            np.empty((count, measurement_count, measurement_count)),
        )
        kalman_loops.measurement_covariances(
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
            innovation: (N, m) measured values minus predicted values.
            correctable: (N, 21) 1 for states that the measurements may correct, otherwise 0.
        """
        kalman_loops.fuse_measurements(
            cross_covariance, innovation_covariance, np.ascontiguousarray(innovation), correctable,
            self.bad_accel, self._bias_limit, self.covariance, self._gain_work, self._correction_work,
            self._inverse_work, self.vector, self.q_ned_frd, self.matrix,
        )  # fmt: skip

    def restore_symmetry(self) -> None:
        """Corrects rounding errors of the covariance; called a few times per second."""
        kalman_loops.restore_symmetry(self.covariance)

    def reset_heading(self, mask: BoolArray, angle_rad: FloatArray, variance: FloatArray) -> None:
        """Rotates the attitudes about the down axis by angles (N,) of any size, and sets the heading's
        variance, where `mask` is set."""
        half_angle = 0.5 * np.where(mask, angle_rad, 0.0)
        rotation = np.zeros_like(self.q_ned_frd)
        rotation[:, 0], rotation[:, 3] = np.cos(half_angle), np.sin(half_angle)
        self.q_ned_frd[:] = quaternion_product(rotation, self.q_ned_frd)
        self.matrix[:] = rotation_matrix(self.q_ned_frd)
        rows = np.flatnonzero(mask)
        self.covariance[rows, YAW, :] = self.covariance[rows, :, YAW] = 0.0
        self.covariance[rows, YAW, YAW] = variance[rows]
