"""Which heading leads around what is in the way."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from missions.avoidance.scans import Scan, seen_m
from missions.avoidance.values import Allowed, Here, Wanted

Side = Literal["left", "right"]
"""Of the obstacle, seen by the vehicle."""
STEP_RAD = math.radians(10.0)
STEPS = 16
"""160° to each side: further is back."""
LOOK_M = 6.0
LEAST_FREE_M = 2.0
"""Beyond the clearance: less is no way, and `LOOK_M` is better."""
FENCE_MARGIN_M = 2.0


def choose_heading(
    points: NDArray[np.float64],
    here: Here,
    wanted: Wanted,
    scans: tuple[Scan, ...],
    allowed: Allowed,
    side: Side | None,
    clearance_m: float,
) -> tuple[float, Side | None, float] | None:
    """The heading nearest to the goal's that is seen, free and inside the fence; None: there is none.

    Args:
        points: (N, 3) what reaches the vehicle's altitude.
        here: the vehicle.
        wanted: its goal.
        scans: of now; a heading that no sensor looks into is no way.
        allowed: the fences.
        side: the one begun with; None: the nearer of both.
        clearance_m: to be kept.

    Returns:
        The heading [rad], its side (None: still towards the goal), and how far it is free [m].
    """
    n, e = here.position_ned_m[:2]
    goal = math.atan2(wanted.position_ned_m[1] - e, wanted.position_ned_m[0] - n)
    sides: tuple[Side, ...] = ("right", "left") if side is None else (side,)
    for least_m in (LOOK_M, LEAST_FREE_M):
        for turn in range(STEPS + 1):
            for name in sides:
                heading = goal + (turn if name == "right" else -turn) * STEP_RAD
                free_m = _free_m(points, (n, e), heading, clearance_m)
                if free_m < least_m or seen_m(scans, heading) is None or _leaves(allowed, (n, e), heading):
                    continue
                return heading, name if turn else side, free_m
    return None


def _free_m(
    points: NDArray[np.float64], at_ne_m: tuple[float, float], heading: float, clearance_m: float
) -> float:
    """How far the vehicle may fly into a heading before it must have stopped."""
    if not len(points):
        return LOOK_M
    un, ue = math.cos(heading), math.sin(heading)
    north, east = points[:, 0] - at_ne_m[0], points[:, 1] - at_ne_m[1]
    ahead = north * un + east * ue
    met = (ahead > 0.0) & (np.abs(east * un - north * ue) < clearance_m)
    return min(LOOK_M, float(ahead[met].min()) - clearance_m) if met.any() else LOOK_M


def _leaves(allowed: Allowed, at_ne_m: tuple[float, float], heading: float) -> bool:
    region = allowed.region
    if allowed.fence is not None:
        n, e = (at_ne_m[0] + LOOK_M * math.cos(heading), at_ne_m[1] + LOOK_M * math.sin(heading))
        if allowed.fence.is_left_between(at_ne_m, (n, e)):
            return True
    if not region.is_limited_horizontally:
        return False
    if region.breach(at_ne_m) is not None:
        return True
    return region.distance_to_edge_m(at_ne_m, (math.cos(heading), math.sin(heading))) < FENCE_MARGIN_M
