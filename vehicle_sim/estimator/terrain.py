"""Height above ground from the range finder: dist_bottom of EKF2.

A range below EKF2_MIN_RNG is invalid: on the ground the height is that minimum, and just above ground the
height is unknown. Lag and times come from a recorded flight (ALTITUDE and DISTANCE_SENSOR at 10 Hz). The
height follows the range 0.13 s late. Without a range the height stays valid for 0.45 s while landing, and for
0.9 s after lift-off.
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
        self._used = np.ones(count, dtype=np.bool_)
        self._height_m = np.zeros(count)
        self._down_m = np.zeros(count)
        self._valid_for_s = np.full(count, -1.0)
        """Remaining time of validity of the height; negative: unknown."""

    def configure(self, i: int, parameters: Parameters) -> None:
        """Reads EKF2_MIN_RNG and EKF2_RNG_CTRL (0: ranges are not used) of vehicle `i`."""
        self._min_range_m[i] = parameters.finite_value("EKF2_MIN_RNG")
        self._used[i] = parameters.get("EKF2_RNG_CTRL") != 0

    def reset(self, i: int) -> None:
        """Makes the height above ground of vehicle `i` unknown."""
        self._valid_for_s[i] = -1.0

    def update(
        self, range_m: FloatArray, cos_tilt: FloatArray, in_air: BoolArray, down_m: FloatArray
    ) -> FloatArray:
        """Processes ranges; returns heights above ground (N,) [m], NaN: unknown.

        Args:
            range_m: (N,) ranges along the body's down axis; NaN: no measurement.
            cos_tilt: (N,) cosine of the angle between body axis and vertical.
            in_air: (N,) state of the land detectors.
            down_m: (N,) estimated position down.
        """
        measured = range_m * cos_tilt
        valid = in_air & self._used & (range_m >= self._min_range_m)
        known = self._valid_for_s >= 0.0
        predicted = self._height_m - (down_m - self._down_m)
        filtered = np.where(known, self._height_m + self._gain * (measured - self._height_m), measured)
        self._height_m = np.where(valid, filtered, np.where(in_air, predicted, self._min_range_m))
        self._down_m[:] = down_m
        remaining_s = np.maximum(self._valid_for_s - self._dt_s, -1.0)
        self._valid_for_s = np.where(valid, VALID_FOR_S, np.where(in_air, remaining_s, VALID_FROM_GROUND_S))
        return np.where(self._used & (self._valid_for_s >= 0.0), np.maximum(self._height_m, 0.0), np.nan)
