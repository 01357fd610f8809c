"""The yaw of a trajectory is the fourth coordinate of its path, so that the yaw rate can limit the speed.

On each piece the yaw is a cubic polynomial with the wanted heading and its derivative at both ends.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.frames import Vector3
from missions.trajectory.pieces import Array, Pieces

PART_RAD = 0.2
"""Largest heading change of one part of a piece; the yaw is exact at the ends of each part."""
MAX_PARTS = 64
MAX_HALVINGS = 16
MIN_TARGET_DISTANCE_M = 0.5
"""Horizontal distance to the target below which the vehicle keeps its heading [m]."""
TURN_RAD = 1e-6
"""Smaller heading differences need no turn on the spot."""


@dataclass(frozen=True, slots=True)
class AlongPath:
    """Heading along the horizontal direction of flight."""

    start_yaw_ned_rad: float | None = None
    """The heading at the start of a path that starts vertically."""


@dataclass(frozen=True, slots=True)
class LookAt:
    """Heading towards a position."""

    position_ned_m: Vector3


def through_points(pieces: Pieces, yaws: list[float | None]) -> Pieces:
    """The yaws of the points; between them the yaw turns in the shorter direction, with zero rate at each
    point.

    The yaw of a point without one is interpolated. Before the first and after the last given yaw it is
    constant.
    """
    ends = np.concatenate(([0.0], np.cumsum(pieces.spans)))
    known = [(float(ends[pieces.marks[k]]), yaw) for k, yaw in enumerate(yaws) if yaw is not None]
    parameters = np.array([parameter for parameter, _ in known])
    values = np.unwrap(np.array([yaw for _, yaw in known]))
    left, left_rate = _steps(parameters, values, ends[:-1], "right")
    right, right_rate = _steps(parameters, values, ends[1:], "left")
    return _with_yaw(pieces, left, left_rate, right, right_rate)


def _steps(parameters: Array, values: Array, at: Array, side: str) -> tuple[Array, Array]:
    """A cubic from each value to the next, with zero slope at both: value and derivative."""
    if len(parameters) == 1:
        return np.full_like(at, values[0]), np.zeros_like(at)
    k = np.clip(parameters.searchsorted(at, side=side) - 1, 0, len(parameters) - 2)  # type: ignore[arg-type]
    width = parameters[k + 1] - parameters[k]
    x = np.clip((at - parameters[k]) / width, 0.0, 1.0)
    change = values[k + 1] - values[k]
    return values[k] + change * x * x * (3.0 - 2.0 * x), change * 6.0 * x * (1.0 - x) / width


def along_path(pieces: Pieces, heading: AlongPath) -> Pieces:
    """Heading along the path; at stops the vehicle turns on the spot to the next direction."""
    first = pieces.derivative(1)
    level = (np.hypot(first[..., 0], first[..., 1]) > 1e-6 * np.abs(first[..., 2])).all(axis=1)
    turns = np.where(level, _total_turn(np.arctan2(first[..., 1], first[..., 0])), 0.0)
    pieces = pieces.split(_parts(turns))
    (left, left_rate), (right, right_rate) = (
        _direction(first, second) for first, second in zip(pieces.ends(1), pieces.ends(2), strict=True)
    )
    return _with_turns(pieces, left, left_rate, right, right_rate, heading.start_yaw_ned_rad)


def look_at(pieces: Pieces, heading: LookAt) -> Pieces:
    """Heading towards a position; if the path passes over it, the vehicle turns within about a metre."""
    north, east, _ = heading.position_ned_m
    for _ in range(MAX_HALVINGS):
        n, e = north - pieces.points[..., 0], east - pieces.points[..., 1]
        over = np.minimum(np.hypot(n, e)[:, 0], np.hypot(n, e)[:, -1]) < MIN_TARGET_DISTANCE_M
        wide = ((_total_turn(np.arctan2(e, n)) > PART_RAD) | over) & (
            pieces.spans > 2.0 * MIN_TARGET_DISTANCE_M
        )
        if not wide.any():
            break
        pieces = pieces.split(np.where(wide, 2, 1))
    (left, left_rate), (right, right_rate) = (
        _bearing(position, first, heading)
        for position, first in zip(pieces.ends(0), pieces.ends(1), strict=True)
    )
    return _with_turns(pieces, left, left_rate, right, right_rate, None)


def _direction(first: Array, second: Array) -> tuple[Array, Array]:
    """Yaw of a horizontal direction and its derivative; NaN where the path is vertical."""
    n, e, size = first[:, 0], first[:, 1], first[:, 0] ** 2 + first[:, 1] ** 2
    level = size > 1e-6 * (size + first[:, 2] ** 2)
    safe = np.where(level, size, 1.0)
    rate = (n * second[:, 1] - e * second[:, 0]) / safe
    return np.where(level, np.arctan2(e, n), np.nan), np.where(level, rate, 0.0)


def _bearing(position: Array, first: Array, heading: LookAt) -> tuple[Array, Array]:
    n, e = heading.position_ned_m[0] - position[:, 0], heading.position_ned_m[1] - position[:, 1]
    size = n**2 + e**2
    far = size >= MIN_TARGET_DISTANCE_M**2
    rate = (e * first[:, 0] - n * first[:, 1]) / np.where(far, size, 1.0)
    return np.where(far, np.arctan2(e, n), np.nan), np.where(far, rate, 0.0)


def _total_turn(bearings: Array) -> Array:
    """Total change of a direction over each piece, from its control points (N, 6 or 5) [rad]."""
    return np.abs(np.diff(np.unwrap(bearings, axis=1), axis=1)).sum(axis=1)


def _parts(turns_rad: Array) -> NDArray[np.int64]:
    return np.clip(np.ceil(turns_rad / PART_RAD), 1, MAX_PARTS).astype(np.int64)


def _with_turns(
    pieces: Pieces, left: Array, left_rate: Array, right: Array, right_rate: Array, start: float | None
) -> Pieces:
    """Adds turns on the spot at stops between two headings; an undefined heading is that of the previous
    piece."""
    both = np.stack((left, right), axis=1).ravel()
    known = ~np.isnan(both)
    if start is not None and not known[:1].any():
        both[0], known[0] = start, True
    if not known.any():
        both[0], known[0] = 0.0, True
    last = np.maximum.accumulate(np.where(known, np.arange(len(both)), -1))
    both = both[np.where(last < 0, int(known.argmax()), last)]
    both = np.unwrap(both)
    left, right = both[0::2], both[1::2]
    left_rate = np.where(np.isnan(left_rate), 0.0, left_rate)
    pieces = _with_yaw(pieces, left, left_rate, right, right_rate)
    turn = left[1:] - right[:-1]
    at = np.flatnonzero(np.abs(turn) > TURN_RAD) + 1
    if not len(at):
        return pieces
    spots = np.repeat(pieces.points[at, :1], 6, axis=1)
    spots[:, :, 3] = right[at - 1][:, None] + np.linspace(0.0, 1.0, 6) * turn[at - 1][:, None]
    points = np.insert(pieces.points, at, spots, axis=0)
    spans = np.insert(pieces.spans, at, np.abs(turn[at - 1]))
    stops = pieces.stops.copy()
    stops[at] = True
    stops = np.insert(stops, at, True)
    marks = pieces.marks + np.searchsorted(at, pieces.marks, side="left")
    return Pieces(points, spans, stops, marks)


def _with_yaw(pieces: Pieces, left: Array, left_rate: Array, right: Array, right_rate: Array) -> Pieces:
    """Adds a cubic of yaw to each piece, as control points."""
    third = pieces.spans / 3.0
    cubic = (left, left + left_rate * third, right - right_rate * third, right)
    points = pieces.points.copy()
    points[:, :, 3] = _elevated(np.stack(cubic, axis=1))
    return Pieces(points, pieces.spans, pieces.stops, pieces.marks)


def _elevated(control: Array) -> Array:
    """Degree elevation: control points of the same polynomial with degree five."""
    while control.shape[1] < 6:
        count = control.shape[1]
        share = np.arange(count + 1) / count
        before = np.concatenate((control[:, :1], control), axis=1)
        after = np.concatenate((control, control[:, -1:]), axis=1)
        control = share * before + (1.0 - share) * after
    return control
