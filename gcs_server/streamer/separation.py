"""How near two vehicles would come if both were stopped now: what a group keeps apart by.

A distance that is still kept is of no use where it cannot be kept any more, so it is always asked with the
way of braking ahead. Both brake alike here: a formation that flies in parallel stays as far apart.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

STOP_M_S2, STOP_DELAY_S = 2.5, 0.8
"""How position setpoints at the place reached stop a multicopter. Measured with the simulator:
from 2.5 m/s in 3.0 m, from 4.2 m/s in 6.1 m, from 6.6 m/s in 12.8 m; this allows 3.2, 6.9 and 14.1 m."""
STEP_S = 0.1

Vectors = NDArray[np.float64]
"""North, east, down in the last axis; any axes before it."""


def stopping_m(speed_m_s: float) -> float:
    """The way from a speed to standing."""
    return speed_m_s * STOP_DELAY_S + speed_m_s**2 / (2.0 * STOP_M_S2)


def closest_m(place_a: Vectors, velocity_a: Vectors, place_b: Vectors, velocity_b: Vectors) -> Vectors:
    """The smallest distance from now until both stand, should both be stopped now.

    Args:
        place_a: in a frame common to both [m].
        velocity_a: [m/s].
        place_b: of the other.
        velocity_b: of the other.
    """
    speed_a, speed_b = _norm(velocity_a), _norm(velocity_b)
    fastest = float(max(np.max(speed_a), np.max(speed_b)))
    long_s = STOP_DELAY_S + fastest / STOP_M_S2
    after_s = np.linspace(0.0, long_s, math.ceil(long_s / STEP_S) + 1)
    apart = (
        (place_a - place_b)[..., None, :]
        + _way(velocity_a, speed_a, after_s)
        - _way(velocity_b, speed_b, after_s)
    )
    return np.min(_nearest_on(apart[..., :-1, :], apart[..., 1:, :]), axis=-1)


def _way(velocity: Vectors, speed: Vectors, after_s: Vectors) -> Vectors:
    braking_s = np.clip(after_s - STOP_DELAY_S, 0.0, speed[..., None] / STOP_M_S2)
    way_m = (
        speed[..., None] * (np.minimum(after_s, STOP_DELAY_S) + braking_s) - STOP_M_S2 / 2.0 * braking_s**2
    )
    direction = velocity / np.maximum(speed, 1e-9)[..., None]
    return direction[..., None, :] * way_m[..., None]


def _nearest_on(begin: Vectors, end: Vectors) -> Vectors:
    """From zero to the straight pieces between: a fast pass is not missed between two samples."""
    step = end - begin
    square = np.maximum(np.sum(step * step, axis=-1), 1e-12)
    part = np.clip(-np.sum(begin * step, axis=-1) / square, 0.0, 1.0)
    return _norm(begin + step * part[..., None])


def _norm(vectors: Vectors) -> Any:
    return np.sqrt(np.sum(vectors * vectors, axis=-1))
