"""How high the vehicle is above what lies below it, by its range finder: dist_bottom of EKF2.

A range below EKF2_MIN_RNG is none: on the ground the height is taken to be that minimum, and just above it
nothing is known. Lag and times are those of a recorded flight (ALTITUDE and DISTANCE_SENSOR at 10 Hz): the
height follows the range 0.13 s late, and without one it lasts 0.45 s while landing, 0.9 s after lifting off.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.parameters import Parameters

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

LAG_S = 0.13
LASTS_S = 0.45
LASTS_FROM_GROUND_S = 0.9


class Terrain:
    """The heights above ground of N vehicles.

    Args:
        count: N.
        dt_s: interval between two updates.
    """

    def __init__(self, count: int, dt_s: float) -> None:
        self._dt_s = dt_s
        self._gain = 1.0 - math.exp(-dt_s / LAG_S)
        self._shortest_m = np.zeros(count)
        self._used = np.ones(count, dtype=np.bool_)
        self._height_m = np.zeros(count)
        self._down_m = np.zeros(count)
        self._lasts_s = np.full(count, -1.0)
        """So long the height is still known; below zero it is not."""

    def configure(self, i: int, parameters: Parameters) -> None:
        """Read EKF2_MIN_RNG and EKF2_RNG_CTRL (0: ranges are not used) of vehicle `i`."""
        self._shortest_m[i] = parameters.usable("EKF2_MIN_RNG")
        self._used[i] = parameters.get("EKF2_RNG_CTRL") != 0

    def reset(self, i: int) -> None:
        """Vehicle `i` knows nothing of the ground."""
        self._lasts_s[i] = -1.0

    def update(
        self, range_m: FloatArray, cos_tilt: FloatArray, in_air: BoolArray, down_m: FloatArray
    ) -> FloatArray:
        """Take ranges (N,) along the body's axis (NaN: none); heights above ground (N,) [m], NaN: unknown.

        Args:
            range_m: what the range finders say.
            cos_tilt: (N,) of the angle between body axis and plumb line.
            in_air: (N,) the land detectors' word.
            down_m: (N,) local down coordinate of the estimates.
        """
        measured = range_m * cos_tilt
        seen = in_air & self._used & (range_m >= self._shortest_m)
        known = self._lasts_s >= 0.0
        sunk = self._height_m - (down_m - self._down_m)
        followed = np.where(known, self._height_m + self._gain * (measured - self._height_m), measured)
        self._height_m = np.where(seen, followed, np.where(in_air, sunk, self._shortest_m))
        self._down_m[:] = down_m
        waited = np.maximum(self._lasts_s - self._dt_s, -1.0)
        self._lasts_s = np.where(seen, LASTS_S, np.where(in_air, waited, LASTS_FROM_GROUND_S))
        return np.where(self._used & (self._lasts_s >= 0.0), np.maximum(self._height_m, 0.0), np.nan)
