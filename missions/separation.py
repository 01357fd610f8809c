"""The smallest distance between two vehicles if both started to brake now. The separation guard checks
this distance.

The pre-flight checks of a mission of several vehicles use the same calculation. Braking takes distance, so
both braking paths are included, each with the vehicle's own deceleration. A formation of equal vehicles in
parallel flight keeps its distance. Positions and velocities are not exact, so the guard adds a margin
(`margin_m`). With this margin the true distance stays above the minimum, provided that the reported
accuracies are correct.
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
"""Deceleration and delay of a multicopter that is commanded to hold its current position. In the simulator
the vehicle stopped within 3.0 m from 2.5 m/s, 6.1 m from 4.2 m/s and 12.8 m from 6.6 m/s. This deceleration
and delay give 3.2, 6.9 and 14.1 m."""
STOP_TILT_SHARE = 0.45
"""Fraction of the acceleration at maximum tilt (g tan MPC_TILTMAX_AIR) that is always available for braking.
PX4's default of 45 degrees gives more than `STOP_M_S2`; 10 degrees give 0.8 m/s²."""
NO_POSITION_CONTROL_SHARE = 0.6
"""Fraction of the deceleration that is available to a vehicle flown by acceleration, attitude or rates. Its
velocity and position controllers have to restart and do not compensate the wind yet."""
SIGMAS = 2.0
"""Factor for the combined accuracy of both estimates (one sigma). In the simulator the combined reported
accuracy was 0.4 m, and the standard deviation of the distance error was 0.2 m. The factor 2 gives 0.8 m,
which is four standard deviations."""
UNKNOWN_ACCURACY_M = 1.0
"""Assumed accuracy of a vehicle that does not report its accuracy."""
EXTRA_BRAKING_M = 0.4
"""Additional braking distance of each vehicle, because of wind and of the last phase of braking."""
UNKNOWN_ACCELERATION_M_S2 = 1.5
"""Assumed acceleration of a vehicle since its estimate was received."""
LEVEL_AFTER_S = 0.3
"""Time from a stop until a vehicle flown by attitude or rates is level; until then it may accelerate."""
TREND_S = 0.4
"""Time over which a vehicle's acceleration is measured [s]; over a shorter time noise dominates."""
PLANNED_ACCURACY_M, PLANNED_AGE_S = 0.3, 0.1
"""Assumed accuracy and age of each position, for checks before the flight."""
STEP_S = 0.1
"""Time between two samples of the braking paths."""
SAMPLES_AT_ONCE = 500
"""Number of samples computed together, which limits the memory."""
G_M_S2 = 9.81

Vectors = NDArray[np.float64]
"""North, east, down on the last axis; any leading axes."""


@dataclass(frozen=True, slots=True)
class MovingVehicle:
    """Motion of one vehicle for the separation check."""

    position_ned_m: Vector3
    """Position in the common frame of the group."""
    velocity_ned_m_s: Vector3
    accuracy_m: float
    """Accuracy of the position, one sigma."""
    age_s: float
    """Age of the estimate; the position was extrapolated over this time with the velocity."""
    decel_m_s2: float = STOP_M_S2

    @property
    def wind_and_age_margin_m(self) -> float:
        """Part of the margin for wind and for the age of the estimate."""
        return EXTRA_BRAKING_M + UNKNOWN_ACCELERATION_M_S2 * self.age_s * (self.age_s / 2.0 + STOP_DELAY_S)


class VelocityTrend:
    """Extrapolates a vehicle's velocity to the time at which a stop takes effect."""

    def __init__(self) -> None:
        self._samples: deque[tuple[float, Vector3]] = deque(maxlen=100)

    def add(self, received_s: float, velocity_ned_m_s: Vector3) -> None:
        """Adds a velocity with its time of reception; a velocity that is not newer is ignored."""
        if self._samples and received_s <= self._samples[-1][0]:
            return
        self._samples.append((received_s, velocity_ned_m_s))
        while len(self._samples) > 2 and received_s - self._samples[1][0] >= TREND_S:
            self._samples.popleft()

    def extrapolated_ned_m_s(self, by_s: float) -> Vector3:
        """The extrapolated velocity in `by_s` seconds if it is faster than the newest velocity, otherwise the
        newest velocity."""
        (first_s, old_velocity), (last_s, new_velocity) = self._samples[0], self._samples[-1]
        if last_s - first_s < TREND_S / 2.0:
            return new_velocity
        fraction = by_s / (last_s - first_s)
        n, e, d = (
            after + fraction * (after - before)
            for before, after in zip(old_velocity, new_velocity, strict=True)
        )
        return (n, e, d) if math.hypot(n, e, d) > math.hypot(*new_velocity) else new_velocity


def margin_m(a: MovingVehicle, b: MovingVehicle) -> float:
    """Margin added to the minimum separation, for accuracy and age of both estimates and for wind."""
    return SIGMAS * math.hypot(a.accuracy_m, b.accuracy_m) + a.wind_and_age_margin_m + b.wind_and_age_margin_m


def braking_decel_m_s2(tilt_rad: float) -> float:
    """Deceleration while the vehicle stops, computed from its maximum tilt."""
    if tilt_rad >= math.pi / 4:
        return STOP_M_S2
    return max(0.2, min(STOP_M_S2, STOP_TILT_SHARE * G_M_S2 * math.tan(tilt_rad)))


def braking_distance_m(speed_m_s: Any, decel_m_s2: Any = STOP_M_S2) -> Any:
    """Braking distance from a speed [m]; for one number or an array."""
    return speed_m_s * STOP_DELAY_S + speed_m_s**2 / (2.0 * decel_m_s2)


def sample_count(braking_s: float) -> int:
    """Number of samples until both vehicles have stopped; `braking_s` is the longer of the two braking
    times."""
    return math.ceil((STOP_DELAY_S + braking_s) / STEP_S) + 1


def closest_m(
    position_a: Vectors,
    velocity_a: Vectors,
    position_b: Vectors,
    velocity_b: Vectors,
    decel_a_m_s2: Any = STOP_M_S2,
    decel_b_m_s2: Any = STOP_M_S2,
) -> Vectors:
    """Smallest distance between two vehicles that start to brake now, until both have stopped [m].

    Args:
        position_a: position in the common frame [m].
        velocity_a: velocity [m/s].
        position_b: position of the other vehicle.
        velocity_b: velocity of the other vehicle.
        decel_a_m_s2: deceleration; one number, or one per sample.
        decel_b_m_s2: deceleration of the other vehicle.
    """
    speed_a, speed_b = _norm(velocity_a), _norm(velocity_b)
    braking_s = max(float(np.max(speed_a / decel_a_m_s2)), float(np.max(speed_b / decel_b_m_s2)))
    after_s = np.linspace(0.0, STOP_DELAY_S + braking_s, sample_count(braking_s))
    relative_position = (
        (position_a - position_b)[..., None, :]
        + _braking_path(velocity_a, speed_a, after_s, decel_a_m_s2)
        - _braking_path(velocity_b, speed_b, after_s, decel_b_m_s2)
    )
    return np.min(_distance_to_line(relative_position[..., :-1, :], relative_position[..., 1:, :]), axis=-1)


def planned_margin_m() -> float:
    """The margin to expect in flight [m], for checks before the flight."""
    still = (0.0, 0.0, 0.0)
    planned = MovingVehicle(still, still, PLANNED_ACCURACY_M, PLANNED_AGE_S)
    return margin_m(planned, planned)


def braking_separation_m(
    position_a: Vectors,
    velocity_a: Vectors,
    position_b: Vectors,
    velocity_b: Vectors,
    required_m: Any,
    decel_a_m_s2: Any = STOP_M_S2,
    decel_b_m_s2: Any = STOP_M_S2,
) -> Vectors:
    """For each row, the smallest distance if both vehicles started to brake now [m].

    Args:
        position_a: positions in the common frame, (N, 3) [m].
        velocity_a: velocities (N, 3) [m/s].
        position_b: position of the other vehicle.
        velocity_b: velocity of the other vehicle.
        required_m: separation below which braking is computed; for a row whose vehicles stay farther apart,
            the result is their present distance. One number, or one per row.
        decel_a_m_s2: deceleration; one number, or one per row.
        decel_b_m_s2: deceleration of the other vehicle.
    """
    distance_m = _norm(position_a - position_b)
    decel_a, decel_b = (np.broadcast_to(each, distance_m.shape) for each in (decel_a_m_s2, decel_b_m_s2))
    reach_m = braking_distance_m(_norm(velocity_a), decel_a) + braking_distance_m(_norm(velocity_b), decel_b)
    too_near = np.nonzero(distance_m - reach_m < required_m)[0]
    for begin in range(0, len(too_near), SAMPLES_AT_ONCE):
        batch = too_near[begin : begin + SAMPLES_AT_ONCE]
        distance_m[batch] = closest_m(
            position_a[batch], velocity_a[batch], position_b[batch], velocity_b[batch],
            decel_a[batch], decel_b[batch],
        )  # fmt: skip
    return distance_m


def _braking_path(velocity: Vectors, speed: Vectors, after_s: Vectors, decel_m_s2: Any) -> Vectors:
    decel = np.asarray(decel_m_s2, dtype=float)[..., None]
    braking_s = np.clip(after_s - STOP_DELAY_S, 0.0, speed[..., None] / decel)
    braked_m = speed[..., None] * (np.minimum(after_s, STOP_DELAY_S) + braking_s) - decel / 2.0 * braking_s**2
    direction = velocity / np.maximum(speed, 1e-9)[..., None]
    return direction[..., None, :] * braked_m[..., None]


def _distance_to_line(begin: Vectors, end: Vectors) -> Vectors:
    """Distance from the zero vector to the straight line between two samples, so that a fast pass between
    samples is not missed."""
    step = end - begin
    square = np.maximum(np.sum(step * step, axis=-1), 1e-12)
    fraction = np.clip(-np.sum(begin * step, axis=-1) / square, 0.0, 1.0)
    return _norm(begin + step * fraction[..., None])


def _norm(vectors: Vectors) -> Any:
    return np.sqrt(np.sum(vectors * vectors, axis=-1))
