"""The predicted path of one vehicle: its positions, and the times within which it may be at each position.

A prediction is not exact in time, so each position has the earliest and the latest time at which the vehicle
may be at this position. All times count from now.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.frames import Vector3
from missions.geodesy import LocalOrigin
from missions.offboard.samples import Leg

Array = NDArray[np.float64]
STEP_S: Final = 0.5
"""Time between two samples; shorter than `separation.STOP_DELAY_S`, so that the braking path of each sample
reaches the next sample."""
MAX_SAMPLES: Final = 8_000
"""Maximum number of samples of one path; a longer path is sampled less often."""


@dataclass(frozen=True, slots=True)
class TimeAccuracy:
    """How much earlier or later than predicted a vehicle may be at a position."""

    initial_s: float
    """Uncertainty at the beginning."""
    growth: float
    """Additional fraction of the time since now."""


ESTIMATE_ACCURACY: Final = TimeAccuracy(8.0, 0.15)
"""For estimated times. The simulated PX4 took off 5 s later, and was 17 s behind after 117 s."""
DRY_RUN_ACCURACY: Final = TimeAccuracy(5.0, 0.05)
"""For the times of a dry run with the vehicle's own parameters."""
MISSION_ACCURACY: Final = TimeAccuracy(3.0, 0.05)
"""For the times of an offboard mission, whose setpoints are sent at these times."""


@dataclass(frozen=True, slots=True)
class PredictedLeg:
    """A part of a path."""

    leg: Leg
    """`start_s` counts from now; the part before now is already flown."""
    open_end: bool = False
    """Whether the vehicle waits at the end of the leg for an unknown time."""


@dataclass(frozen=True, slots=True)
class PredictedPath:
    """Samples of a path, in the vehicle's local frame; N rows each."""

    vehicle: str
    origin: LocalOrigin
    """Origin of the local frame."""
    position_ned_m: Array
    velocity_ned_m_s: Array
    t_s: Array
    """Predicted times."""
    earliest_s: Array
    latest_s: Array
    """Infinite: the vehicle may stay at this position, or be there at any later time."""
    leg: NDArray[np.int64]
    """Index of each sample's leg."""
    places: tuple[str, ...]
    """Name of each leg: "item 3", "step 4.2"."""

    def without_latest_times(self) -> PredictedPath:
        """The same path without latest times."""
        return replace(self, latest_s=np.full_like(self.latest_s, math.inf))


def stationary_path(vehicle: str, origin: LocalOrigin, position_ned_m: Vector3, place: str) -> PredictedPath:
    """The path of a vehicle that stays at its position."""
    zero = np.zeros(1)
    return PredictedPath(
        vehicle, origin, np.array([position_ned_m]), np.zeros((1, 3)), zero, zero, np.full(1, math.inf),
        np.zeros(1, dtype=np.int64), (place,),
    )  # fmt: skip


def path_along_legs(
    vehicle: str,
    origin: LocalOrigin,
    legs: Sequence[PredictedLeg],
    accuracy: TimeAccuracy,
    *,
    ends_in_air: bool,
) -> PredictedPath | None:
    """The path along legs; None: all legs are flown.

    Args:
        vehicle: id of the vehicle.
        origin: origin of the legs' frame.
        legs: legs in order of time; at a branch, the legs of one continuation, then those of the other.
        accuracy: accuracy of the times.
        ends_in_air: whether the vehicle stays at the end of the last leg.
    """
    total_s = sum(each.leg.duration_s for each in legs)
    step_s = max(STEP_S, total_s / MAX_SAMPLES)
    rows: list[Array] = []
    velocities: list[Array] = []
    index: list[NDArray[np.int64]] = []
    open_from_s = math.inf
    for leg_index, each in enumerate(legs):
        sampled = _sample_leg(each.leg, step_s)
        if len(sampled):
            rows.append(sampled)
            velocities.append(_velocity(sampled))
            index.append(np.full(len(sampled), leg_index))
        if each.open_end:
            open_from_s = min(open_from_s, each.leg.start_s + each.leg.duration_s)
    if not rows:
        return None
    samples, leg = np.vstack(rows), np.concatenate(index)
    t_s = samples[:, 0]
    uncertainty_s = accuracy.initial_s + accuracy.growth * t_s
    latest_s = np.where(t_s >= open_from_s, math.inf, t_s + uncertainty_s)
    if ends_in_air:
        latest_s[-1] = math.inf
    places = tuple(each.leg.place for each in legs)
    return PredictedPath(
        vehicle, origin, samples[:, 1:], np.vstack(velocities), t_s, np.maximum(0.0, t_s - uncertainty_s),
        latest_s, leg, places,
    )  # fmt: skip


def straight_leg(place: str, start_ned_m: Vector3, end_ned_m: Vector3, speed_m_s: float) -> PredictedLeg:
    """A straight leg that begins now."""
    duration_s = math.dist(start_ned_m, end_ned_m) / max(speed_m_s, 0.1)
    return PredictedLeg(
        Leg(place, "", 0.0, duration_s, True, ((0.0, *start_ned_m), (duration_s, *end_ned_m)))
    )


def _sample_leg(leg: Leg, step_s: float) -> Array:
    """Rows (time, north, east, down) of the leg from now on; empty if the leg is already flown."""
    points = np.array(leg.points)
    begin_s, end_s = max(0.0, -leg.start_s), float(points[-1, 0])
    if begin_s > end_s:
        return np.empty((0, 4))
    count = 2 + int((end_s - begin_s) / step_s)
    times = np.linspace(begin_s, end_s, count)
    axes = [np.interp(times, points[:, 0], points[:, axis]) for axis in (1, 2, 3)]
    return np.column_stack((times + leg.start_s, *axes))


def _velocity(rows: Array) -> Array:
    """Velocity at each row; zero in a leg without duration."""
    if rows[-1, 0] - rows[0, 0] < 1e-6:
        return np.zeros((len(rows), 3))
    return np.gradient(rows[:, 1:], rows[:, 0], axis=0)
