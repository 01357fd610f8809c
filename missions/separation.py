"""How near two vehicles would come if both were stopped now: the distance that a group's guard checks.

The checks of a mission of several vehicles before its start use it too.

The distance now is not enough, because stopping takes room. So both braking distances are included, each with
the vehicle's own deceleration; a formation of equal vehicles in parallel flight keeps its distance. Positions
and velocities are not exact, so the guard adds a margin (`margin_m`). With it the true distance stays above
the minimum, as long as the accuracies that the vehicles report are correct.
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
"""How a multicopter stops when it is sent its current position. Measured with the simulator:
from 2.5 m/s in 3.0 m, from 4.2 m/s in 6.1 m, from 6.6 m/s in 12.8 m; this allows 3.2, 6.9 and 14.1 m."""
STOP_TILT_SHARE = 0.45
"""Share of the acceleration at the vehicle's largest tilt (g tan MPC_TILTMAX_AIR) that brakes it at least: 45
degrees, PX4's default, allow more than `STOP_M_S2`; 10 degrees allow 0.8 m/s²."""
UNSTEERED_SHARE = 0.6
"""Share of that deceleration for a vehicle flown by acceleration, attitude or rates: its velocity and
position controllers restart, in a wind that they have not compensated yet."""
SIGMAS = 2.0
"""Multiple of both estimates' combined accuracy (one sigma). In the simulator the error of the distance had a
sigma of 0.2 m, and the combined reported accuracy was 0.4 m: twice that is four sigma of the error."""
UNKNOWN_ACCURACY_M = 1.0
"""Accuracy of a vehicle that reports none."""
UNSTEADY_M = 0.4
"""Per vehicle: distance that wind and the end of braking add to `STOP_M_S2` and `STOP_DELAY_S`."""
SURPRISE_M_S2 = 1.5
"""How much the velocity may have changed per second since it was received."""
TURNED_AFTER_S = 0.3
"""How long a vehicle flown by attitude or rates keeps accelerating after a stop was sent."""
TREND_S = 0.4
"""Time over which a vehicle's acceleration is measured: shorter times would only measure noise."""
PLANNED_ACCURACY_M, PLANNED_AGE_S = 0.3, 0.1
"""Of each position, for the margin between paths before the flight."""
STEP_S = 0.1
SAMPLES_AT_ONCE = 500
"""Moments whose braking is computed together, which bounds the memory."""
G_M_S2 = 9.81

Vectors = NDArray[np.float64]
"""North, east, down in the last axis; any leading axes."""


@dataclass(frozen=True, slots=True)
class MovingVehicle:
    """Motion of one vehicle for the separation check."""

    place_ned_m: Vector3
    """In the common frame of the group."""
    velocity_ned_m_s: Vector3
    accuracy_m: float
    """Accuracy of the position, one sigma."""
    age_s: float
    """Age of the estimate, over which it was extrapolated with its velocity."""
    brakes_m_s2: float = STOP_M_S2

    @property
    def unsure_m(self) -> float:
        """Position uncertainty without the estimate's accuracy."""
        return UNSTEADY_M + SURPRISE_M_S2 * self.age_s * (self.age_s / 2.0 + STOP_DELAY_S)


class SpeedTrend:
    """How a vehicle's velocity changes; it continues to do so until a stop takes effect."""

    def __init__(self) -> None:
        self._heard: deque[tuple[float, Vector3]] = deque(maxlen=100)

    def add(self, heard_s: float, velocity_ned_m_s: Vector3) -> None:
        """Adds a velocity and its time of reception; one that is not newer is ignored."""
        if self._heard and heard_s <= self._heard[-1][0]:
            return
        self._heard.append((heard_s, velocity_ned_m_s))
        while len(self._heard) > 2 and heard_s - self._heard[1][0] >= TREND_S:
            self._heard.popleft()

    def faster_ned_m_s(self, by_s: float) -> Vector3:
        """The newest velocity, or the one extrapolated by `by_s` seconds if that is faster."""
        (first_s, old), (last_s, new) = self._heard[0], self._heard[-1]
        if last_s - first_s < TREND_S / 2.0:
            return new
        share = by_s / (last_s - first_s)
        n, e, d = (after + share * (after - before) for before, after in zip(old, new, strict=True))
        return (n, e, d) if math.hypot(n, e, d) > math.hypot(*new) else new


def margin_m(a: MovingVehicle, b: MovingVehicle) -> float:
    """Margin added to the minimum between two vehicles: for accuracy and age of both estimates, and for
    wind."""
    return SIGMAS * math.hypot(a.accuracy_m, b.accuracy_m) + a.unsure_m + b.unsure_m


def brakes_m_s2(tilt_rad: float) -> float:
    """Deceleration when the vehicle is stopped, from its largest tilt."""
    if tilt_rad >= math.pi / 4:
        return STOP_M_S2
    return max(0.2, min(STOP_M_S2, STOP_TILT_SHARE * G_M_S2 * math.tan(tilt_rad)))


def stopping_m(speed_m_s: Any, decel_m_s2: float = STOP_M_S2) -> Any:
    """Braking distance from a speed; of one vehicle or several."""
    return speed_m_s * STOP_DELAY_S + speed_m_s**2 / (2.0 * decel_m_s2)


def samples(longest_s: float) -> int:
    """Number of samples of the braking distance, from the longer braking time."""
    return math.ceil((STOP_DELAY_S + longest_s) / STEP_S) + 1


def closest_m(
    place_a: Vectors,
    velocity_a: Vectors,
    place_b: Vectors,
    velocity_b: Vectors,
    decel_a_m_s2: Any = STOP_M_S2,
    decel_b_m_s2: Any = STOP_M_S2,
) -> Vectors:
    """Smallest distance from now until both stand still, if both are stopped now.

    Args:
        place_a: position in the common frame [m].
        velocity_a: [m/s].
        place_b: of the other vehicle.
        velocity_b: of the other vehicle.
        decel_a_m_s2: deceleration; one number, or one per sample.
        decel_b_m_s2: of the other vehicle.
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


def planned_margin_m() -> float:
    """The margin that is expected in flight, for checks before it."""
    still = (0.0, 0.0, 0.0)
    one = MovingVehicle(still, still, PLANNED_ACCURACY_M, PLANNED_AGE_S)
    return margin_m(one, one)


def kept_apart_m(
    place_a: Vectors,
    velocity_a: Vectors,
    place_b: Vectors,
    velocity_b: Vectors,
    least_m: float,
    decel_m_s2: float = STOP_M_S2,
) -> Vectors:
    """The distance at each moment, or what would be left of it if both were stopped then.

    Args:
        place_a: at each moment, in the common frame, (N, 3) [m].
        velocity_a: (N, 3) [m/s].
        place_b: of the other vehicle.
        velocity_b: of the other vehicle.
        least_m: stopping is looked at only where it could leave less than this.
        decel_m_s2: of both.
    """
    kept = _norm(place_a - place_b)
    reach_m = stopping_m(_norm(velocity_a), decel_m_s2) + stopping_m(_norm(velocity_b), decel_m_s2)
    near = np.nonzero(kept - reach_m < least_m)[0]
    for begin in range(0, len(near), SAMPLES_AT_ONCE):
        some = near[begin : begin + SAMPLES_AT_ONCE]
        kept[some] = closest_m(
            place_a[some], velocity_a[some], place_b[some], velocity_b[some], decel_m_s2, decel_m_s2
        )
    return kept


def _way(velocity: Vectors, speed: Vectors, after_s: Vectors, decel_m_s2: Any) -> Vectors:
    decel = np.asarray(decel_m_s2, dtype=float)[..., None]
    braking_s = np.clip(after_s - STOP_DELAY_S, 0.0, speed[..., None] / decel)
    way_m = speed[..., None] * (np.minimum(after_s, STOP_DELAY_S) + braking_s) - decel / 2.0 * braking_s**2
    direction = velocity / np.maximum(speed, 1e-9)[..., None]
    return direction[..., None, :] * way_m[..., None]


def _nearest_on(begin: Vectors, end: Vectors) -> Vectors:
    """Smallest distance from zero to the segments between samples, so that a fast pass is not missed."""
    step = end - begin
    square = np.maximum(np.sum(step * step, axis=-1), 1e-12)
    part = np.clip(-np.sum(begin * step, axis=-1) / square, 0.0, 1.0)
    return _norm(begin + step * part[..., None])


def _norm(vectors: Vectors) -> Any:
    return np.sqrt(np.sum(vectors * vectors, axis=-1))
