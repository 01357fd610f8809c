"""Wind at N vehicles: a steady wind, and gusts as first-order Gauss-Markov noise.

The power of the gusts falls at frequencies above 1 / (2π · correlation time), as in the Dryden model.
Vertical gusts are weaker than horizontal gusts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.noise import NoisePurpose, WhiteNoise

FloatArray = NDArray[np.float64]

CORRELATION_S = 3.0
"""Correlation time of gusts: a turbulence scale of 20 m (MIL-F-8785C near the ground) at about 7 m/s."""
VERTICAL_FRACTION = 0.5


class Wind:
    """The wind at N vehicles.

    Args:
        dt_s: step.
        seed: seed of the gusts.
        vehicles: number of each vehicle, which determines its noise.
    """

    def __init__(self, dt_s: float, *, seed: int, vehicles: Sequence[int]) -> None:
        count = len(vehicles)
        self.steady_ned_m_s = np.zeros((count, 3))
        self._gust_ned_m_s = np.zeros((count, 3))
        self._gust_decay = math.exp(-dt_s / CORRELATION_S)
        """Fraction of a gust that remains after one step."""
        self._noise = WhiteNoise(seed, vehicles, NoisePurpose.GUSTS, 3)
        self._sigma_m_s = np.zeros((count, 3))
        self._has_gusts = False

    def set_gusts(self, sigma_m_s: float, i: int | None = None) -> None:
        """Sets the standard deviation of gusts in each horizontal axis, for vehicle `i` or all; 0 ends the
        gusts.

        Raises:
            ValueError: `sigma_m_s` is negative or not finite.
        """
        if not (math.isfinite(sigma_m_s) and sigma_m_s >= 0.0):
            raise ValueError(f"the gusts' standard deviation is {sigma_m_s} m/s; give 0 or more")
        rows = slice(None) if i is None else i
        self._sigma_m_s[rows] = sigma_m_s * np.array([1.0, 1.0, VERTICAL_FRACTION])
        self._has_gusts = bool(self._sigma_m_s.any())
        if sigma_m_s == 0.0:
            self._gust_ned_m_s[rows] = 0.0

    def step(self) -> FloatArray:
        """Advances the gusts by one step; returns the wind (N, 3) [m/s, NED].

        Also without gusts each step draws one noise sample, so that a vehicle's gusts do not depend on when
        gusts of other vehicles begin.
        """
        noise = self._noise.sample()
        if self._has_gusts:
            self._gust_ned_m_s *= self._gust_decay
            self._gust_ned_m_s += math.sqrt(1.0 - self._gust_decay**2) * noise * self._sigma_m_s
        return self.steady_ned_m_s + self._gust_ned_m_s
