"""Compares the predicted paths of two vehicles: where they first come too near to each other.

The rule is the rule of the separation guard: while two vehicles brake to a stop, at least the minimum
separation and a margin must remain between them. Two positions are compared if both vehicles may be there at
the same time.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.offboard.document import MINIMUM_SEPARATION_M
from missions.separation import braking_distance_m, braking_separation_m, planned_margin_m
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
    """Name of the leg."""
    other_place: str
    """Name of the leg of the other vehicle."""
    position_deg: tuple[float, float]
    """Latitude and longitude of the vehicle."""
    distance_m: float
    """Smallest distance until both vehicles have stopped."""
    minimum_m: float
    margin_m: float
    time_uncertainty_s: float | None
    """Sum of the uncertainties of both predicted times; None: the time of the other vehicle is not known."""

    @property
    def text(self) -> str:
        """The conflict as sentences."""
        lat_deg, lon_deg = self.position_deg
        times = (
            f"The time of vehicle {self.other} at this position is not known."
            if self.time_uncertainty_s is None
            else f"The predicted times may be wrong by {self.time_uncertainty_s:.0f} s in total."
        )
        return (
            f"{self.after_s:.0f} s after the start, at {self.place}, {self.along_m:.0f} m along its path "
            f"({lat_deg:.6f}, {lon_deg:.6f}), vehicle {self.vehicle} may come within {self.distance_m:.1f} m "
            f"of vehicle {self.other} ({self.other_place}), including the distance to brake. Required: "
            f"{self.minimum_m:g} m plus {self.margin_m:.1f} m of margin. {times}"
        )


def conflicts(own: PredictedPath, others: Iterable[PredictedPath]) -> tuple[Conflict, ...]:
    """The first conflict with each other vehicle, in order of time."""
    found = (first_conflict(own, other) for other in others)
    return tuple(sorted((each for each in found if each is not None), key=lambda each: each.after_s))


def first_conflict(own: PredictedPath, other: PredictedPath) -> Conflict | None:
    """The first part of the path in which the vehicles may be too near, at its smallest distance; None: no
    conflict."""
    margin_m = planned_margin_m()
    required_m = MINIMUM_SEPARATION_M + margin_m
    offset = other.origin.to_frame_of(own.origin, (0.0, 0.0, 0.0))
    other_ned_m = other.position_ned_m + np.array(offset)
    nearest: tuple[float, int, int] | None = None
    for begin in range(0, len(own.t_s), ROWS_AT_ONCE):
        rows = np.arange(begin, min(begin + ROWS_AT_ONCE, len(own.t_s)))
        separation_m, other_rows = _separation(own, rows, other, other_ned_m, required_m)
        for row, distance_m, other_row in zip(
            rows.tolist(), separation_m.tolist(), other_rows.tolist(), strict=True
        ):
            if distance_m < required_m:
                if nearest is None or distance_m < nearest[0]:
                    nearest = (distance_m, row, other_row)
            elif nearest is not None:
                return _conflict(own, other, *nearest, margin_m)
    return None if nearest is None else _conflict(own, other, *nearest, margin_m)


def _separation(
    own: PredictedPath, rows: NDArray[np.int64], other: PredictedPath, other_ned_m: Array, required_m: float
) -> tuple[Array, NDArray[np.int64]]:
    """For each row, the smallest distance to the other vehicle, and the row of the other path at which the
    other vehicle then is; an infinite distance means that the other vehicle is not near."""
    separation_m, other_rows = np.full(len(rows), math.inf), np.zeros(len(rows), dtype=np.int64)
    own_ned_m, braking_m = own.position_ned_m[rows], _braking_m(own.velocity_ned_m_s[rows])
    near_m = required_m + _braking_m(other.velocity_ned_m_s)
    lowest, highest = (own_ned_m - braking_m).min(axis=0), (own_ned_m + braking_m).max(axis=0)
    inside = np.all((other_ned_m >= lowest - near_m) & (other_ned_m <= highest + near_m), axis=1)
    columns = np.flatnonzero(inside)
    if not len(columns):
        return separation_m, other_rows
    may_meet = (own.earliest_s[rows][:, None] <= other.latest_s[columns]) & (
        other.earliest_s[columns] <= own.latest_s[rows][:, None]
    )
    for axis in range(3):
        apart_m = np.abs(own_ned_m[:, axis][:, None] - other_ned_m[columns, axis])
        may_meet &= apart_m < near_m[columns, axis] + braking_m[:, axis][:, None]
    own_index, other_index = np.nonzero(may_meet)
    if not len(own_index):
        return separation_m, other_rows
    distances_m = np.full(may_meet.shape, math.inf)
    distances_m[own_index, other_index] = braking_separation_m(
        own_ned_m[own_index],
        own.velocity_ned_m_s[rows[own_index]],
        other_ned_m[columns[other_index]],
        other.velocity_ned_m_s[columns[other_index]],
        required_m,
    )
    nearest = distances_m.argmin(axis=1)
    return distances_m[np.arange(len(rows)), nearest], columns[nearest]


def _braking_m(velocity: Array) -> Array:
    """Length of the braking path along each axis; a quick test with it excludes most pairs of samples."""
    speed = np.linalg.norm(velocity, axis=1)[:, None]
    return braking_distance_m(speed) / np.maximum(speed, 1e-9) * np.abs(velocity)


def _conflict(
    own: PredictedPath, other: PredictedPath, distance_m: float, row: int, other_row: int, margin_m: float
) -> Conflict:
    steps_m = np.linalg.norm(np.diff(own.position_ned_m[: row + 1], axis=0), axis=1)
    north, east, down = own.position_ned_m[row].tolist()
    lat_deg, lon_deg, _ = own.origin.to_geodetic((north, east, down))
    leg = int(own.leg[row])
    uncertainty_s = float(own.latest_s[row] - own.t_s[row] + other.latest_s[other_row] - other.t_s[other_row])
    return Conflict(
        own.vehicle, other.vehicle, float(own.t_s[row]), float(steps_m.sum()), leg, own.places[leg],
        other.places[int(other.leg[other_row])], (lat_deg, lon_deg), distance_m, MINIMUM_SEPARATION_M,
        margin_m, uncertainty_s if math.isfinite(uncertainty_s) else None,
    )  # fmt: skip
