"""The fastest changes of speed with limited acceleration and jerk. The acceleration is zero at both ends.

A change by Δ takes Δ / A + A / J if the acceleration A is reached (Δ ≥ A² / J), otherwise 2 √(Δ / J). The
speed is symmetric about the middle, so the distance is mean speed · time. Lengths may have any unit.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
MIN_ACCELERATION = 1e-9
"""Accelerations below this count as zero [1/s²]."""


def reachable_speed(speed: float, length: float, acceleration: float, jerk: float) -> float:
    """The highest speed that can be reached over a distance, starting with `speed`."""
    if acceleration < MIN_ACCELERATION:
        return speed
    full_change = acceleration * acceleration / jerk  # the smallest change that reaches the acceleration
    time_s = 2.0 * acceleration / jerk
    if (speed + 0.5 * full_change) * time_s >= length:
        # The acceleration is not reached: x³ + 2 v x = L √J, x² = Δ.
        return speed + _root(2.0 * speed, length * math.sqrt(jerk)) ** 2
    # The acceleration is reached: (v + Δ/2)(Δ/A + A/J) = L.
    b = speed + 0.5 * full_change
    c = speed * full_change - length * acceleration
    return speed + (-b + math.sqrt(max(0.0, b * b - 2.0 * c)))


def _root(p: float, q: float) -> float:
    """The root of x³ + p x = q for p, q ≥ 0."""
    if q <= 0.0:
        return 0.0
    if p <= 1e-12 * q ** (2.0 / 3.0):
        return q ** (1.0 / 3.0)
    scale = 2.0 * math.sqrt(p / 3.0)
    return scale * math.sinh(math.asinh(3.0 * q / (p * scale)) / 3.0)


def lengths(start: Array, end: Array, acceleration: Array, jerk: Array) -> Array:
    """Distance needed for each change of speed, (N,)."""
    return 0.5 * (start + end) * durations(np.abs(end - start), acceleration, jerk)


def durations(change: Array, acceleration: Array, jerk: Array) -> Array:
    """Time needed for each change of speed [s], (N,)."""
    a = np.maximum(acceleration, MIN_ACCELERATION)
    return np.where(change * jerk >= a * a, change / a + a / jerk, 2.0 * np.sqrt(change / jerk))


def phase_durations(change: Array, acceleration: Array, jerk: Array) -> tuple[Array, Array]:
    """Durations of each phase with jerk and of the phase at full acceleration between them [s], (N,) each."""
    a = np.maximum(acceleration, MIN_ACCELERATION)
    is_reached = change * jerk >= a * a
    jerk_s = np.where(is_reached, a / jerk, np.sqrt(change / jerk))
    return jerk_s, np.where(is_reached, np.maximum(change / a - a / jerk, 0.0), 0.0)
