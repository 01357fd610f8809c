"""Paths through points: straight legs with rounded corners (bends), or one smooth curve."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from missions.trajectory.pieces import Array, Pieces, hermite
from missions.trajectory.points import SAME_POINT_M, PassPoint

REVERSAL_COSINE = math.cos(math.radians(170.0))
"""Cosine of the sharpest turn with a bend. The vehicle stops at sharper turns, where a bend would nearly be a
cusp."""
STRAIGHT_TOLERANCE = 1e-9
"""Smaller changes of direction do not count as corners."""
MIN_CORNER_M = 0.01
"""At a corner with a smaller `corner_m` the vehicle stops."""
THIRD_CONTROL = 0.1
"""Position of the third control point of a bend, as a fraction of the length that the bend cuts off the leg.
0.1 gave the shortest flight times for bends of 30° to 150°."""
SECOND_CONTROL = (1.0 + THIRD_CONTROL) / 2.0
"""Position of the second control point: halfway between the first and the third, so that the curvature starts
at zero."""
DEVIATION = (1.0 + 5.0 * SECOND_CONTROL + 10.0 * THIRD_CONTROL) / 32.0
"""Distance of a bend's middle from the corner: DEVIATION · cut length · |difference of the directions|."""
PARTS_PER_LEG = 4
"""Parts of each leg of a smooth curve; each part has its own speed limit."""


def straight_legs(points: Sequence[PassPoint]) -> Pieces:
    """Straight legs with rounded corners; each bend passes its point within `corner_m`.

    Points at the same position (made by `merge_equal_positions`) become a turn on the spot; `headings.py`
    adds the yaw.
    """
    positions_ned_m = np.array([point.position_ned_m for point in points])
    steps = np.diff(positions_ned_m, axis=0)
    lengths_m = np.sqrt((steps**2).sum(axis=1))
    has_length = lengths_m >= SAME_POINT_M
    directions = steps / np.where(has_length, lengths_m, 1.0)[:, None]
    cuts, stops = _corners(points, directions, lengths_m, has_length)
    controls: list[Array] = []
    spans: list[float] = []
    stops_at = [True]
    marks = [0]

    def add(control_points: Array, span: float, stop_after: bool) -> None:
        controls.append(control_points)
        spans.append(span)
        stops_at.append(stop_after)

    fractions = np.linspace(0.0, 1.0, 6)[:, None]
    for leg in range(len(lengths_m)):
        start_cut_m, end_cut_m = cuts[leg], cuts[leg + 1]
        if not has_length[leg]:
            add(np.repeat(positions_ned_m[leg][None], 6, axis=0), 1.0, True)
            marks.append(len(spans))
            continue
        d, length_m = directions[leg], float(lengths_m[leg] - start_cut_m - end_cut_m)
        if length_m > 1e-9 * lengths_m[leg]:
            start = positions_ned_m[leg] + d * start_cut_m
            add(start + fractions * (d * length_m), length_m, bool(stops[leg + 1]) and end_cut_m == 0.0)
        if end_cut_m > 0.0:
            span = 5.0 * (1.0 - SECOND_CONTROL) * end_cut_m
            arms = end_cut_m * np.array([1.0, SECOND_CONTROL, THIRD_CONTROL])[:, None]
            before_corner, after_corner = (
                positions_ned_m[leg + 1] - arms * d,
                positions_ned_m[leg + 1] + arms[::-1] * directions[leg + 1],
            )
            left, right = _halves(np.concatenate((before_corner, after_corner)))
            add(left, span / 2.0, False)
            marks.append(len(spans))
            add(right, span / 2.0, False)
        else:
            marks.append(len(spans))
    return _pieces(controls, spans, stops_at, marks)


def _corners(
    points: Sequence[PassPoint], directions: Array, lengths_m: Array, has_length: NDArray[np.bool_]
) -> tuple[list[float], list[bool]]:
    """The length that each corner cuts off its legs [m], and whether the vehicle stops there."""
    cuts, stops = [0.0] * len(points), [True] * len(points)
    for k in range(1, len(points) - 1):
        difference = float(np.sqrt(((directions[k] - directions[k - 1]) ** 2).sum()))
        cosine = float(directions[k] @ directions[k - 1])
        if points[k].stop or not (has_length[k - 1] and has_length[k]):
            continue
        if difference < STRAIGHT_TOLERANCE:
            stops[k] = False
        elif cosine > REVERSAL_COSINE and points[k].corner_m >= MIN_CORNER_M:
            stops[k] = False
            max_cut_m = 0.5 * min(float(lengths_m[k - 1]), float(lengths_m[k]))
            cuts[k] = min(points[k].corner_m / (DEVIATION * difference), max_cut_m)
    return cuts, stops


def _halves(control: Array) -> tuple[Array, Array]:
    """Splits a curve in the middle, by De Casteljau's algorithm."""
    left, right = [control[0]], [control[-1]]
    while len(control) > 1:
        control = (control[:-1] + control[1:]) / 2.0
        left.append(control[0])
        right.append(control[-1])
    return np.array(left), np.array(right[::-1])


def smooth_curve(points: Sequence[PassPoint]) -> Pieces:
    """One curve exactly through all points: a cubic spline over chord length from stop to stop.

    Its second derivative is continuous, and zero at stops. Between the points, the curve is not straight.
    """
    controls: list[Array] = []
    spans: list[float] = []
    stops_at = [True]
    marks = [0]
    start = 0
    while start < len(points) - 1:
        end = start + 1
        position_ned_m = np.array(points[start].position_ned_m)
        if math.dist(points[start].position_ned_m, points[end].position_ned_m) < SAME_POINT_M:
            controls.append(np.repeat(position_ned_m[None], 6, axis=0))
            spans.append(1.0)
            stops_at.append(True)
            marks.append(len(spans))
            start = end
            continue
        while end < len(points) - 1 and not points[end].stop:
            end += 1
        positions_ned_m = np.array([point.position_ned_m for point in points[start : end + 1]])
        chords_m = np.sqrt((np.diff(positions_ned_m, axis=0) ** 2).sum(axis=1))
        second_derivative = _spline(positions_ned_m, chords_m)
        slope = np.diff(positions_ned_m, axis=0) / chords_m[:, None]
        first_start = slope - chords_m[:, None] * (2.0 * second_derivative[:-1] + second_derivative[1:]) / 6.0
        first_end = slope + chords_m[:, None] * (second_derivative[:-1] + 2.0 * second_derivative[1:]) / 6.0
        left = np.stack((positions_ned_m[:-1], first_start, second_derivative[:-1]), axis=1)
        right = np.stack((positions_ned_m[1:], first_end, second_derivative[1:]), axis=1)
        controls += list(hermite(left, right, chords_m))
        spans += chords_m.tolist()
        stops_at += [False] * (len(chords_m) - 1) + [True]
        marks += range(marks[-1] + 1, marks[-1] + len(chords_m) + 1)
        start = end
    curve_pieces = _pieces(controls, spans, stops_at, marks)
    return curve_pieces.split(np.full(len(spans), PARTS_PER_LEG))


def _spline(positions_ned_m: Array, chords_m: Array) -> Array:
    """The second derivatives of the natural cubic spline (solves the tridiagonal system)."""
    count = len(positions_ned_m)
    second_derivative = np.zeros_like(positions_ned_m)
    if count < 3:
        return second_derivative
    slopes = np.diff(positions_ned_m, axis=0) / chords_m[:, None]
    right_side = 6.0 * np.diff(slopes, axis=0)
    diagonal = (2.0 * (chords_m[:-1] + chords_m[1:])).tolist()
    off_diagonal = chords_m[1:-1].tolist()
    for k in range(1, count - 2):
        factor = off_diagonal[k - 1] / diagonal[k - 1]
        diagonal[k] -= factor * off_diagonal[k - 1]
        right_side[k] -= factor * right_side[k - 1]
    second_derivative[count - 2] = right_side[-1] / diagonal[-1]
    for k in range(count - 4, -1, -1):
        second_derivative[k + 1] = (right_side[k] - off_diagonal[k] * second_derivative[k + 2]) / diagonal[k]
    return second_derivative


def _pieces(controls: list[Array], spans: list[float], stops_at: list[bool], marks: list[int]) -> Pieces:
    points = np.zeros((len(controls), 6, 4))
    points[:, :, :3] = np.array(controls)
    return Pieces(points, np.array(spans), np.array(stops_at), np.array(marks))
