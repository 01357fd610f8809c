"""How near two vehicles would come if both were stopped now: what a group keeps apart by.

A distance that is still kept is of no use where it cannot be kept any more, so it is always asked with the
way of braking ahead, each by its own deceleration: a formation of equals that flies in parallel stays as far
apart. What is known of both is not exact, so that the guard adds a margin (`margin_m`): with it the true
distance keeps the minimum, as long as the accuracies that the vehicles report are true.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from missions.frames import Vector3

STOP_M_S2, STOP_DELAY_S = 2.5, 0.8
"""How position setpoints at the place reached stop a multicopter. Measured with the simulator:
from 2.5 m/s in 3.0 m, from 4.2 m/s in 6.1 m, from 6.6 m/s in 12.8 m; this allows 3.2, 6.9 and 14.1 m."""
STOP_TILT_SHARE = 0.45
"""Of the acceleration that the vehicle's largest tilt allows (g tan MPC_TILTMAX_AIR), so much brakes it at
least: 45 degrees, PX4's default, allow more than `STOP_M_S2`; 10 degrees allow 0.8 m/s²."""
UNSTEERED_SHARE = 0.6
"""Flown by acceleration, attitude or rates, it brakes by so much of it: its controllers of speed and place
begin anew, against a wind that they do not know yet."""
SIGMAS = 2.0
"""Of the accuracy (one sigma) of both estimates together. In the simulator the error of the distance had a
sigma of 0.2 m where the reported accuracies together are 0.4 m: twice those are four times the error's."""
UNKNOWN_ACCURACY_M = 1.0
"""Of a vehicle that reports none."""
UNSTEADY_M = 0.4
"""Of each vehicle: what wind and the end of braking move it by beyond `STOP_M_S2` and `STOP_DELAY_S`."""
SURPRISE_M_S2 = 1.5
"""The velocity that was heard may have changed by so much a second since."""
TURNED_AFTER_S = 0.3
"""A vehicle flown by attitude or rates goes on gaining speed for so long after it was told to stop."""
TREND_S = 0.4
"""Over so long a vehicle's acceleration is measured: over less, the noise of its velocity is all there is."""
STEP_S = 0.1
G_M_S2 = 9.81

Vectors = NDArray[np.float64]
"""North, east, down in the last axis; any axes before it."""


@dataclass(frozen=True, slots=True)
class Moving:
    """One vehicle, as it is kept apart from another."""

    place_ned_m: Vector3
    """In a frame common to all."""
    velocity_ned_m_s: Vector3
    accuracy_m: float
    """Of the place, one sigma."""
    age_s: float
    """Of the estimate, over which it was moved on with its velocity."""
    brakes_m_s2: float = STOP_M_S2

    @property
    def unsure_m(self) -> float:
        """By how much it may be elsewhere, its accuracy left out."""
        return UNSTEADY_M + SURPRISE_M_S2 * self.age_s * (self.age_s / 2.0 + STOP_DELAY_S)


class SpeedTrend:
    """How a vehicle's velocity changes, which it goes on doing until a stop takes hold of it."""

    def __init__(self) -> None:
        self._heard: deque[tuple[float, Vector3]] = deque(maxlen=100)

    def add(self, heard_s: float, velocity_ned_m_s: Vector3) -> None:
        """A velocity, and when it was heard; one that is not newer is left out."""
        if self._heard and heard_s <= self._heard[-1][0]:
            return
        self._heard.append((heard_s, velocity_ned_m_s))
        while len(self._heard) > 2 and heard_s - self._heard[1][0] >= TREND_S:
            self._heard.popleft()

    def faster_ned_m_s(self, by_s: float) -> Vector3:
        """The newest velocity, or what becomes of it in `by_s` seconds where that is faster."""
        (first_s, old), (last_s, new) = self._heard[0], self._heard[-1]
        if last_s - first_s < TREND_S / 2.0:
            return new
        share = by_s / (last_s - first_s)
        n, e, d = (after + share * (after - before) for before, after in zip(old, new, strict=True))
        return (n, e, d) if math.hypot(n, e, d) > math.hypot(*new) else new


def margin_m(a: Moving, b: Moving) -> float:
    """What is added to the minimum between two: for both estimates' accuracy and age, and for the wind."""
    return SIGMAS * math.hypot(a.accuracy_m, b.accuracy_m) + a.unsure_m + b.unsure_m


def brakes_m_s2(tilt_rad: float) -> float:
    """How it slows down when it is stopped, by the largest tilt that it allows itself."""
    if tilt_rad >= math.pi / 4:
        return STOP_M_S2
    return max(0.2, min(STOP_M_S2, STOP_TILT_SHARE * G_M_S2 * math.tan(tilt_rad)))


def stopping_m(speed_m_s: Any, decel_m_s2: float = STOP_M_S2) -> Any:
    """The way from a speed to standing; of one or of several."""
    return speed_m_s * STOP_DELAY_S + speed_m_s**2 / (2.0 * decel_m_s2)


def samples(longest_s: float) -> int:
    """At how many moments the way of braking is looked at, where the longer one takes so long."""
    return math.ceil((STOP_DELAY_S + longest_s) / STEP_S) + 1


def closest_m(
    place_a: Vectors,
    velocity_a: Vectors,
    place_b: Vectors,
    velocity_b: Vectors,
    decel_a_m_s2: Any = STOP_M_S2,
    decel_b_m_s2: Any = STOP_M_S2,
) -> Vectors:
    """The smallest distance from now until both stand, should both be stopped now.

    Args:
        place_a: in a frame common to both [m].
        velocity_a: [m/s].
        place_b: of the other.
        velocity_b: of the other.
        decel_a_m_s2: how it slows down; a number, or one for each.
        decel_b_m_s2: of the other.
    """
    speed_a, speed_b = _norm(velocity_a), _norm(velocity_b)
    longest_s = max(float(np.max(speed_a / decel_a_m_s2)), float(np.max(speed_b / decel_b_m_s2)))
    long_s = STOP_DELAY_S + longest_s
    after_s = np.linspace(0.0, long_s, samples(longest_s))
    apart = (
        (place_a - place_b)[..., None, :]
        + _way(velocity_a, speed_a, after_s, decel_a_m_s2)
        - _way(velocity_b, speed_b, after_s, decel_b_m_s2)
    )
    return np.min(_nearest_on(apart[..., :-1, :], apart[..., 1:, :]), axis=-1)


def _way(velocity: Vectors, speed: Vectors, after_s: Vectors, decel_m_s2: Any) -> Vectors:
    decel = np.asarray(decel_m_s2, dtype=float)[..., None]
    braking_s = np.clip(after_s - STOP_DELAY_S, 0.0, speed[..., None] / decel)
    way_m = speed[..., None] * (np.minimum(after_s, STOP_DELAY_S) + braking_s) - decel / 2.0 * braking_s**2
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
