"""Filtered body rates for the rate controller: PX4's low-pass filter and derivative as one matrix product.

A second-order Butterworth low-pass (IMU_GYRO_CUTOFF) filters the rates. The difference of two filtered rates
passes a first-order low-pass (IMU_DGYRO_CUTOFF). Both filters together are one 5 x 5 matrix for each vehicle.
A cutoff of zero disables a filter; a cutoff of half the sample rate or more disables the first filter.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.kernels import Blocks, Rows, kernel

FloatArray = NDArray[np.float64]

_INPUT, _DELAY_1, _DELAY_2, _OUTPUT, _DERIVATIVE = range(5)
"""Indices in the state of one axis."""


class GyroFilter:
    """Filters of N vehicles.

    Args:
        count: N.
        dt_s: sample interval.
    """

    def __init__(self, count: int, dt_s: float) -> None:
        self._dt_s = dt_s
        self._matrix = np.zeros((count, 5, 5))
        self._state = np.zeros((count, 3, 5))
        for i in range(count):
            self.configure(i, 0.0, 0.0)

    def configure(self, i: int, cutoff_hz: float, derivative_cutoff_hz: float) -> None:
        """Sets both cutoffs of vehicle `i`; the filter keeps its state."""
        b, a = _butterworth(cutoff_hz, 1.0 / self._dt_s)
        alpha = 1.0
        if derivative_cutoff_hz > 0.0:
            alpha = self._dt_s / (self._dt_s + 1.0 / (2.0 * math.pi * derivative_cutoff_hz))
        matrix = self._matrix[i]
        matrix[:] = 0.0
        matrix[_INPUT, _DELAY_1] = 1.0
        matrix[_DELAY_1, _DELAY_1] = -a[0]
        matrix[_DELAY_2, _DELAY_1] = -a[1]
        matrix[_DELAY_1, _DELAY_2] = 1.0
        matrix[_INPUT, _OUTPUT] = b[0]
        matrix[_DELAY_1, _OUTPUT] = b[1] - b[0] * a[0]
        matrix[_DELAY_2, _OUTPUT] = b[2] - b[0] * a[1]
        matrix[:, _DERIVATIVE] = (alpha / self._dt_s) * matrix[:, _OUTPUT]
        matrix[_OUTPUT, _DERIVATIVE] -= alpha / self._dt_s
        matrix[_DERIVATIVE, _DERIVATIVE] = 1.0 - alpha

    def update(self, gyro_frd_rad_s: FloatArray, rates_out: FloatArray, acceleration_out: FloatArray) -> None:
        """Filters samples (N, 3); writes filtered rates and angular accelerations (N, 3)."""
        _filter(gyro_frd_rad_s, self._matrix, self._state, rates_out, acceleration_out)


def _butterworth(
    cutoff_hz: float, sample_hz: float
) -> tuple[tuple[float, float, float], tuple[float, float]]:
    """Numerator and denominator (without the leading 1) of a second-order low-pass, by bilinear transform."""
    if not 0.0 < cutoff_hz < 0.5 * sample_hz:
        return (1.0, 0.0, 0.0), (0.0, 0.0)
    omega = math.tan(math.pi * cutoff_hz / sample_hz)
    scale = 1.0 + math.sqrt(2.0) * omega + omega * omega
    gain = omega * omega / scale
    return (gain, 2.0 * gain, gain), (
        2.0 * (omega * omega - 1.0) / scale,
        (1.0 - math.sqrt(2.0) * omega + omega * omega) / scale,
    )


@kernel
def _filter(gyro: Rows, matrix: Blocks, state: Blocks, rates: Rows, acceleration: Rows) -> None:
    for i in range(gyro.shape[0]):
        for axis in range(3):
            values = state[i, axis]
            values[_INPUT] = gyro[i, axis]
            delay_1 = delay_2 = output = derivative = 0.0
            for k in range(5):
                delay_1 += values[k] * matrix[i, k, _DELAY_1]
                delay_2 += values[k] * matrix[i, k, _DELAY_2]
                output += values[k] * matrix[i, k, _OUTPUT]
                derivative += values[k] * matrix[i, k, _DERIVATIVE]
            values[_DELAY_1], values[_DELAY_2], values[_OUTPUT], values[_DERIVATIVE] = (
                delay_1,
                delay_2,
                output,
                derivative,
            )
            rates[i, axis], acceleration[i, axis] = output, derivative
