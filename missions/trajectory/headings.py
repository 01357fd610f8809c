"""The yaw of a trajectory is the fourth coordinate of its path, so that the yaw rate can limit the speed.

On each piece the yaw is a cubic polynomial with the wanted heading and its derivative at both ends.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.frames import Vector3
from missions.trajectory.pieces import Array, Pieces

MAX_PART_TURN_RAD = 0.2
"""Largest heading change of one part of a piece; the yaw is exact at the ends of each part."""
MAX_PARTS = 64
"""Maximum number of parts of one piece."""
MAX_HALVINGS = 16
"""Maximum number of times that a piece is halved."""
MIN_TARGET_DISTANCE_M = 0.5
"""Horizontal distance to the target below which the vehicle keeps its heading [m]."""
MIN_TURN_RAD = 1e-6
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


def with_point_yaws(pieces: Pieces, yaws: list[float | None]) -> Pieces:
    """Adds the yaws of the points. Between two points the yaw turns in the shorter direction, with zero slope
    at each point.

    A missing yaw is interpolated. Before the first and after the last given yaw, the yaw is constant.
    """
    boundaries = np.concatenate(([0.0], np.cumsum(pieces.spans)))
    known = [(float(boundaries[pieces.marks[k]]), yaw) for k, yaw in enumerate(yaws) if yaw is not None]
    parameters = np.array([parameter for parameter, _ in known])
    values = np.unwrap(np.array([yaw for _, yaw in known]))
    start_yaw, start_slope = _smooth_steps(parameters, values, boundaries[:-1], "right")
    end_yaw, end_slope = _smooth_steps(parameters, values, boundaries[1:], "left")
    return _with_yaw(pieces, start_yaw, start_slope, end_yaw, end_slope)


def _smooth_steps(parameters: Array, values: Array, at: Array, side: str) -> tuple[Array, Array]:
    """Value and derivative of a cubic from each value to the next, with zero slope at both ends."""
    if len(parameters) == 1:
        return np.full_like(at, values[0]), np.zeros_like(at)
    k = np.clip(parameters.searchsorted(at, side=side) - 1, 0, len(parameters) - 2)  # type: ignore[arg-type]
    width = parameters[k + 1] - parameters[k]
    x = np.clip((at - parameters[k]) / width, 0.0, 1.0)
    change = values[k + 1] - values[k]
    return values[k] + change * x * x * (3.0 - 2.0 * x), change * 6.0 * x * (1.0 - x) / width


def with_yaw_along_path(pieces: Pieces, heading: AlongPath) -> Pieces:
    """Adds the heading along the path; at stops the vehicle turns on the spot to the next direction."""
    first_derivative = pieces.derivative(1)
    is_level = (
        np.hypot(first_derivative[..., 0], first_derivative[..., 1]) > 1e-6 * np.abs(first_derivative[..., 2])
    ).all(axis=1)
    turns_rad = np.where(
        is_level, _total_turn(np.arctan2(first_derivative[..., 1], first_derivative[..., 0])), 0.0
    )
    pieces = pieces.split(_part_counts(turns_rad))
    (start_yaw, start_slope), (end_yaw, end_slope) = (
        _direction(first_derivative, second_derivative)
        for first_derivative, second_derivative in zip(pieces.ends(1), pieces.ends(2), strict=True)
    )
    return _with_turns(pieces, start_yaw, start_slope, end_yaw, end_slope, heading.start_yaw_ned_rad)


def with_yaw_towards(pieces: Pieces, heading: LookAt) -> Pieces:
    """Adds the heading towards a position; if the path passes over the position, the vehicle turns within
    about a metre."""
    north, east, _ = heading.position_ned_m
    for _ in range(MAX_HALVINGS):
        n, e = north - pieces.points[..., 0], east - pieces.points[..., 1]
        is_over_target = np.minimum(np.hypot(n, e)[:, 0], np.hypot(n, e)[:, -1]) < MIN_TARGET_DISTANCE_M
        must_split = ((_total_turn(np.arctan2(e, n)) > MAX_PART_TURN_RAD) | is_over_target) & (
            pieces.spans > 2.0 * MIN_TARGET_DISTANCE_M
        )
        if not must_split.any():
            break
        pieces = pieces.split(np.where(must_split, 2, 1))
    (start_yaw, start_slope), (end_yaw, end_slope) = (
        _bearing(position, first_derivative, heading)
        for position, first_derivative in zip(pieces.ends(0), pieces.ends(1), strict=True)
    )
    return _with_turns(pieces, start_yaw, start_slope, end_yaw, end_slope, None)


def _direction(first_derivative: Array, second_derivative: Array) -> tuple[Array, Array]:
    """Yaw of a horizontal direction and its derivative; NaN where the path is vertical."""
    n, e, length_squared = (
        first_derivative[:, 0],
        first_derivative[:, 1],
        first_derivative[:, 0] ** 2 + first_derivative[:, 1] ** 2,
    )
    is_level = length_squared > 1e-6 * (length_squared + first_derivative[:, 2] ** 2)
    safe = np.where(is_level, length_squared, 1.0)
    slope = (n * second_derivative[:, 1] - e * second_derivative[:, 0]) / safe
    return np.where(is_level, np.arctan2(e, n), np.nan), np.where(is_level, slope, 0.0)


def _bearing(position: Array, first_derivative: Array, heading: LookAt) -> tuple[Array, Array]:
    n, e = heading.position_ned_m[0] - position[:, 0], heading.position_ned_m[1] - position[:, 1]
    length_squared = n**2 + e**2
    is_far = length_squared >= MIN_TARGET_DISTANCE_M**2
    slope = (e * first_derivative[:, 0] - n * first_derivative[:, 1]) / np.where(is_far, length_squared, 1.0)
    return np.where(is_far, np.arctan2(e, n), np.nan), np.where(is_far, slope, 0.0)


def _total_turn(bearings: Array) -> Array:
    """Total change of a direction over each piece, from its control points (N, 6 or 5) [rad]."""
    return np.abs(np.diff(np.unwrap(bearings, axis=1), axis=1)).sum(axis=1)


def _part_counts(turns_rad: Array) -> NDArray[np.int64]:
    return np.clip(np.ceil(turns_rad / MAX_PART_TURN_RAD), 1, MAX_PARTS).astype(np.int64)


def _with_turns(
    pieces: Pieces,
    start_yaw: Array,
    start_slope: Array,
    end_yaw: Array,
    end_slope: Array,
    initial_yaw: float | None,
) -> Pieces:
    """Adds the yaw, and turns on the spot at stops between two headings. An undefined heading is replaced by
    the last defined heading before it, or else by the first defined heading."""
    headings = np.stack((start_yaw, end_yaw), axis=1).ravel()
    is_known = ~np.isnan(headings)
    if initial_yaw is not None and not is_known[:1].any():
        headings[0], is_known[0] = initial_yaw, True
    if not is_known.any():
        headings[0], is_known[0] = 0.0, True
    last_known = np.maximum.accumulate(np.where(is_known, np.arange(len(headings)), -1))
    headings = headings[np.where(last_known < 0, int(is_known.argmax()), last_known)]
    headings = np.unwrap(headings)
    start_yaw, end_yaw = headings[0::2], headings[1::2]
    start_slope = np.where(np.isnan(start_slope), 0.0, start_slope)
    pieces = _with_yaw(pieces, start_yaw, start_slope, end_yaw, end_slope)
    turn = start_yaw[1:] - end_yaw[:-1]
    turn_index = np.flatnonzero(np.abs(turn) > MIN_TURN_RAD) + 1
    if not len(turn_index):
        return pieces
    turn_points = np.repeat(pieces.points[turn_index, :1], 6, axis=1)
    turn_points[:, :, 3] = (
        end_yaw[turn_index - 1][:, None] + np.linspace(0.0, 1.0, 6) * turn[turn_index - 1][:, None]
    )
    points = np.insert(pieces.points, turn_index, turn_points, axis=0)
    spans = np.insert(pieces.spans, turn_index, np.abs(turn[turn_index - 1]))
    stops = pieces.stops.copy()
    stops[turn_index] = True
    stops = np.insert(stops, turn_index, True)
    marks = pieces.marks + np.searchsorted(turn_index, pieces.marks, side="left")
    return Pieces(points, spans, stops, marks)


def _with_yaw(
    pieces: Pieces, start_yaw: Array, start_slope: Array, end_yaw: Array, end_slope: Array
) -> Pieces:
    """Adds a cubic of yaw to each piece, as control points."""
    third = pieces.spans / 3.0
    cubic = (start_yaw, start_yaw + start_slope * third, end_yaw - end_slope * third, end_yaw)
    points = pieces.points.copy()
    points[:, :, 3] = _to_degree_five(np.stack(cubic, axis=1))
    return Pieces(points, pieces.spans, pieces.stops, pieces.marks)


def _to_degree_five(control: Array) -> Array:
    """Degree elevation: control points of the same polynomial with degree five."""
    while control.shape[1] < 6:
        count = control.shape[1]
        fraction = np.arange(count + 1) / count
        before = np.concatenate((control[:, :1], control), axis=1)
        after = np.concatenate((control, control[:, -1:]), axis=1)
        control = fraction * before + (1.0 - fraction) * after
    return control
