"""Distance of a planned path from the obstacles of a plan or an offboard mission."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from missions.geodesy import LocalOrigin
from missions.values import Obstacle

Array = NDArray[np.float64]
NEAR_M = 2.0
"""Distance below which a path is reported as near an obstacle [m]."""
COARSE_M = 2.0
FINE_STEPS = 20
MAX_PARTS = 2000
"""Beside an obstacle, a leg is divided every COARSE_M, into MAX_PARTS at most; near it, each of these parts
is divided into FINE_STEPS."""
TOUCHING_M = 0.01
"""A path nearer than this passes through the obstacle."""


def obstacle_name(obstacle: Obstacle, index: int) -> str:
    """The name of an obstacle in messages."""
    return obstacle.name.strip() or f"obstacle {index + 1}"


def corners_ne_m(obstacle: Obstacle, origin: LocalOrigin) -> tuple[tuple[float, float], ...]:
    """The corners of an obstacle: north and east of an origin [m]."""
    corners = [origin.to_ned(point.lat_deg, point.lon_deg, 0.0) for point in obstacle.polygon]
    return tuple((north, east) for north, east, _ in corners)


def is_valid(obstacle: Obstacle, origin: LocalOrigin) -> bool:
    """Whether the obstacle has an area, and no two of its sides cross."""
    shape = Polygon(corners_ne_m(obstacle, origin))
    return bool(shape.is_valid) and shape.area > 0.0


@dataclass(frozen=True, slots=True)
class Clearance:
    """Distance between a path and one obstacle."""

    index: int
    """Index of the obstacle in the document."""
    name: str
    distance_m: float
    """Less than `TOUCHING_M`: the path passes through the obstacle."""
    north_m: float
    east_m: float
    """North and east of the position of the path that is nearest to the obstacle."""

    @property
    def passes_through(self) -> bool:
        """Whether the path passes through the obstacle."""
        return self.distance_m < TOUCHING_M


class ObstacleShapes:
    """The obstacles of one document in a local frame.

    Args:
        obstacles: obstacles of the document.
        origin: origin of the local frame.
        home_amsl_m: altitude of home; None: unknown. Without this altitude, obstacles whose top is given
            above home are ignored.
    """

    def __init__(self, obstacles: Sequence[Obstacle], origin: LocalOrigin, home_amsl_m: float | None) -> None:
        self._shapes: list[tuple[int, str, BaseGeometry, float]] = []
        for index, obstacle in enumerate(obstacles):
            top_amsl_m = obstacle.top.amsl_m(home_amsl_m)
            if top_amsl_m is None:
                continue
            shape = shapely.make_valid(Polygon(corners_ne_m(obstacle, origin)))
            shapely.prepare(shape)
            top_down_m = origin.alt_amsl_m - top_amsl_m
            self._shapes.append((index, obstacle_name(obstacle, index), shape, top_down_m))

    def clearances(self, path_ned_m: Array) -> Iterator[Clearance]:
        """The obstacles near a path, each with the nearest position of the path.

        Args:
            path_ned_m: (N, 3) positions, joined by straight lines.
        """
        for index, name, shape, top_down_m in self._shapes:
            if not _comes_near(path_ned_m, shape, top_down_m):
                continue
            nearest = _nearest(path_ned_m, shape, top_down_m)
            if nearest is not None and nearest[0] < NEAR_M:
                yield Clearance(index, name, *nearest)


def _comes_near(path_ned_m: Array, shape: BaseGeometry, top_down_m: float) -> bool:
    """Whether the bounding boxes of the path and of the obstacle are near each other."""
    south, west, north, east = shape.bounds
    low_n, low_e, _ = (path_ned_m.min(axis=0) - NEAR_M).tolist()
    high_n, high_e, high_d = (path_ned_m.max(axis=0) + NEAR_M).tolist()
    beside = low_n > north or high_n < south or low_e > east or high_e < west
    return not beside and high_d > top_down_m


def _nearest(path_ned_m: Array, shape: BaseGeometry, top_down_m: float) -> tuple[float, float, float] | None:
    """Smallest distance of the path from an obstacle, and north and east of that position; None: no leg comes
    near it."""
    if len(path_ned_m) == 1:
        return _nearest_of(path_ned_m, shape, top_down_m)
    ends = np.stack([path_ned_m[:-1], path_ned_m[1:]], axis=1)
    is_near = shapely.distance(shapely.linestrings(ends[:, :, :2]), shape) < NEAR_M
    parts = (_positions_near(start, end, shape) for start, end in ends[is_near])
    found = (_nearest_of(positions, shape, top_down_m) for positions in parts if len(positions))
    return min(found, default=None)


def _nearest_of(positions: Array, shape: BaseGeometry, top_down_m: float) -> tuple[float, float, float]:
    distance_m = np.hypot(_horizontal_m(positions, shape), np.maximum(top_down_m - positions[:, 2], 0.0))
    nearest = int(distance_m.argmin())
    return float(distance_m[nearest]), float(positions[nearest, 0]), float(positions[nearest, 1])


def _horizontal_m(positions: Array, shape: BaseGeometry) -> Array:
    return np.asarray(shapely.distance(shapely.points(positions[:, 0], positions[:, 1]), shape))


def _positions_near(start: Array, end: Array, shape: BaseGeometry) -> Array:
    """(M, 3) positions of a leg near a shape, close together; beside a shape of many kilometres farther
    apart, because their number is limited."""
    first, last = _part_beside(start, end, shape)
    length_m = float(np.linalg.norm(end - start)) * (last - first)
    count = min(MAX_PARTS, max(1, math.ceil(length_m / COARSE_M)))
    fractions = np.linspace(first, last, count + 1)
    horizontal_m = _horizontal_m(start + (end - start) * fractions[:, None], shape)
    is_near = np.minimum(horizontal_m[:-1], horizontal_m[1:]) < NEAR_M + length_m / count
    within = np.linspace(0.0, (last - first) / count, FINE_STEPS + 1)
    fine = (fractions[:-1][is_near, None] + within).reshape(-1, 1)
    return start + (end - start) * fine


def _part_beside(start: Array, end: Array, shape: BaseGeometry) -> tuple[float, float]:
    """The part of a leg, as fractions of its length, inside the bounding box NEAR_M around a shape that the
    leg comes near to."""
    first, last = 0.0, 1.0
    low_n, low_e, high_n, high_e = shape.bounds
    for axis, low, high in ((0, low_n - NEAR_M, high_n + NEAR_M), (1, low_e - NEAR_M, high_e + NEAR_M)):
        change = float(end[axis] - start[axis])
        if change:
            enter, leave = sorted(((low - start[axis]) / change, (high - start[axis]) / change))
            first, last = max(first, float(enter)), min(last, float(leave))
    return min(first, last), max(first, last)  # rounding may exchange them in a corner of the box
