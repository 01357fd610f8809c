"""Computes a trajectory from points or from a path: first the geometry, then the heading, then the times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from missions.errors import PlanError
from missions.trajectory import headings, lines
from missions.trajectory.curve import TimedCurve
from missions.trajectory.headings import AlongPath, LookAt
from missions.trajectory.limits import MotionLimits
from missions.trajectory.pieces import Pieces, power_basis
from missions.trajectory.points import PassPoint, check_points, merge_equal_positions
from missions.trajectory.profile import slow_bends, time_law

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_X = (_NODES + 1.0) / 2.0
_BASIS = np.stack([c * _X**k * (1.0 - _X) ** (4 - k) for k, c in enumerate((1, 4, 6, 4, 1))], axis=1)
"""(8, 5) Bernstein polynomials of degree 4 at the nodes of Gauss's quadrature."""
Heading = AlongPath | LookAt | float | None
"""Along the path, towards a position, a fixed yaw [rad], or not controlled."""


def curve_through_points(
    points: Sequence[PassPoint],
    limits: MotionLimits | None = None,
    *,
    exact: bool = False,
    heading: Heading = None,
) -> TimedCurve:
    """The trajectory through points, at rest at both ends.

    Args:
        points: one or more points; a single point gives a hold without duration.
        limits: limits of the motion.
        exact: true: one smooth curve exactly through every point; false: straight legs with bends.
        heading: heading of the path; allowed only if no point has a yaw. None: the points' yaws, or not
            controlled.

    Raises:
        PlanError: A point cannot be flown to; the error names the point and the fix.
    """
    check_points(points)
    kept, merged_index = merge_equal_positions(points)
    yaws = [point.yaw_ned_rad for point in kept]
    has_yaws = any(yaw is not None for yaw in yaws)
    if has_yaws and heading is not None:
        place = f"point {next(n for n, point in enumerate(points, 1) if point.yaw_ned_rad is not None)}"
        raise PlanError(
            place, "it has a yaw, but the trajectory also has a heading", "Remove the yaw or the heading."
        )
    if len(kept) == 1:
        yaw = yaws[0] if has_yaws else heading if isinstance(heading, float) else None
        return _hold(kept[0], yaw, len(merged_index))
    limits = limits or MotionLimits()
    pieces = lines.smooth_curve(kept) if exact else lines.straight_legs(kept)
    slow_points = set() if exact else slow_bends(pieces, limits)
    if slow_points:
        kept = [replace(point, stop=point.stop or k in slow_points) for k, point in enumerate(kept)]
        pieces = lines.straight_legs(kept)
    if has_yaws:
        pieces = headings.with_point_yaws(pieces, yaws)
        heading = 0.0
    marks = pieces.marks[np.array(merged_index)]
    return curve_along_path(
        Pieces(pieces.points, pieces.spans, pieces.stops, marks), limits, heading, has_yaw=has_yaws
    )


def curve_along_path(
    pieces: Pieces, limits: MotionLimits | None = None, heading: Heading = None, *, has_yaw: bool = False
) -> TimedCurve:
    """The fastest flight along a path within the limits.

    Args:
        pieces: the path.
        limits: limits of the motion.
        heading: heading; not used if the path already has a yaw.
        has_yaw: whether the path has a yaw.
    """
    if not has_yaw:
        if isinstance(heading, AlongPath):
            pieces = headings.with_yaw_along_path(pieces, heading)
        elif isinstance(heading, LookAt):
            pieces = headings.with_yaw_towards(pieces, heading)
        elif heading is not None:
            points = pieces.points.copy()
            points[:, :, 3] = heading
            pieces = Pieces(points, pieces.spans, pieces.stops, pieces.marks)
    law = time_law(pieces, limits or MotionLimits())
    boundaries = np.concatenate(([0.0], np.cumsum(pieces.spans)))
    curve = TimedCurve(
        coefficients=power_basis(pieces),
        starts=boundaries[:-1],
        spans=pieces.spans,
        phase_start_s=law.start_s,
        phase_parameter=law.parameter,
        phase_speed=law.speed,
        phase_acceleration=law.acceleration,
        phase_jerk=law.jerk,
        duration_s=law.duration_s,
        length_m=_length_m(pieces),
        point_times_s=(),
        has_yaw=has_yaw or heading is not None,
    )
    return replace(
        curve, point_times_s=tuple(curve.time_at(float(boundaries[mark])) for mark in pieces.marks)
    )


def _length_m(pieces: Pieces) -> float:
    """Length of the path: Gauss quadrature of the first derivative over each piece."""
    control = pieces.derivative(1)[:, :, :3]
    speed = np.sqrt((np.einsum("qk,nkd->nqd", _BASIS, control) ** 2).sum(axis=2))
    return float((speed @ _WEIGHTS / 2.0 * pieces.spans).sum())


def _hold(point: PassPoint, yaw_ned_rad: float | None, count: int) -> TimedCurve:
    coefficients = np.zeros((1, 6, 4))
    coefficients[0, 0] = (*point.position_ned_m, yaw_ned_rad or 0.0)
    empty, unit_span = np.zeros(0), np.ones(1)
    return TimedCurve(
        coefficients, np.zeros(1), unit_span, empty, empty, empty, empty, empty, 0.0, 0.0, (0.0,) * count,
        yaw_ned_rad is not None,
    )  # fmt: skip
