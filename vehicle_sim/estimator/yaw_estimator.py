"""The heading by GNSS velocity alone: five hypotheses a vehicle, weighed by how well each explains it.

PX4's second opinion (EKF-GSF), which knows no magnetometer: one attitude levelled by the accelerometer is
turned to five headings; each integrates its own velocity and learns its heading from the fixes. Where the
main filter goes on refusing velocities and this heading is another one, the main filter is reset to it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.frames import (
    GRAVITY_M_S2,
    cross,
    quaternion_rate,
    rotate,
    rotation_matrix,
    row_norm,
    wrap_pi,
    yaw_of,
)

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

EVERY_PREDICTIONS = 4
HYPOTHESES = 5
TILT_GAIN_PER_S = 0.2
BIAS_GAIN_PER_S = 0.04
"""What of a tilt correction is taken for an error of the gyroscope, while it turns slowly."""
SLOW_RAD_S = math.radians(10.0)
BIAS_LIMIT_RAD_S = 0.05
FORCE_SMOOTHING_PER_S = 2.0
FORCE_ATTENUATION = 2.0
"""A specific force that is half of 1 g off says nothing of the tilt."""
ACCEL_NOISE_M_S2, GYRO_NOISE_RAD_S = 2.0, 0.1
NOISE_STEP_S = 0.008
"""PX4 adds these once a filter step; this makes them a density."""
WORST_RATIO = 25.0
"""An innovation of more than five sigma counts as one of five."""
LEAST_WEIGHT = 1e-5
SURE_RAD = 0.262
"""Standard deviation up to which the heading may be used."""
_CIRCLE = np.arange(HYPOTHESES) * (2.0 * math.pi / HYPOTHESES)


class YawEstimator:
    """Second headings of N vehicles.

    Args:
        count: N.
        q_ned_frd: (N, 4) attitudes of the main filter, read when a vehicle starts.
    """

    def __init__(self, count: int, q_ned_frd: FloatArray) -> None:
        self._main = q_ned_frd
        self._q = q_ned_frd.copy()
        self._matrix = rotation_matrix(self._q)
        self._bias = np.zeros((count, 3))
        self._force = np.tile([0.0, 0.0, -GRAVITY_M_S2], (count, 1))
        self._gained = np.zeros((count, 1, 2))
        self._waited_s = 0.0
        self._runs = np.zeros(count, dtype=np.bool_)
        self._turn = np.tile(_CIRCLE, (count, 1))
        """(N, 5) from the levelled attitude's heading to each hypothesis'."""
        self._velocity = np.zeros((count, HYPOTHESES, 2))
        self._covariance = np.zeros((count, HYPOTHESES, 3, 3))
        self._weights = np.full((count, HYPOTHESES), 1.0 / HYPOTHESES)
        self.heading_rad = np.zeros(count)
        self.variance_rad2 = np.full(count, np.inf)
        """(N,) infinite: not started."""

    def reset(self, i: int) -> None:
        """Vehicle `i` starts anew."""
        self._bias[i] = 0.0
        self._stop(np.arange(len(self._runs)) == i)

    def _stop(self, who: BoolArray) -> None:
        """Level and turn as the main filter, no hypothesis running."""
        np.copyto(self._q, self._main, where=who[:, None])
        self._matrix = rotation_matrix(self._q)
        self._runs &= ~who
        self.variance_rad2[who] = np.inf

    def predict(self, delta_angle: FloatArray, delta_velocity: FloatArray, dt_s: float) -> None:
        """Turn and level the attitudes, and remember what velocity was gained.

        Args:
            delta_angle: (N, 3) the body's turn by the gyroscopes [rad] since the last call.
            delta_velocity: (N, 3) its gain of velocity by the accelerometers [m/s].
            dt_s: time since then.
        """
        rate = delta_angle / dt_s - self._bias
        self._force += min(1.0, FORCE_SMOOTHING_PER_S * dt_s) * (delta_velocity / dt_s - self._force)
        size = row_norm(self._force)
        off = np.minimum(FORCE_ATTENUATION * np.abs(size / GRAVITY_M_S2 - 1.0), 1.0)
        gain = TILT_GAIN_PER_S * (1.0 - off) ** 2 / np.maximum(size, 1.0)
        correction = cross(self._matrix[:, 2], self._force) * gain
        slow = row_norm(rate) < SLOW_RAD_S
        self._bias -= np.where(slow, BIAS_GAIN_PER_S * dt_s, 0.0) * correction
        np.clip(self._bias, -BIAS_LIMIT_RAD_S, BIAS_LIMIT_RAD_S, out=self._bias)
        self._gained[:, 0] += rotate(self._matrix, delta_velocity)[:, :2]
        self._q += quaternion_rate(self._q, (rate + correction) * dt_s)
        self._q /= row_norm(self._q)
        self._matrix = rotation_matrix(self._q)
        self._waited_s += dt_s

    def fuse(
        self, velocity_ne: FloatArray, variance: FloatArray, fresh: BoolArray, in_air: BoolArray
    ) -> None:
        """Take GNSS velocities.

        Args:
            velocity_ne: (N, 2) [m/s].
            variance: (N,) of each axis.
            fresh: (N,) whose are new and good; the others fly on by their IMU.
            in_air: (N,) in the air; on the ground nothing shows a heading.
        """
        dt_s, self._waited_s = self._waited_s, 0.0
        self._advance(dt_s)
        if (self._runs & ~in_air).any():
            self._stop(self._runs & ~in_air)
        new = fresh & in_air & ~self._runs
        if new.any():
            self._start(new, velocity_ne, variance)
        taken = fresh & self._runs & ~new
        if taken.any():
            self._weigh(taken, velocity_ne, variance)
        self._combine()

    def _start(self, new: BoolArray, velocity_ne: FloatArray, variance: FloatArray) -> None:
        self._stop(new)
        self._runs |= new
        self._turn[new] = _CIRCLE
        self._weights[new] = 1.0 / HYPOTHESES
        self._velocity[new] = velocity_ne[new][:, None]
        self._covariance[new] = 0.0
        self._covariance[new, :, 0, 0] = self._covariance[new, :, 1, 1] = variance[new][:, None]
        self._covariance[new, :, 2, 2] = (math.pi / HYPOTHESES) ** 2

    def _advance(self, dt_s: float) -> None:
        """Each hypothesis gains the velocity as its heading turns it."""
        cosine, sine = np.cos(self._turn), np.sin(self._turn)
        forward, right = self._gained[:, :, 0], self._gained[:, :, 1]
        north, east = cosine * forward - sine * right, sine * forward + cosine * right
        self._velocity[:, :, 0] += north
        self._velocity[:, :, 1] += east
        self._gained.fill(0.0)
        covariance = self._covariance
        for axis, lean in ((0, -east), (1, north)):
            covariance[:, :, axis] += lean[:, :, None] * covariance[:, :, 2]
            covariance[:, :, :, axis] += lean[:, :, None] * covariance[:, :, :, 2]
        for axis, noise in ((0, ACCEL_NOISE_M_S2), (1, ACCEL_NOISE_M_S2), (2, GYRO_NOISE_RAD_S)):
            covariance[:, :, axis, axis] += noise**2 * NOISE_STEP_S * dt_s

    def _weigh(self, taken: BoolArray, velocity_ne: FloatArray, variance: FloatArray) -> None:
        """Correct each hypothesis by the velocity, and believe it as far as it had foreseen it."""
        covariance, counts = self._covariance, taken[:, None]
        noise = np.where(taken, variance, 1.0)[:, None]
        nn, ee = covariance[:, :, 0, 0] + noise, covariance[:, :, 1, 1] + noise
        ne = covariance[:, :, 0, 1]
        determinant = np.maximum(nn * ee - ne * ne, 1e-12)
        off = np.where(counts[:, :, None], velocity_ne[:, None] - self._velocity, 0.0)
        north, east = off[:, :, 0], off[:, :, 1]
        ratio = (ee * north * north - 2.0 * ne * north * east + nn * east * east) / determinant
        off *= np.sqrt(np.minimum(WORST_RATIO / np.maximum(ratio, 1e-9), 1.0))[:, :, None]
        ratio = np.minimum(ratio, WORST_RATIO)
        inverse = np.empty((*nn.shape, 2, 2))
        inverse[:, :, 0, 0], inverse[:, :, 1, 1] = ee / determinant, nn / determinant
        inverse[:, :, 0, 1] = inverse[:, :, 1, 0] = -ne / determinant
        seen = np.where(counts[:, :, None, None], covariance[:, :, :, :2], 0.0)
        gain = seen @ inverse
        change = (gain @ off[:, :, :, None])[:, :, :, 0]
        self._velocity += change[:, :, :2]
        self._turn += change[:, :, 2]
        covariance -= gain @ seen.transpose(0, 1, 3, 2)
        density = np.exp(-0.5 * ratio) / np.sqrt(determinant)
        weights = np.maximum(self._weights * density, 1e-30)
        weights = np.maximum(weights / weights.sum(axis=1, keepdims=True), LEAST_WEIGHT)
        np.copyto(self._weights, weights / weights.sum(axis=1, keepdims=True), where=counts)

    def _combine(self) -> None:
        headings = yaw_of(self._q)[:, None] + self._turn
        weights = self._weights
        mean = np.arctan2((weights * np.sin(headings)).sum(axis=1), (weights * np.cos(headings)).sum(axis=1))
        spread = wrap_pi(headings - mean[:, None]) ** 2 + self._covariance[:, :, 2, 2]
        self.heading_rad = mean
        np.copyto(self.variance_rad2, (weights * spread).sum(axis=1), where=self._runs)
