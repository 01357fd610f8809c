"""White noise for N vehicles; each has its own generators, so that no flight depends on other vehicles.

A vehicle's noise depends on the seed, its number and the purpose of the noise, not on the number of vehicles
or processes. Numbers are drawn in blocks, because one call for each vehicle and step would be too slow.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

BLOCK_LENGTH = 64
"""Number of samples that each generator draws together."""


class NoisePurpose(IntEnum):
    """Purpose of a noise stream; part of its seed."""

    IMU = 0
    MAG = 1
    BARO = 2
    GPS = 3
    GUSTS = 4


class WhiteNoise:
    """Standard normal samples for N vehicles.

    Args:
        seed: seed of the fleet, 0 or more.
        vehicles: number of each vehicle, 0 or more.
        purpose: purpose of the noise.
        width: length of a sample.
    """

    def __init__(self, seed: int, vehicles: Sequence[int], purpose: NoisePurpose, width: int) -> None:
        self._generators = [np.random.default_rng([seed, vehicle, int(purpose)]) for vehicle in vehicles]
        self._generated = np.zeros((len(self._generators), BLOCK_LENGTH, width))
        """(N, BLOCK_LENGTH, width) as the generators fill it; `_samples` has the same content by sample."""
        self._samples = np.zeros((BLOCK_LENGTH, len(self._generators), width))
        self._next = BLOCK_LENGTH
        """Index of the next sample in the block."""

    def sample(self) -> FloatArray:
        """The next sample of each vehicle (N, width); valid until the next call."""
        if self._next == BLOCK_LENGTH:
            self._next = 0
            for row, generator in zip(self._generated, self._generators, strict=True):
                generator.standard_normal(out=row)
            np.copyto(self._samples, self._generated.transpose(1, 0, 2))
        self._next += 1
        return self._samples[self._next - 1]
