"""The points that a trajectory passes, and their checks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from missions.errors import PlanError
from missions.frames import Vector3

MAX_POINTS = 10_000
MAX_COORDINATE_M = 1e6
"""Largest coordinate [m]; a local frame is accurate only near its origin."""
SAME_POINT_M = 1e-3
"""Points closer than this count as the same position."""


@dataclass(frozen=True, slots=True)
class PassPoint:
    """A point to fly through."""

    position_ned_m: Vector3
    yaw_ned_rad: float | None = None
    """Heading at the point; None: interpolated between the neighbouring points."""
    stop: bool = False
    """Whether the vehicle stops exactly at the point."""
    corner_m: float = 1.0
    """Largest distance of the rounded corner from the point; 0: stop at the point. The vehicle also stops if
    a stop takes less time than the rounded corner."""


def check_points(points: Sequence[PassPoint]) -> None:
    """Checks that the points can be flown.

    Raises:
        PlanError: There is no point, there are too many, or a value is not finite or too large; the error
            names the point.
    """
    if not points:
        raise PlanError("the trajectory", "it has no points", "Add at least one point.")
    if len(points) > MAX_POINTS:
        reason = f"{len(points)} points, the maximum is {MAX_POINTS}"
        raise PlanError("the trajectory", reason, "Split the trajectory.")
    for number, point in enumerate(points, 1):
        if not all(abs(axis) <= MAX_COORDINATE_M for axis in point.position_ned_m):
            reason = (
                f"position {point.position_ned_m} is not finite, or a coordinate exceeds "
                f"{MAX_COORDINATE_M:.0f} m"
            )
            raise PlanError(f"point {number}", reason, "Give metres from the local origin.")
        if point.yaw_ned_rad is not None and not abs(point.yaw_ned_rad) <= 1e3:
            reason = f"yaw {point.yaw_ned_rad} is not a finite angle"
            raise PlanError(f"point {number}", reason, "Give an angle in radians, or omit the yaw.")
        if not 0.0 <= point.corner_m <= MAX_COORDINATE_M:
            reason = f"corner {point.corner_m} m is not from 0 to {MAX_COORDINATE_M:.0f} m"
            raise PlanError(f"point {number}", reason, "Give metres, 0 or more.")


def merge_equal_positions(points: Sequence[PassPoint]) -> tuple[list[PassPoint], list[int]]:
    """Merges consecutive points at the same position. If their yaws differ, the points remain, with exactly
    the same position and a stop; the vehicle turns there.

    Returns:
        The points, and for each given point the index of its merged point.
    """
    kept: list[PassPoint] = []
    merged_index: list[int] = []
    for point in points:
        if kept and math.dist(kept[-1].position_ned_m, point.position_ned_m) < SAME_POINT_M:
            previous = kept[-1]
            if previous.yaw_ned_rad is None or point.yaw_ned_rad in (None, previous.yaw_ned_rad):
                yaw = previous.yaw_ned_rad if point.yaw_ned_rad is None else point.yaw_ned_rad
                corner_m = min(previous.corner_m, point.corner_m)
                kept[-1] = PassPoint(previous.position_ned_m, yaw, previous.stop or point.stop, corner_m)
                merged_index.append(len(kept) - 1)
                continue
            point = PassPoint(previous.position_ned_m, point.yaw_ned_rad, True, 0.0)
            kept[-1] = PassPoint(previous.position_ned_m, previous.yaw_ned_rad, True, 0.0)
        kept.append(point)
        merged_index.append(len(kept) - 1)
    return kept, merged_index
