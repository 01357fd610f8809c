"""Distance of a planned path from the obstacles of a plan or an offboard mission."""

from __future__ import annotations

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
"""A path is divided every COARSE_M; near an obstacle, each of these parts is divided into FINE_STEPS."""
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
            positions = _positions_near(path_ned_m, shape)
            if not len(positions):
                continue
            horizontal_m = shapely.distance(shapely.points(positions[:, 0], positions[:, 1]), shape)
            distance_m = np.hypot(horizontal_m, np.maximum(top_down_m - positions[:, 2], 0.0))
            nearest = int(distance_m.argmin())
            if distance_m[nearest] < NEAR_M:
                north, east, _ = positions[nearest].tolist()
                yield Clearance(index, name, float(distance_m[nearest]), north, east)


def _comes_near(path_ned_m: Array, shape: BaseGeometry, top_down_m: float) -> bool:
    """Whether the bounding boxes of the path and of the obstacle are near each other."""
    south, west, north, east = shape.bounds
    low_n, low_e, _ = (path_ned_m.min(axis=0) - NEAR_M).tolist()
    high_n, high_e, high_d = (path_ned_m.max(axis=0) + NEAR_M).tolist()
    beside = low_n > north or high_n < south or low_e > east or high_e < west
    return not beside and high_d > top_down_m


def _positions_near(path_ned_m: Array, shape: BaseGeometry) -> Array:
    """(M, 3) positions of the path near a shape, close together."""
    coarse = _subdivided(path_ned_m)
    horizontal_m = np.asarray(shapely.distance(shapely.points(coarse[:, 0], coarse[:, 1]), shape))
    if len(coarse) == 1:
        return coarse
    is_near = np.minimum(horizontal_m[:-1], horizontal_m[1:]) < NEAR_M + COARSE_M
    starts, ends = coarse[:-1][is_near], coarse[1:][is_near]
    fraction = np.linspace(0.0, 1.0, FINE_STEPS + 1)[None, :, None]
    return (starts[:, None] + (ends - starts)[:, None] * fraction).reshape(-1, 3)


def _subdivided(path_ned_m: Array) -> Array:
    """The path with positions at most COARSE_M apart."""
    lengths_m = np.linalg.norm(np.diff(path_ned_m, axis=0), axis=1)
    parts = [
        np.linspace(start, end, 1 + max(1, int(np.ceil(length_m / COARSE_M))))[:-1]
        for start, end, length_m in zip(path_ned_m[:-1], path_ned_m[1:], lengths_m, strict=True)
    ]
    return np.concatenate([*parts, path_ned_m[-1:]])
