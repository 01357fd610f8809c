"""Distance of a flown path from the geofence and from obstacles."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from missions.check_space import allowed_area
from missions.dry_run.setup import AnyObstacle, Obstacle, Prism
from missions.geodesy import LocalOrigin
from missions.values import FenceZone

Array = NDArray[np.float64]


class FenceDistance:
    """Distance to the geofence: its zones, and the cylinder of GF_MAX_HOR_DIST and GF_MAX_VER_DIST.

    Args:
        zones: fence zones of the plan or mission.
        origin: home, which is the origin of the local frame.
        radius_m: GF_MAX_HOR_DIST; 0: no limit.
        height_m: GF_MAX_VER_DIST; 0: no limit.
    """

    def __init__(
        self, zones: Sequence[FenceZone], origin: LocalOrigin, radius_m: float, height_m: float
    ) -> None:
        self.area = allowed_area(zones, origin) if zones else None
        """The area of the zones: north and east [m]; None: no zones."""
        self._radius_m, self._height_m = radius_m, height_m
        self.exists = bool(zones) or radius_m > 0.0 or height_m > 0.0

    def distance_m(self, position_ned_m: Array) -> Array:
        """(N,) distance to the fence [m] at positions (N, 3); negative: outside; infinite: no fence."""
        to_fence_m = np.full(len(position_ned_m), math.inf)
        north, east, down = position_ned_m.T
        if self.area is not None:
            edge_m = shapely.distance(shapely.points(north, east), self.area.boundary)
            within = shapely.contains_xy(self.area, north, east)
            to_fence_m = np.where(within, edge_m, -edge_m)
        if self._radius_m > 0.0:
            to_fence_m = np.minimum(to_fence_m, self._radius_m - np.hypot(north, east))
        if self._height_m > 0.0:
            to_fence_m = np.minimum(to_fence_m, self._height_m + down)
        return to_fence_m


def obstacle_distance_m(
    obstacles: Sequence[AnyObstacle], position_ned_m: Array
) -> tuple[Array, NDArray[np.intp]]:
    """(N,) distance to the nearest obstacle, and (N,) its index; infinite and 0 without obstacles.

    Args:
        obstacles: upright boxes and prisms.
        position_ned_m: positions (N, 3).
    """
    if not obstacles:
        count = len(position_ned_m)
        return np.full(count, math.inf), np.zeros(count, dtype=np.intp)
    distances = np.stack([_distance_m(each, position_ned_m) for each in obstacles])
    nearest = distances.argmin(axis=0)
    return distances.min(axis=0), nearest


def _distance_m(obstacle: AnyObstacle, position_ned_m: Array) -> Array:
    if isinstance(obstacle, Obstacle):
        return _box_distance_m(obstacle, position_ned_m)
    return _prism_distance_m(obstacle, position_ned_m)


def _prism_distance_m(prism: Prism, position_ned_m: Array) -> Array:
    north, east, down = position_ned_m.T
    shape = shapely.make_valid(shapely.Polygon(prism.corners_ne_m))
    shapely.prepare(shape)
    horizontal_m = shapely.distance(shapely.points(north, east), shape)
    return np.hypot(horizontal_m, np.maximum(-down - prism.top_alt_home_m, 0.0))


def _box_distance_m(box: Obstacle, position_ned_m: Array) -> Array:
    north, east = position_ned_m[:, 0] - box.north_m, position_ned_m[:, 1] - box.east_m
    c, s = math.cos(box.yaw_ned_rad), math.sin(box.yaw_ned_rad)
    outside_x = np.maximum(np.abs(c * north + s * east) - 0.5 * box.length_m, 0.0)
    outside_y = np.maximum(np.abs(c * east - s * north) - 0.5 * box.width_m, 0.0)
    altitude_home_m = -position_ned_m[:, 2]
    above_m = np.maximum(altitude_home_m - box.base_alt_home_m - box.height_m, 0.0)
    below_m = np.maximum(box.base_alt_home_m - altitude_home_m, 0.0)
    return np.sqrt(outside_x**2 + outside_y**2 + (above_m + below_m) ** 2)
