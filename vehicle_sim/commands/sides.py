"""Detects which side of a vehicle points down, and whether the vehicle is at rest, for calibrations by sides.

As in PX4, the detection uses only the accelerometer: a moving average, a decaying maximum of the deviation
from the average, and a time for which the deviation must be small.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import Enum, auto

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.frames import GRAVITY_M_S2

AVERAGE_S = 0.5
"""Time constant of the moving average and of the decay of the maximum deviation."""
STILL_M_S2 = 0.25
"""A deviation below this value counts as rest, and one above twice this value as motion."""
SIDE_TOLERANCE_M_S2 = 5.0
"""Largest difference of each axis from the reading of a vehicle that lies on a side."""
SMOOTHING_S = 1.0 / (2.0 * math.pi * 30.0)
"""Time constant of the low-pass filter IMU_ACCEL_CUTOFF (30 Hz)."""

FloatArray = NDArray[np.float64]
Vector = tuple[float, float, float]


class Side(Enum):
    """The side of the vehicle that points down, with PX4's names in PX4's order."""

    BACK = "back"
    FRONT = "front"
    LEFT = "left"
    RIGHT = "right"
    UP = "up"
    DOWN = "down"

    @property
    def axis(self) -> int:
        """Index of the vertical body axis (x forward, y right, z down)."""
        return list(Side).index(self) // 2

    @property
    def roll_pitch_rad(self) -> tuple[float, float]:
        """Attitude of a vehicle on this side."""
        return _ATTITUDES[self]

    @property
    def sign(self) -> float:
        """Sign of the reading on the vertical axis at rest: the specific force points up."""
        return 1.0 if self in (Side.BACK, Side.LEFT, Side.UP) else -1.0


_QUARTER = 0.5 * math.pi
_ATTITUDES = {
    Side.BACK: (0.0, _QUARTER), Side.FRONT: (0.0, -_QUARTER), Side.LEFT: (-_QUARTER, 0.0),
    Side.RIGHT: (_QUARTER, 0.0), Side.UP: (math.pi, 0.0), Side.DOWN: (0.0, 0.0),
}  # fmt: skip


class Rest(Enum):
    """What a reading shows: whether the vehicle is at rest."""

    WAIT = auto()
    """No change."""
    BEGAN = auto()
    """The vehicle has come to rest."""
    BROKEN = auto()
    """The vehicle has moved again."""
    STILL = auto()
    """At rest for long enough."""


class RestDetector:
    """Detects a vehicle at rest.

    Args:
        still_s: required duration of rest.
        tolerance: factor on STILL_M_S2.
    """

    def __init__(self, still_s: float, tolerance: float = 1.0) -> None:
        self._still_s = still_s
        self._limit = (tolerance * STILL_M_S2) ** 2
        self._smooth = self._average = (0.0, 0.0, 0.0)
        self._deviation = (0.0, 0.0, 0.0)
        """Squared deviation [m²/s⁴]."""
        self._resting_s: float | None = None

    def feed(self, accel_frd_m_s2: Vector, dt_s: float) -> Rest:
        """Adds a reading, which was taken `dt_s` after the last one."""
        gain, decay = dt_s / (dt_s + SMOOTHING_S), dt_s / AVERAGE_S
        self._smooth = tuple(s + gain * (a - s) for s, a in zip(self._smooth, accel_frd_m_s2, strict=True))
        delta = [s - mean for s, mean in zip(self._smooth, self._average, strict=True)]
        self._average = tuple(mean + decay * each for mean, each in zip(self._average, delta, strict=True))
        self._deviation = tuple(
            max(old * (1.0 - decay), min(each * each, 8.0 * self._limit))
            for old, each in zip(self._deviation, delta, strict=True)
        )
        worst = max(self._deviation)
        if self._resting_s is not None:
            self._resting_s += dt_s
        if worst < self._limit:
            if self._resting_s is None:
                self._resting_s = 0.0
                return Rest.BEGAN
            return Rest.STILL if self._resting_s > self._still_s else Rest.WAIT
        if worst > 4.0 * self._limit and self._resting_s is not None:
            self._resting_s = None
            return Rest.BROKEN
        return Rest.WAIT

    @property
    def side(self) -> Side | None:
        """The side that points down; None if the vehicle is tilted between two sides."""
        for side in Side:
            expected = [0.0, 0.0, 0.0]
            expected[side.axis] = side.sign * GRAVITY_M_S2
            if all(abs(a - b) < SIDE_TOLERANCE_M_S2 for a, b in zip(self._average, expected, strict=True)):
                return side
        return None


def offset_and_scale(sides: Mapping[Side, FloatArray]) -> tuple[FloatArray, FloatArray] | None:
    """Offset and scale of an accelerometer measured on all sides; None: the readings are implausible.

    The offset of an axis is the mean of its two opposite readings. The scales are the diagonal of the matrix
    that maps the three positive readings to gravity.
    """
    positive = [side for side in Side if side.sign > 0.0]
    negative = [side for side in Side if side.sign < 0.0]
    pairs = zip(positive, negative, strict=True)
    offset = np.array([0.5 * (sides[a][a.axis] + sides[b][b.axis]) for a, b in pairs])
    try:
        matrix = np.linalg.inv(np.array([sides[side] - offset for side in positive])) * GRAVITY_M_S2
    except np.linalg.LinAlgError:
        return None
    scale = np.array([float(matrix[k, k]) for k in range(3)])
    return (offset, scale) if bool(np.isfinite(offset).all() and np.isfinite(scale).all()) else None
