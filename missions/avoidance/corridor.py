"""Which remembered obstacles block the planned motion."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.avoidance.memory import along_line, nearest_m
from missions.avoidance.scans import LEVEL_MAX_SINE, Scan
from missions.avoidance.values import MotionState, WantedMotion
from missions.frames import Vector3

CLEARANCE_M = 1.2
"""Horizontal distance from the vehicle's centre to any obstacle at its altitude."""
MIN_CLEARANCE_M = 0.7
"""Minimum clearance, used when the vehicle or its goal is already near an obstacle."""
TOP_CLEARANCE_M, BLOCKING_BELOW_M = 1.0, 0.4
"""The vehicle climbs to `TOP_CLEARANCE_M` above the top of an obstacle. An obstacle blocks the path if its
top is less than `BLOCKING_BELOW_M` below the vehicle."""
MIN_TOP_CLEARANCE_M = 0.9 * TOP_CLEARANCE_M
"""Smallest height above the measured top at which the vehicle may fly over an obstacle."""


@dataclass(frozen=True, slots=True)
class BlockingObstacles:
    """Obstacles between the vehicle and its goal."""

    highest_m: float
    """Altitude of the highest top, above the local origin."""
    first_m: float
    """Distance to the first obstacle over which the vehicle is still too low to fly; infinite without such an
    obstacle."""
    clearance_m: float
    """Clearance to the sides; smaller if the vehicle or its goal is already near an obstacle."""


def blocking_obstacles(
    points: NDArray[np.float64], current: MotionState, wanted: WantedMotion, top_uncertainty_m: float
) -> BlockingObstacles | None:
    """Obstacles between the vehicle and the wanted position, and on the path after it; None: no obstacle.

    Args:
        points: (N, 3) north, east and altitude of the tops of obstacles, in the local frame; only obstacles
            whose top is above the lower end of the path.
        current: the vehicle's position and motion.
        wanted: the wanted motion.
        top_uncertainty_m: how much higher the obstacles may be than measured.
    """
    if not len(points):
        return None
    path = (current.position_ned_m, wanted.position_ned_m, *wanted.ahead_ned_m)
    up_m, goal_up_m, top_m = -current.position_ned_m[2], -wanted.position_ned_m[2], points[:, 2]
    last = path[-1]
    at_altitude = points[top_m > up_m - BLOCKING_BELOW_M]
    at_end = points[top_m > -last[2] - BLOCKING_BELOW_M]
    near_m = min(nearest_m(at_altitude, current.position_ned_m[:2]), nearest_m(at_end, last[:2])) - 0.1
    clearance_m = max(MIN_CLEARANCE_M, min(CLEARANCE_M, near_m))
    away_m = np.hypot(points[:, 0] - current.position_ned_m[0], points[:, 1] - current.position_ned_m[1])
    blocking = (away_m < CLEARANCE_M) & (top_m <= up_m - BLOCKING_BELOW_M)
    if goal_up_m < up_m - BLOCKING_BELOW_M:  # a descent next to an obstacle that was not measured before
        blocking |= away_m < clearance_m
    first_m, leg_start_m = math.inf, 0.0
    for begin, end in itertools.pairwise(path):
        columns, length_m = along_line(points, begin[:2], end[:2]), math.dist(begin[:2], end[:2])
        on_leg = (columns.along_m > 0.0) & (columns.along_m <= length_m) & (columns.across_m < clearance_m)
        on_leg |= columns.from_end_m < MIN_CLEARANCE_M
        on_leg &= top_m > min(-begin[2], -end[2]) - BLOCKING_BELOW_M
        blocking |= on_leg
        too_low = on_leg & (top_m + top_uncertainty_m > up_m - MIN_TOP_CLEARANCE_M)
        if too_low.any():
            first_m = min(first_m, leg_start_m + float(columns.along_m[too_low].min()))
        leg_start_m += length_m
    return (
        BlockingObstacles(float(top_m[blocking].max()) + top_uncertainty_m, first_m, clearance_m)
        if blocking.any()
        else None
    )


def first_on_line(scans: Iterable[Scan], start: Vector3, end: Vector3) -> float | None:
    """Horizontal distance to the first obstacle that scans measure on a straight line; None: no obstacle.

    Args:
        scans: the newest scan of each sensor, taken at `start`.
        start: the vehicle's position (NED).
        end: the end of the line (NED).
    """
    hits = [
        (start[0] + n * range_m, start[1] + e * range_m, -(start[2] + d * range_m))
        for scan in scans
        for (n, e, d), range_m in zip(scan.directions_ned, scan.distances_m, strict=True)
        if range_m is not None and d <= LEVEL_MAX_SINE
    ]
    if not hits:
        return None
    columns, length_m = along_line(np.array(hits), start[:2], end[:2]), math.dist(start[:2], end[:2])
    on_leg = (
        (columns.along_m > 0.0)
        & (columns.along_m <= length_m + MIN_CLEARANCE_M)
        & (columns.across_m < MIN_CLEARANCE_M)
    )
    on_leg &= columns.top_m > min(-start[2], -end[2]) - BLOCKING_BELOW_M
    return float(columns.along_m[on_leg].min()) if on_leg.any() else None
