"""The heading by GNSS velocity alone: five hypotheses a vehicle, weighed by how well each explains it.

PX4's second opinion (EKF-GSF), which knows no magnetometer: one attitude levelled by the accelerometer is
turned to five headings; each integrates its own velocity and learns its heading from the fixes. Where the
main filter goes on refusing velocities and this heading is another one, the main filter is reset to it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.frames import GRAVITY_M_S2, rotation_matrix, wrap_pi, yaw_of
from vehicle_sim.kernels import Blocks, Rows, kernel
from vehicle_sim.rotations import length, rotated, turn, within, write_matrix

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
_NOISE_PER_S = np.square([[[ACCEL_NOISE_M_S2]], [[ACCEL_NOISE_M_S2]], [[GYRO_NOISE_RAD_S]]]) * NOISE_STEP_S
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
        self._gained = np.zeros((count, 3))
        self._waited_s = 0.0
        self._runs = np.zeros(count, dtype=np.bool_)
        self._states = np.zeros((3, count, HYPOTHESES))
        """Velocity north and east, and the turn from the levelled attitude's heading to the hypothesis'."""
        self._covariance = np.zeros((3, 3, count, HYPOTHESES))
        self._variances = np.einsum("kkno->kno", self._covariance)
        """(3, N, 5) a view of it."""
        self._weights = np.full((count, HYPOTHESES), 1.0 / HYPOTHESES)

    def reset(self, i: int) -> None:
        """Vehicle `i` starts anew."""
        self._bias[i] = 0.0
        self._stop(np.arange(len(self._runs)) == i)

    def _stop(self, who: BoolArray) -> None:
        """Level and turn as the main filter, no hypothesis running."""
        np.copyto(self._q, self._main, where=who[:, None])
        self._matrix[:] = rotation_matrix(self._q)
        self._runs &= ~who

    def predict(self, delta_angle: FloatArray, delta_velocity: FloatArray, dt_s: float) -> None:
        """Turn and level the attitudes, and remember what velocity was gained.

        Args:
            delta_angle: (N, 3) the body's turn by the gyroscopes [rad] since the last call.
            delta_velocity: (N, 3) its gain of velocity by the accelerometers [m/s].
            dt_s: time since then.
        """
        _turn_and_level(
            dt_s, delta_angle, delta_velocity, self._bias, self._force, self._gained, self._q, self._matrix
        )
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

    def _start(self, new: BoolArray, velocity_ne: FloatArray, variance: FloatArray) -> None:
        self._stop(new)
        self._runs |= new
        self._weights[new] = 1.0 / HYPOTHESES
        self._states[:2, new] = velocity_ne[new].T[:, :, None]
        self._states[2, new] = _CIRCLE
        self._covariance[:, :, new] = 0.0
        self._variances[:2, new] = variance[new][:, None]
        self._variances[2, new] = (math.pi / HYPOTHESES) ** 2

    def _advance(self, dt_s: float) -> None:
        """Each hypothesis gains the velocity as its heading turns it."""
        turn, covariance = self._states[2], self._covariance
        cosine, sine = np.cos(turn), np.sin(turn)
        forward, right = self._gained[:, :1], self._gained[:, 1:2]
        north, east = cosine * forward - sine * right, sine * forward + cosine * right
        self._states[0] += north
        self._states[1] += east
        self._gained.fill(0.0)
        for axis, lean in ((0, -east), (1, north)):
            covariance[axis] += lean * covariance[2]
            covariance[:, axis] += lean * covariance[:, 2]
        self._variances += _NOISE_PER_S * dt_s

    def _weigh(self, taken: BoolArray, velocity_ne: FloatArray, variance: FloatArray) -> None:
        """Correct each hypothesis by the velocity, and believe it as far as it had foreseen it."""
        covariance, counts = self._covariance, taken[:, None]
        noise = np.where(taken, variance, 1.0)[:, None]
        (nn, ee), ne = self._variances[:2] + noise, covariance[0, 1].copy()
        determinant = np.maximum(nn * ee - ne * ne, 1e-12)
        off = velocity_ne.T[:, :, None] - self._states[:2]
        north, east = off
        ratio = (ee * north * north - 2.0 * ne * north * east + nn * east * east) / determinant
        off *= np.sqrt(np.minimum(WORST_RATIO / np.maximum(ratio, 1e-9), 1.0))
        seen = covariance[:, :2] * counts
        by_north = (seen[:, 0] * ee - seen[:, 1] * ne) / determinant
        by_east = (seen[:, 1] * nn - seen[:, 0] * ne) / determinant
        self._states += by_north * north + by_east * east
        for gain, column in ((by_north, seen[:, 0]), (by_east, seen[:, 1])):
            covariance -= gain[:, None] * column
        density = np.exp(-0.5 * np.minimum(ratio, WORST_RATIO)) / np.sqrt(determinant)
        weights = np.maximum(self._weights * density, 1e-30)
        weights = np.maximum(weights / weights.sum(axis=1, keepdims=True), LEAST_WEIGHT)
        np.copyto(self._weights, weights / weights.sum(axis=1, keepdims=True), where=counts)

    def headings(self) -> tuple[FloatArray, FloatArray]:
        """(N,) what the hypotheses come to [rad], and its variance [rad2]; infinite: none run."""
        headings = yaw_of(self._q)[:, None] + self._states[2]
        weights = self._weights
        mean = np.arctan2((weights * np.sin(headings)).sum(axis=1), (weights * np.cos(headings)).sum(axis=1))
        spread = wrap_pi(headings - mean[:, None]) ** 2 + self._variances[2]
        return mean, np.where(self._runs, (weights * spread).sum(axis=1), np.inf)


@kernel
def _turn_and_level(
    dt_s: float, delta_angle: Rows, delta_velocity: Rows, bias: Rows, force: Rows, gained: Rows, q: Rows,
    matrix: Blocks,
) -> None:  # fmt: skip
    share = min(1.0, FORCE_SMOOTHING_PER_S * dt_s)
    for i in range(q.shape[0]):
        for k in range(3):
            force[i, k] += share * (delta_velocity[i, k] / dt_s - force[i, k])
        fx, fy, fz = force[i, 0], force[i, 1], force[i, 2]
        rx, ry, rz = (
            delta_angle[i, 0] / dt_s - bias[i, 0],
            delta_angle[i, 1] / dt_s - bias[i, 1],
            delta_angle[i, 2] / dt_s - bias[i, 2],
        )
        size = length(fx, fy, fz)
        off = min(FORCE_ATTENUATION * abs(size / GRAVITY_M_S2 - 1.0), 1.0)
        gain = TILT_GAIN_PER_S * (1.0 - off) ** 2 / max(size, 1.0)
        down_x, down_y, down_z = matrix[i, 2, 0], matrix[i, 2, 1], matrix[i, 2, 2]
        correction = (
            gain * (down_y * fz - down_z * fy),
            gain * (down_z * fx - down_x * fz),
            gain * (down_x * fy - down_y * fx),
        )
        learned = BIAS_GAIN_PER_S * dt_s if length(rx, ry, rz) < SLOW_RAD_S else 0.0
        gain_ned = rotated(matrix[i], delta_velocity[i, 0], delta_velocity[i, 1], delta_velocity[i, 2])
        for k in range(3):
            bias[i, k] = within(bias[i, k] - learned * correction[k], -BIAS_LIMIT_RAD_S, BIAS_LIMIT_RAD_S)
            gained[i, k] += gain_ned[k]
        turn(
            q[i],
            (rx + correction[0]) * dt_s,
            (ry + correction[1]) * dt_s,
            (rz + correction[2]) * dt_s,
        )
        write_matrix(q[i], matrix[i])
