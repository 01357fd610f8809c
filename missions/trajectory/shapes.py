"""Orbit, figure-eight, helix and spiral as paths whose parameter is the distance flown.

A shape is a function of one angle. At the ends of each piece, position and first and second derivative are
exact. Shapes are defined in a level frame that is rotated by a heading: the first axis points along the
heading, the second to its right.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from missions.errors import PlanError
from missions.frames import Vector3
from missions.trajectory.pieces import Array, Pieces, hermite
from missions.trajectory.points import MAX_COORDINATE_M

PIECES_PER_TURN = 32
"""With this number of pieces the error of a circle of 100 m radius is below a millimetre."""
MAX_TURNS = 200.0
SAMPLES_PER_PIECE = 64
"""Samples per piece to compute its length."""

Shape = Callable[[Array], tuple[Array, Array, Array]]
"""Positions, first and second derivatives by the angle, (N, 3) each."""


def arc(
    center_ned_m: Vector3,
    radius_m: float,
    turns: float,
    *,
    start_angle_ned_rad: float = 0.0,
    clockwise: bool = True,
    climb_m: float = 0.0,
    end_radius_m: float | None = None,
) -> Pieces:
    """An orbit; with `climb_m` a helix; with `end_radius_m` a spiral.

    Args:
        center_ned_m: centre, at the altitude of the start.
        radius_m: radius at the start.
        turns: number of rounds; may be fractional.
        start_angle_ned_rad: bearing of the start from the centre, clockwise from north.
        clockwise: direction as seen from above.
        climb_m: total climb; negative descends.
        end_radius_m: radius at the end; None: `radius_m`.

    Raises:
        PlanError: A value is out of range.
    """
    last_radius_m = radius_m if end_radius_m is None else end_radius_m
    _check("turns", turns, 0.01, MAX_TURNS)
    _check("radius_m", radius_m, 0.1, 10_000.0)
    _check("end_radius_m", last_radius_m, 0.1, 10_000.0)
    _check("climb_m", abs(climb_m), 0.0, 10_000.0)
    _check_center(center_ned_m)
    sweep = math.tau * turns
    sign = 1.0 if clockwise else -1.0
    radius_m_per_rad, down_m_per_rad = (last_radius_m - radius_m) / sweep, -climb_m / sweep

    def shape(angle: Array) -> tuple[Array, Array, Array]:
        bearing = start_angle_ned_rad + sign * angle
        radius = radius_m + radius_m_per_rad * angle
        outward = np.stack((np.cos(bearing), np.sin(bearing), np.zeros_like(angle)), axis=1)
        tangent_direction = sign * np.stack((-np.sin(bearing), np.cos(bearing), np.zeros_like(angle)), axis=1)
        r = radius[:, None]
        position = np.array(center_ned_m) + r * outward
        position[:, 2] += down_m_per_rad * angle
        first = radius_m_per_rad * outward + r * tangent_direction
        first[:, 2] = down_m_per_rad
        return position, first, 2.0 * radius_m_per_rad * tangent_direction - r * outward

    return _pieces_of_shape(shape, sweep, math.ceil(turns * PIECES_PER_TURN))


def figure_eight(
    center_ned_m: Vector3,
    length_m: float,
    width_m: float,
    rounds: float,
    *,
    heading_ned_rad: float = 0.0,
    start_at_center: bool = True,
) -> Pieces:
    """A figure-eight (lemniscate of Gerono): sin θ along the heading, sin θ cos θ to its right.

    Args:
        center_ned_m: position of the crossing.
        length_m: length from tip to tip, along the heading.
        width_m: width of each of the two loops.
        rounds: number of rounds; may be fractional.
        heading_ned_rad: direction of the long axis, clockwise from north.
        start_at_center: whether to start at the crossing; False: at the far tip.

    Raises:
        PlanError: A value is out of range.
    """
    _check("rounds", rounds, 0.01, MAX_TURNS)
    _check("length_m", length_m, 0.2, 20_000.0)
    _check("width_m", width_m, 0.2, 20_000.0)
    _check_center(center_ned_m)
    c, s = math.cos(heading_ned_rad), math.sin(heading_ned_rad)
    rotation = np.array([[c, s, 0.0], [-s, c, 0.0]])
    start_angle = 0.0 if start_at_center else math.pi / 2.0

    def shape(angle: Array) -> tuple[Array, Array, Array]:
        t = angle + start_angle
        half_m = length_m / 2.0
        offset = np.stack((half_m * np.sin(t), width_m / 2.0 * np.sin(2.0 * t)), axis=1)
        first = np.stack((half_m * np.cos(t), width_m * np.cos(2.0 * t)), axis=1)
        second = np.stack((-half_m * np.sin(t), -2.0 * width_m * np.sin(2.0 * t)), axis=1)
        return np.array(center_ned_m) + offset @ rotation, first @ rotation, second @ rotation

    return _pieces_of_shape(shape, math.tau * rounds, 2 * math.ceil(rounds * PIECES_PER_TURN))


def _pieces_of_shape(shape: Shape, sweep: float, count: int) -> Pieces:
    """Pieces of equal length along a shape."""
    angles = np.linspace(0.0, sweep, count * SAMPLES_PER_PIECE + 1)
    middle = 0.5 * (angles[1:] + angles[:-1])
    speeds = [np.sqrt((shape(at)[1] ** 2).sum(axis=1)) for at in (angles, middle)]
    steps = np.diff(angles) / 6.0 * (speeds[0][:-1] + 4.0 * speeds[1] + speeds[0][1:])
    lengths = np.concatenate(([0.0], np.cumsum(steps)))
    knots_m = np.linspace(0.0, lengths[-1], count + 1)
    position, first, second = shape(np.interp(knots_m, lengths, angles))
    speed = np.sqrt((first**2).sum(axis=1))[:, None]
    tangent = first / speed
    curvature = (second - tangent * (tangent * second).sum(axis=1)[:, None]) / speed**2
    values = np.stack((position, tangent, curvature), axis=1)
    control_points = np.zeros((count, 6, 4))  # the fourth coordinate, yaw, is set later: see headings.py
    spans = np.diff(knots_m)
    control_points[:, :, :3] = hermite(values[:-1], values[1:], spans)
    stops = np.zeros(count + 1, dtype=bool)
    stops[[0, -1]] = True
    return Pieces(control_points, spans, stops, np.array([0, count]))


def _check(name: str, value: float, minimum: float, maximum: float) -> None:
    if not minimum <= value <= maximum:
        raise PlanError(
            f"field {name}", f"{value} is not between {minimum:g} and {maximum:g}", "Correct this value."
        )


def _check_center(center_ned_m: Vector3) -> None:
    if not all(abs(axis) <= MAX_COORDINATE_M for axis in center_ned_m):
        raise PlanError(
            "field center_ned_m",
            f"{center_ned_m} is not finite, or a coordinate exceeds {MAX_COORDINATE_M:.0f} m",
            "Give metres from the local origin.",
        )
