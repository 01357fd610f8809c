"""The downward range finder of PX4's simulation, along the body's down axis (SIH_DISTSNSR_*)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.parameters import Parameters

FloatArray = NDArray[np.float64]


class RangeFinder:
    """The range finders of N vehicles."""

    def __init__(self, count: int) -> None:
        self._override_m = np.full(count, -1.0)
        """(N,) distance that replaces the true distance; negative: no replacement."""
        self._min_m = np.zeros(count)
        self._max_m = np.full(count, np.inf)

    def configure(self, i: int, parameters: Parameters) -> None:
        """Reads SIH_DISTSNSR_OVR, _MIN and _MAX of vehicle `i`."""
        self._override_m[i] = parameters.finite_value("SIH_DISTSNSR_OVR")
        self._min_m[i] = parameters.finite_value("SIH_DISTSNSR_MIN")
        self._max_m[i] = parameters.finite_value("SIH_DISTSNSR_MAX")

    def measure_m(self, distance_m: FloatArray) -> FloatArray:
        """Measured distances (N,) for true distances (N,); NaN: out of range."""
        measured = np.where(self._override_m >= 0.0, self._override_m, distance_m)
        return np.where((measured >= self._min_m) & (measured <= self._max_m), measured, np.nan)
