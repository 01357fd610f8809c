"""Estimates the heading from GNSS velocity without a magnetometer, by five weighted hypotheses.

This is PX4's EKF-GSF. The accelerometer levels one attitude, which is rotated to five headings. Each
hypothesis integrates its own velocity, and the GNSS velocities correct its heading. If the main filter keeps
rejecting velocities and its heading differs from this estimator's heading, the main filter is reset to this
heading.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.frames import GRAVITY_M_S2, rotation_matrix, wrap_pi, yaw_of
from vehicle_sim.kernels import Blocks, Rows, kernel
from vehicle_sim.rotations import constrain, length, rotate_attitude, rotated, write_matrix

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

PREDICTIONS_PER_STEP = 4
"""Predictions of the main filter per step of this estimator."""
HYPOTHESES = 5
TILT_GAIN_PER_S = 0.2
BIAS_GAIN_PER_S = 0.04
"""Fraction of a tilt correction that is attributed to the gyroscope's bias, while the vehicle rotates
slowly."""
SLOW_ROTATION_RAD_S = math.radians(10.0)
BIAS_LIMIT_RAD_S = 0.05
FORCE_SMOOTHING_PER_S = 2.0
FORCE_ATTENUATION = 2.0
"""The specific force is not used to level the attitude if it differs from gravity by more than 0.5 g."""
ACCEL_NOISE_M_S2, GYRO_NOISE_RAD_S = 2.0, 0.1
NOISE_STEP_S = 0.008
"""PX4 adds this noise once per filter step; this step length converts it to a density."""
MAX_SQUARED_SIGMA = 25.0
"""Square of the largest innovation, in standard deviations; larger innovations are clipped to this limit."""
MIN_WEIGHT = 1e-5
MAX_HEADING_SIGMA_RAD = 0.262
"""Largest standard deviation at which the main filter may be reset to the heading."""
_NOISE_PER_S = np.square([[[ACCEL_NOISE_M_S2]], [[ACCEL_NOISE_M_S2]], [[GYRO_NOISE_RAD_S]]]) * NOISE_STEP_S
_INITIAL_ANGLES = np.arange(HYPOTHESES) * (2.0 * math.pi / HYPOTHESES)


class YawEstimator:
    """Yaw estimators of N vehicles.

    Args:
        count: N.
        q_ned_frd: (N, 4) attitudes of the main filter, read when a vehicle starts.
    """

    def __init__(self, count: int, q_ned_frd: FloatArray) -> None:
        self._main_q = q_ned_frd
        self._q = q_ned_frd.copy()
        self._matrix = rotation_matrix(self._q)
        self._bias = np.zeros((count, 3))
        self._force = np.tile([0.0, 0.0, -GRAVITY_M_S2], (count, 1))
        self._velocity_change = np.zeros((count, 3))
        self._unfused_s = 0.0
        self._running = np.zeros(count, dtype=np.bool_)
        self._states = np.zeros((3, count, HYPOTHESES))
        """Velocity north and east, and the angle from the levelled attitude's heading to the hypothesis'
        heading."""
        self._covariance = np.zeros((3, 3, count, HYPOTHESES))
        self._variances = np.einsum("kkno->kno", self._covariance)
        """(3, N, 5) variances, a view of the covariance."""
        self._weights = np.full((count, HYPOTHESES), 1.0 / HYPOTHESES)

    def stop(self, mask: BoolArray) -> None:
        """Stops the hypotheses and resets their attitude to the main filter's attitude."""
        np.copyto(self._q, self._main_q, where=mask[:, None])
        self._matrix[:] = rotation_matrix(self._q)
        self._running &= ~mask

    def predict(self, delta_angle: FloatArray, delta_velocity: FloatArray, dt_s: float) -> None:
        """Rotates and levels the attitudes, and adds the change of velocity.

        Args:
            delta_angle: (N, 3) rotation of the body measured by the gyroscopes [rad] since the last call.
            delta_velocity: (N, 3) change of velocity measured by the accelerometers [m/s].
            dt_s: time since the last call.
        """
        _rotate_and_level(
            dt_s,
            delta_angle,
            delta_velocity,
            self._bias,
            self._force,
            self._velocity_change,
            self._q,
            self._matrix,
        )
        self._unfused_s += dt_s

    def fuse(
        self, velocity_ne: FloatArray, variance: FloatArray, fresh: BoolArray, in_air: BoolArray
    ) -> None:
        """Fuses GNSS velocities.

        Args:
            velocity_ne: (N, 2) [m/s].
            variance: (N,) variance of each axis.
            fresh: (N,) vehicles with a new good fix; all others continue with their IMU.
            in_air: (N,) vehicles in the air; on the ground velocity does not show a heading.
        """
        dt_s, self._unfused_s = self._unfused_s, 0.0
        self._advance(dt_s)
        if (self._running & ~in_air).any():
            self.stop(self._running & ~in_air)
        starting = fresh & in_air & ~self._running
        if starting.any():
            self._start(starting, velocity_ne, variance)
        updated = fresh & self._running & ~starting
        if updated.any():
            self._correct_hypotheses(updated, velocity_ne, variance)

    def _start(self, starting: BoolArray, velocity_ne: FloatArray, variance: FloatArray) -> None:
        self.stop(starting)
        self._running |= starting
        self._weights[starting] = 1.0 / HYPOTHESES
        self._states[:2, starting] = velocity_ne[starting].T[:, :, None]
        self._states[2, starting] = _INITIAL_ANGLES
        self._covariance[:, :, starting] = 0.0
        self._variances[:2, starting] = variance[starting][:, None]
        self._variances[2, starting] = (math.pi / HYPOTHESES) ** 2

    def _advance(self, dt_s: float) -> None:
        """Adds the change of velocity to each hypothesis, rotated by its heading."""
        angle, covariance = self._states[2], self._covariance
        cosine, sine = np.cos(angle), np.sin(angle)
        forward, right = self._velocity_change[:, :1], self._velocity_change[:, 1:2]
        north, east = cosine * forward - sine * right, sine * forward + cosine * right
        self._states[0] += north
        self._states[1] += east
        self._velocity_change.fill(0.0)
        for axis, gradient in ((0, -east), (1, north)):
            covariance[axis] += gradient * covariance[2]
            covariance[:, axis] += gradient * covariance[:, 2]
        self._variances += _NOISE_PER_S * dt_s

    def _correct_hypotheses(self, updated: BoolArray, velocity_ne: FloatArray, variance: FloatArray) -> None:
        """Corrects each hypothesis by the velocity, and updates the weights by the likelihoods."""
        covariance, updated_rows = self._covariance, updated[:, None]
        noise = np.where(updated, variance, 1.0)[:, None]
        (nn, ee), ne = self._variances[:2] + noise, covariance[0, 1].copy()
        determinant = np.maximum(nn * ee - ne * ne, 1e-12)
        innovation = velocity_ne.T[:, :, None] - self._states[:2]
        north, east = innovation
        ratio = (ee * north * north - 2.0 * ne * north * east + nn * east * east) / determinant
        innovation *= np.sqrt(np.minimum(MAX_SQUARED_SIGMA / np.maximum(ratio, 1e-9), 1.0))
        cross_covariance = covariance[:, :2] * updated_rows
        north_gain = (cross_covariance[:, 0] * ee - cross_covariance[:, 1] * ne) / determinant
        east_gain = (cross_covariance[:, 1] * nn - cross_covariance[:, 0] * ne) / determinant
        self._states += north_gain * north + east_gain * east
        for gain, column in ((north_gain, cross_covariance[:, 0]), (east_gain, cross_covariance[:, 1])):
            covariance -= gain[:, None] * column
        density = np.exp(-0.5 * np.minimum(ratio, MAX_SQUARED_SIGMA)) / np.sqrt(determinant)
        weights = np.maximum(self._weights * density, 1e-30)
        weights = np.maximum(weights / weights.sum(axis=1, keepdims=True), MIN_WEIGHT)
        np.copyto(self._weights, weights / weights.sum(axis=1, keepdims=True), where=updated_rows)

    def headings(self) -> tuple[FloatArray, FloatArray]:
        """(N,) weighted mean of the hypotheses' headings [rad], and the variance [rad²], which is infinite if
        no hypothesis is running."""
        headings = yaw_of(self._q)[:, None] + self._states[2]
        weights = self._weights
        mean = np.arctan2((weights * np.sin(headings)).sum(axis=1), (weights * np.cos(headings)).sum(axis=1))
        spread = wrap_pi(headings - mean[:, None]) ** 2 + self._variances[2]
        return mean, np.where(self._running, (weights * spread).sum(axis=1), np.inf)


@kernel
def _rotate_and_level(
    dt_s: float, delta_angle: Rows, delta_velocity: Rows, bias: Rows, force: Rows, velocity_change: Rows,
    q: Rows, matrix: Blocks,
) -> None:  # fmt: skip
    weight = min(1.0, FORCE_SMOOTHING_PER_S * dt_s)
    for i in range(q.shape[0]):
        for k in range(3):
            force[i, k] += weight * (delta_velocity[i, k] / dt_s - force[i, k])
        fx, fy, fz = force[i, 0], force[i, 1], force[i, 2]
        rx, ry, rz = (
            delta_angle[i, 0] / dt_s - bias[i, 0],
            delta_angle[i, 1] / dt_s - bias[i, 1],
            delta_angle[i, 2] / dt_s - bias[i, 2],
        )
        magnitude = length(fx, fy, fz)
        attenuation = min(FORCE_ATTENUATION * abs(magnitude / GRAVITY_M_S2 - 1.0), 1.0)
        gain = TILT_GAIN_PER_S * (1.0 - attenuation) ** 2 / max(magnitude, 1.0)
        down_x, down_y, down_z = matrix[i, 2, 0], matrix[i, 2, 1], matrix[i, 2, 2]
        correction = (
            gain * (down_y * fz - down_z * fy),
            gain * (down_z * fx - down_x * fz),
            gain * (down_x * fy - down_y * fx),
        )
        bias_gain = BIAS_GAIN_PER_S * dt_s if length(rx, ry, rz) < SLOW_ROTATION_RAD_S else 0.0
        delta_ned = rotated(matrix[i], delta_velocity[i, 0], delta_velocity[i, 1], delta_velocity[i, 2])
        for k in range(3):
            bias[i, k] = constrain(
                bias[i, k] - bias_gain * correction[k], -BIAS_LIMIT_RAD_S, BIAS_LIMIT_RAD_S
            )
            velocity_change[i, k] += delta_ned[k]
        rotate_attitude(
            q[i],
            (rx + correction[0]) * dt_s,
            (ry + correction[1]) * dt_s,
            (rz + correction[2]) * dt_s,
        )
        write_matrix(q[i], matrix[i])
