"""Chooses the heading that leads around an obstacle."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from missions.avoidance.scans import Scan, sensor_range_m
from missions.avoidance.values import DetourLimits, MotionState, WantedMotion

Side = Literal["left", "right"]
"""Side of the obstacle, as seen from the vehicle."""
STEP_RAD = math.radians(10.0)
STEPS = 16
"""160° to each side; larger turns lead backwards."""
LOOK_AHEAD_M = 6.0
MIN_FREE_M = 2.0
"""Free distance beyond the clearance that a heading must have; `LOOK_AHEAD_M` is preferred."""
FENCE_MARGIN_M = 2.0


def choose_heading(
    points: NDArray[np.float64],
    current: MotionState,
    wanted: WantedMotion,
    scans: tuple[Scan, ...],
    limits: DetourLimits,
    side: Side | None,
    clearance_m: float,
) -> tuple[float, Side | None, float] | None:
    """The usable heading nearest to the direction of the goal; None: no heading is usable.

    A heading is usable if a sensor measures it, no obstacle is near, and the line stays inside the fence.

    Args:
        points: (N, 3) obstacles that reach the vehicle's altitude.
        current: the vehicle's position and motion.
        wanted: the wanted motion.
        scans: the newest scan of each sensor.
        limits: the fence and the allowed region.
        side: the side that the detour started on; None: either side.
        clearance_m: distance to keep from obstacles.

    Returns:
        The heading [rad], its side (None: straight towards the goal), and its free distance [m].
    """
    n, e = current.position_ned_m[:2]
    goal = math.atan2(wanted.position_ned_m[1] - e, wanted.position_ned_m[0] - n)
    sides: tuple[Side, ...] = ("right", "left") if side is None else (side,)
    for required_free_m in (LOOK_AHEAD_M, MIN_FREE_M):
        for step in range(STEPS + 1):
            for candidate in sides:
                heading = goal + (step if candidate == "right" else -step) * STEP_RAD
                free_m = _free_m(points, (n, e), heading, clearance_m)
                if (
                    free_m < required_free_m
                    or sensor_range_m(scans, heading) is None
                    or _leaves_allowed_area(limits, (n, e), heading)
                ):
                    continue
                return heading, candidate if step else side, free_m
    return None


def _free_m(
    points: NDArray[np.float64], at_ne_m: tuple[float, float], heading: float, clearance_m: float
) -> float:
    """How far the vehicle may fly on a heading before it must stop."""
    if not len(points):
        return LOOK_AHEAD_M
    un, ue = math.cos(heading), math.sin(heading)
    north, east = points[:, 0] - at_ne_m[0], points[:, 1] - at_ne_m[1]
    ahead = north * un + east * ue
    blocking = (ahead > 0.0) & (np.abs(east * un - north * ue) < clearance_m)
    return min(LOOK_AHEAD_M, float(ahead[blocking].min()) - clearance_m) if blocking.any() else LOOK_AHEAD_M


def _leaves_allowed_area(limits: DetourLimits, at_ne_m: tuple[float, float], heading: float) -> bool:
    """Whether the line on a heading leaves the fence, or comes too near to the edge of the region."""
    region = limits.region
    if limits.fence is not None:
        n, e = (at_ne_m[0] + LOOK_AHEAD_M * math.cos(heading), at_ne_m[1] + LOOK_AHEAD_M * math.sin(heading))
        if limits.fence.line_leaves(at_ne_m, (n, e)):
            return True
    if not region.is_limited_horizontally:
        return False
    if region.breach(at_ne_m) is not None:
        return True
    return region.distance_to_edge_m(at_ne_m, (math.cos(heading), math.sin(heading))) < FENCE_MARGIN_M
