"""Heading of N vehicles by the magnetometer: how sure it is, and how far each sample turns it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.frames import rotate, wrap_pi
from vehicle_sim.parameters import Parameters

FloatArray = NDArray[np.float64]


class Heading:
    """One variance a vehicle, grown by gyro noise, shrunk by what is fused (EKF2_MAG_*, EKF2_HEAD_NOISE).

    Args:
        count: N.
        predict_s: interval of the strapdown prediction.
    """

    def __init__(self, count: int, predict_s: float) -> None:
        self._predict_s = predict_s
        self.variance = np.zeros(count)
        """(N,) [rad²]."""
        self._drift_variance = np.zeros(count)
        self._measured_variance = np.ones(count)
        self._gate = np.ones(count)
        self._declination_rad = np.zeros(count)

    def configure(self, i: int, parameters: Parameters) -> None:
        """Read the noise figures of vehicle `i`."""

        def value(name: str) -> float:
            return parameters.usable(name)

        self._drift_variance[i] = value("EKF2_GYR_NOISE") ** 2 * self._predict_s
        self._measured_variance[i] = max(value("EKF2_HEAD_NOISE"), 0.01) ** 2
        self._gate[i] = max(value("EKF2_MAG_GATE"), 1.0)
        if self.variance[i] == 0.0:
            self.reset(i)
        self._declination_rad[i] = math.radians(value("EKF2_MAG_DECL"))

    def reset(self, i: int) -> None:
        """Vehicle `i` starts anew."""
        self.variance[i] = self._measured_variance[i]

    def first_rad(self, i: int, levelled_field: FloatArray) -> float:
        """Heading of vehicle `i` by one field (3,) in a level frame whose x is the nose."""
        north, east, _ = levelled_field
        return self._declination_rad[i] - math.atan2(east, north)

    def fuse(self, matrix: FloatArray, field_frd: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Take a sample (N, 3) seen with these attitudes (N, 3, 3).

        Returns:
            (N,) how far to turn about down [rad], and innovation over gate.
        """
        field = rotate(matrix, field_frd)
        innovation = wrap_pi(self._declination_rad - np.arctan2(field[:, 1], field[:, 0]))
        self.variance += self._drift_variance
        total = self.variance + self._measured_variance
        gain = self.variance / total
        self.variance *= 1.0 - gain
        return gain * innovation, np.abs(innovation) / (self._gate * np.sqrt(total))
