"""Kalman filters of position, velocity and accelerometer error, one for each axis of N vehicles.

The third state is what the measured acceleration is wrong by: on the horizontal axes that is a tilt error
(the estimator turns its attitude by it at once), on the vertical axis an accelerometer bias. Noise figures
are PX4's EKF2_* parameters, so accuracies come out as PX4 reports them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.frames import GRAVITY_M_S2
from vehicle_sim.parameters import Parameters

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_PREDICTION_INTERVAL_S = 0.008
"""PX4 adds its process noise once a filter step; this makes it a density."""

_ACCEL_SHARE = 4.0
_TILT_SHARE = 3.0
"""Fitted: with these the reported accuracy (0.28 and 0.29 m) and a hover's wander are the recordings'."""

POSITION, VELOCITY, ERROR = range(3)


class Channels:
    """State (N, 3 axes, 3) and covariance (N, 3 axes, 3, 3)."""

    def __init__(self, count: int) -> None:
        self.state = np.zeros((count, 3, 3))
        self.covariance = np.zeros((count, 3, 3, 3))
        self._start_covariance = np.zeros((count, 3, 3, 3))
        self._density = np.zeros((count, 3, 3))

    def configure(self, i: int, parameters: Parameters) -> None:
        """Read the noise figures of vehicle `i`."""

        def value(name: str) -> float:
            return parameters.usable(name)

        accel = _ACCEL_SHARE * value("EKF2_ACC_NOISE") ** 2 * _PREDICTION_INTERVAL_S
        tilt = _TILT_SHARE * (GRAVITY_M_S2 * value("EKF2_GYR_NOISE")) ** 2 * _PREDICTION_INTERVAL_S
        bias = value("EKF2_ACC_B_NOISE") ** 2 * _PREDICTION_INTERVAL_S
        self._density[i] = [[0.0, accel, tilt], [0.0, accel, tilt], [0.0, accel, bias]]
        tilt_start = (GRAVITY_M_S2 * value("EKF2_ANGERR_INIT")) ** 2
        bias_start = value("EKF2_ABIAS_INIT") ** 2
        start = self._start_covariance[i]
        start[:] = 0.0
        for axis, error in enumerate((tilt_start, tilt_start, bias_start)):
            start[axis] = np.diag([0.25, 0.25, error])
        if not self.covariance[i].any():
            self.reset(i)

    def reset(self, i: int) -> None:
        """Vehicle `i` knows nothing but that it stands."""
        self.state[i] = 0.0
        self.covariance[i] = self._start_covariance[i]

    def reset_motion(
        self,
        mask: BoolArray,
        position_m: FloatArray,
        velocity_m_s: FloatArray,
        position_variance: FloatArray,
        velocity_variance: FloatArray,
    ) -> None:
        """Take measured position and velocity (N, 3) as they are for the vehicles in `mask`."""
        self.state[mask, :, POSITION] = position_m[mask]
        self.state[mask, :, VELOCITY] = velocity_m_s[mask]
        for row, variance in ((POSITION, position_variance), (VELOCITY, velocity_variance)):
            self.covariance[mask, :, row, :] = 0.0
            self.covariance[mask, :, :, row] = 0.0
            self.covariance[mask, :, row, row] = variance[mask]

    def predict_covariance(self, dt_s: float) -> None:
        """Grow the uncertainty over `dt_s`; the states are predicted by the estimator itself."""
        step = np.array([[1.0, dt_s, -0.5 * dt_s * dt_s], [0.0, 1.0, -dt_s], [0.0, 0.0, 1.0]])
        self.covariance = step @ self.covariance @ step.T
        diagonal = np.einsum("naii->nai", self.covariance)
        diagonal += self._density * dt_s

    def fuse(
        self, row: int, innovation: FloatArray, variance: FloatArray, axes: slice = slice(0, 3)
    ) -> FloatArray:
        """Fuse a measurement of state `row` on some axes.

        Args:
            row: POSITION or VELOCITY.
            innovation: (N, axes) measured minus believed.
            variance: (N, axes) of the measurement; infinite leaves the state alone.
            axes: which axes.

        Returns:
            Innovation variance (N, axes).
        """
        covariance = self.covariance[:, axes]
        total = covariance[:, :, row, row] + variance
        gain = covariance[:, :, :, row] / total[:, :, None]
        self.state[:, axes] += gain * innovation[:, :, None]
        self.covariance[:, axes] = covariance - gain[:, :, :, None] * covariance[:, :, row, None, :]
        return total
