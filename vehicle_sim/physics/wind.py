"""Wind that N vehicles feel: a steady part and gusts, noise with a memory (first-order Gauss-Markov).

Their spectrum falls beyond the correlation time, as the Dryden model's does; vertical gusts are weaker.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

CORRELATION_S = 3.0
"""Of a gust: some 20 m of turbulence scale (MIL-F-8785C near the ground) at 7 m/s."""
VERTICAL_PART = 0.5
_STREAM = 7919
"""Keeps the gusts' generator apart from that of the sensors."""


class Wind:
    """The wind at N vehicles.

    Args:
        count: N.
        dt_s: step.
        seed: of the gusts.
    """

    def __init__(self, count: int, dt_s: float, *, seed: int) -> None:
        self.steady_ned_m_s = np.zeros((count, 3))
        self._gust_ned_m_s = np.zeros((count, 3))
        self._keep = math.exp(-dt_s / CORRELATION_S)
        self._random = np.random.default_rng([_STREAM, seed])
        self._sigma_m_s = np.zeros(3)
        self._gusty = False

    @property
    def gusty(self) -> bool:
        """Whether the wind changes at all."""
        return self._gusty

    def set_gusts(self, sigma_m_s: float) -> None:
        """One sigma of each horizontal axis; 0 ends the gusts.

        Raises:
            ValueError: negative or no number.
        """
        if not (math.isfinite(sigma_m_s) and sigma_m_s >= 0.0):
            raise ValueError(f"gusts are {sigma_m_s} m/s; give a strength of 0 or more")
        self._gusty = sigma_m_s > 0.0
        self._sigma_m_s = sigma_m_s * np.array([1.0, 1.0, VERTICAL_PART])
        if sigma_m_s == 0.0:
            self._gust_ned_m_s[:] = 0.0

    def step(self) -> FloatArray:
        """The wind (N, 3) one step later."""
        noise = self._random.standard_normal(self._gust_ned_m_s.shape) * self._sigma_m_s
        self._gust_ned_m_s *= self._keep
        self._gust_ned_m_s += math.sqrt(1.0 - self._keep**2) * noise
        return self.steady_ned_m_s + self._gust_ned_m_s
