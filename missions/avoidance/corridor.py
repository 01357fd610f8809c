"""What of the remembered obstacles lies in the way."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.avoidance.memory import along, nearest_m
from missions.avoidance.scans import STEEP, Scan
from missions.avoidance.values import Here, Wanted
from missions.frames import Vector3

CLEARANCE_M = 1.2
"""Over the ground, from the vehicle's centre to anything measured at its altitude."""
NEAREST_M = 0.7
"""The clearance where the vehicle or its goal is nearer to something already."""
OVER_M, BELOW_M = 1.0, 0.4
"""It climbs so far above what is in the way; what reaches less than `BELOW_M` below it is in the way."""
ABOVE_M = 0.9 * OVER_M
"""It flies over what it has climbed above by so much: it may be higher than was measured yet."""


@dataclass(frozen=True, slots=True)
class InTheWay:
    """Between the vehicle and where it is to go."""

    highest_m: float
    """Above the local origin."""
    first_m: float
    """Distance to the first that the vehicle has not yet climbed above; infinite where there is none."""
    clearance_m: float
    """What can be kept to the sides: less where the vehicle or its goal is near something already."""


def in_the_way(points: NDArray[np.float64], here: Here, wanted: Wanted, unsure_m: float) -> InTheWay | None:
    """What the way to the wanted position, and on along the path, meets; None: it is free.

    Args:
        points: (N, 3) north, east, top: all that reaches the lower end of the way.
        here: the vehicle.
        wanted: where it is to go.
        unsure_m: by how much what was measured may be higher.
    """
    if not len(points):
        return None
    places = (here.position_ned_m, wanted.position_ned_m, *wanted.ahead_ned_m)
    up_m, goal_up_m, top_m = -here.position_ned_m[2], -wanted.position_ned_m[2], points[:, 2]
    last = places[-1]
    beside = points[top_m > up_m - BELOW_M]
    at_goal = points[top_m > -last[2] - BELOW_M]
    near_m = min(nearest_m(beside, here.position_ned_m[:2]), nearest_m(at_goal, last[:2])) - 0.1
    clearance_m = max(NEAREST_M, min(CLEARANCE_M, near_m))
    away_m = np.hypot(points[:, 0] - here.position_ned_m[0], points[:, 1] - here.position_ned_m[1])
    found = (away_m < CLEARANCE_M) & (top_m <= up_m - BELOW_M)
    if goal_up_m < up_m - BELOW_M:  # coming down beside something that was not seen before
        found |= away_m < clearance_m
    first_m, flown_m = math.inf, 0.0
    for begin, end in itertools.pairwise(places):
        view, length_m = along(points, begin[:2], end[:2]), math.dist(begin[:2], end[:2])
        met = (view.along_m > 0.0) & (view.along_m <= length_m) & (view.beside_m < clearance_m)
        met |= view.beyond_m < NEAREST_M
        met &= top_m > min(-begin[2], -end[2]) - BELOW_M
        found |= met
        level = met & (top_m + unsure_m > up_m - ABOVE_M)
        if level.any():
            first_m = min(first_m, flown_m + float(view.along_m[level].min()))
        flown_m += length_m
    return InTheWay(float(top_m[found].max()) + unsure_m, first_m, clearance_m) if found.any() else None


def first_on_line(scans: Iterable[Scan], here: Vector3, there: Vector3) -> float | None:
    """Distance over the ground to the first that scans measure on a straight way; None: nothing on it.

    Args:
        scans: of now, taken here.
        here: where the vehicle is.
        there: where the way ends.
    """
    hits = [
        (here[0] + n * far_m, here[1] + e * far_m, -(here[2] + d * far_m))
        for scan in scans
        for (n, e, d), far_m in zip(scan.directions_ned, scan.distances_m, strict=True)
        if far_m is not None and d <= STEEP
    ]
    if not hits:
        return None
    view, length_m = along(np.array(hits), here[:2], there[:2]), math.dist(here[:2], there[:2])
    met = (view.along_m > 0.0) & (view.along_m <= length_m + NEAREST_M) & (view.beside_m < NEAREST_M)
    met &= view.top_m > min(-here[2], -there[2]) - BELOW_M
    return float(view.along_m[met].min()) if met.any() else None
