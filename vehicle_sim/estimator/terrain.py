"""Height above ground from the range finder: dist_bottom of EKF2.

A range below EKF2_MIN_RNG is ignored. On the ground the height is EKF2_MIN_RNG. In the air the height follows
the range with a time constant of 0.13 s. Without a range the height stays valid for 0.45 s, after lift-off
for 0.9 s. The three times come from a recorded flight (ALTITUDE and DISTANCE_SENSOR at 10 Hz).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.parameters import Parameters

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

LAG_S = 0.13
VALID_FOR_S = 0.45
VALID_FROM_GROUND_S = 0.9
"""Times for which the height stays valid: after a range, and after lift-off."""


class Terrain:
    """The heights above ground of N vehicles.

    Args:
        count: N.
        dt_s: interval between two updates.
    """

    def __init__(self, count: int, dt_s: float) -> None:
        self._dt_s = dt_s
        self._gain = 1.0 - math.exp(-dt_s / LAG_S)
        self._min_range_m = np.zeros(count)
        self._enabled = np.ones(count, dtype=np.bool_)
        self._height_m = np.zeros(count)
        self._down_m = np.zeros(count)
        self._remaining_s = np.full(count, -1.0)
        """Remaining time of validity of the height; negative: unknown."""

    def configure(self, i: int, parameters: Parameters) -> None:
        """Reads EKF2_MIN_RNG and EKF2_RNG_CTRL (0: ranges are not used) of vehicle `i`."""
        self._min_range_m[i] = parameters.finite_value("EKF2_MIN_RNG")
        self._enabled[i] = parameters.get("EKF2_RNG_CTRL") != 0

    def update(
        self, range_m: FloatArray, cos_tilt: FloatArray, in_air: BoolArray, down_m: FloatArray
    ) -> FloatArray:
        """Processes ranges; returns heights above ground (N,) [m], NaN: unknown.

        Args:
            range_m: (N,) ranges along the body's down axis; NaN: no measurement.
            cos_tilt: (N,) cosine of the angle between the body's down axis and the vertical.
            in_air: (N,) state of the land detectors.
            down_m: (N,) estimated position down.
        """
        measured = range_m * cos_tilt
        is_valid = in_air & self._enabled & (range_m >= self._min_range_m)
        is_known = self._remaining_s >= 0.0
        predicted = self._height_m - (down_m - self._down_m)
        filtered = np.where(is_known, self._height_m + self._gain * (measured - self._height_m), measured)
        self._height_m = np.where(is_valid, filtered, np.where(in_air, predicted, self._min_range_m))
        self._down_m[:] = down_m
        unrenewed_s = np.maximum(self._remaining_s - self._dt_s, -1.0)
        without_range_s = np.where(in_air, unrenewed_s, VALID_FROM_GROUND_S)
        self._remaining_s = np.where(is_valid, VALID_FOR_S, without_range_s)
        return np.where(self._enabled & (self._remaining_s >= 0.0), np.maximum(self._height_m, 0.0), np.nan)
