"""Compares the predicted paths of two vehicles: where they first come too near to each other.

The rule is that of the separation guard: after any two vehicles stop, at least the minimum separation and a
margin remain between them. Two positions are compared if both vehicles may be there at the same time.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.offboard.document import MINIMUM_SEPARATION_M
from missions.separation import braking_separation_m, planned_margin_m, stopping_m
from missions.traffic.path import Array, PredictedPath

ROWS_AT_ONCE = 64
"""Number of samples of a path that are compared together."""
FIX = "Start later, or change the path or its altitudes."


@dataclass(frozen=True, slots=True)
class Conflict:
    """Two vehicles that may come too near to each other."""

    vehicle: str
    other: str
    after_s: float
    """Time after the start."""
    along_m: float
    """Distance along the vehicle's path."""
    leg: int
    """Index of the leg of the vehicle's path."""
    place: str
    """Name of that leg."""
    other_place: str
    position_deg: tuple[float, float]
    """Latitude and longitude of the vehicle."""
    distance_m: float
    """Smallest distance, after both have stopped."""
    minimum_m: float
    margin_m: float
    earlier_or_later_s: float | None
    """By how much the times of both may differ from the prediction; None: the other's time is not known."""

    @property
    def text(self) -> str:
        """The conflict as sentences."""
        lat_deg, lon_deg = self.position_deg
        times = (
            f"The time at which vehicle {self.other} is there is not known."
            if self.earlier_or_later_s is None
            else f"The times may differ by {self.earlier_or_later_s:.0f} s."
        )
        return (
            f"{self.after_s:.0f} s after the start, at {self.place}, {self.along_m:.0f} m along its path "
            f"({lat_deg:.6f}, {lon_deg:.6f}), vehicle {self.vehicle} may come within {self.distance_m:.1f} m "
            f"of vehicle {self.other} ({self.other_place}), braking included. Required: {self.minimum_m:g} m "
            f"plus {self.margin_m:.1f} m of margin. {times}"
        )


def conflicts(own: PredictedPath, others: Iterable[PredictedPath]) -> tuple[Conflict, ...]:
    """The first conflict with each other vehicle, in order of time."""
    found = (first_conflict(own, other) for other in others)
    return tuple(sorted((each for each in found if each is not None), key=lambda each: each.after_s))


def first_conflict(own: PredictedPath, other: PredictedPath) -> Conflict | None:
    """The first part of the path in which the vehicles may be too near, at its smallest distance; None: they
    stay apart."""
    margin_m = planned_margin_m()
    least_m = MINIMUM_SEPARATION_M + margin_m
    offset = other.origin.to_frame_of(own.origin, (0.0, 0.0, 0.0))
    theirs = other.position_ned_m + np.array(offset)
    nearest: tuple[float, int, int] | None = None
    for begin in range(0, len(own.t_s), ROWS_AT_ONCE):
        rows = np.arange(begin, min(begin + ROWS_AT_ONCE, len(own.t_s)))
        separation_m, partner = _separation(own, rows, other, theirs, least_m)
        for row, apart_m, at in zip(rows.tolist(), separation_m.tolist(), partner.tolist(), strict=True):
            if apart_m < least_m:
                if nearest is None or apart_m < nearest[0]:
                    nearest = (apart_m, row, at)
            elif nearest is not None:
                return _conflict(own, other, *nearest, margin_m)
    return None if nearest is None else _conflict(own, other, *nearest, margin_m)


def _separation(
    own: PredictedPath, rows: NDArray[np.int64], other: PredictedPath, theirs: Array, least_m: float
) -> tuple[Array, NDArray[np.int64]]:
    """For each row, the smallest distance to the other vehicle, and the other's sample; infinite: it is not
    near."""
    separation_m, partner = np.full(len(rows), math.inf), np.zeros(len(rows), dtype=np.int64)
    mine, braking_m = own.position_ned_m[rows], _braking_m(own.velocity_ned_m_s[rows])
    near_m = least_m + _braking_m(other.velocity_ned_m_s)
    low, high = (mine - braking_m).min(axis=0), (mine + braking_m).max(axis=0)
    inside = np.all((theirs >= low - near_m) & (theirs <= high + near_m), axis=1)
    columns = np.flatnonzero(inside)
    if not len(columns):
        return separation_m, partner
    together = (own.earliest_s[rows][:, None] <= other.latest_s[columns]) & (
        other.earliest_s[columns] <= own.latest_s[rows][:, None]
    )
    for axis in range(3):
        apart_m = np.abs(mine[:, axis][:, None] - theirs[columns, axis])
        together &= apart_m < near_m[columns, axis] + braking_m[:, axis][:, None]
    first, second = np.nonzero(together)
    if not len(first):
        return separation_m, partner
    distances_m = np.full(together.shape, math.inf)
    distances_m[first, second] = braking_separation_m(
        mine[first],
        own.velocity_ned_m_s[rows[first]],
        theirs[columns[second]],
        other.velocity_ned_m_s[columns[second]],
        least_m,
    )
    nearest = distances_m.argmin(axis=1)
    return distances_m[np.arange(len(rows)), nearest], columns[nearest]


def _braking_m(velocity: Array) -> Array:
    """Length of the braking path along each axis, which is enough to exclude most pairs of samples."""
    speed = np.linalg.norm(velocity, axis=1)[:, None]
    return stopping_m(speed) / np.maximum(speed, 1e-9) * np.abs(velocity)


def _conflict(
    own: PredictedPath, other: PredictedPath, apart_m: float, row: int, partner: int, margin_m: float
) -> Conflict:
    steps_m = np.linalg.norm(np.diff(own.position_ned_m[: row + 1], axis=0), axis=1)
    north, east, down = own.position_ned_m[row].tolist()
    lat_deg, lon_deg, _ = own.origin.to_geodetic((north, east, down))
    leg = int(own.leg[row])
    late_s = float(own.latest_s[row] - own.t_s[row] + other.latest_s[partner] - other.t_s[partner])
    return Conflict(
        own.vehicle, other.vehicle, float(own.t_s[row]), float(steps_m.sum()), leg, own.places[leg],
        other.places[int(other.leg[partner])], (lat_deg, lon_deg), apart_m, MINIMUM_SEPARATION_M, margin_m,
        late_s if math.isfinite(late_s) else None,
    )  # fmt: skip
