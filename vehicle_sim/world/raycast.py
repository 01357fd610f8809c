"""Distance along rays to the ground or an obstacle, for any number of rays at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.world.prism import PrismShape
from vehicle_sim.world.world import World

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

NOTHING, GROUND = -2, -1
"""Values of `Hits.target` for a ray that hits no obstacle."""
MARCH_STEPS = 64
BISECTIONS = 12


@dataclass(frozen=True, slots=True)
class Hits:
    """Results of M rays."""

    distance_m: FloatArray
    """(M,) infinite: the ray hits nothing."""
    target: IntArray
    """(M,) NOTHING, GROUND, or the number of the obstacle: boxes first, then prisms."""


class RayCaster:
    """Casts rays through one world."""

    def __init__(self, world: World) -> None:
        self.world = world
        boxes = world.boxes
        self._centre = np.array([[b.north_m, b.east_m, -(b.base_alt_home_m + b.height_m / 2)] for b in boxes])
        self._half = np.array([[b.length_m, b.width_m, b.height_m] for b in boxes]).reshape(-1, 3) / 2
        yaw = np.array([b.yaw_ned_rad for b in boxes])
        self._cos, self._sin = np.cos(yaw), np.sin(yaw)
        self._prisms = [PrismShape(each) for each in world.prisms]

    def cast(self, origin_ned_m: FloatArray, direction_ned: FloatArray, range_m: FloatArray | float) -> Hits:
        """Casts rays from (M, 3) along unit vectors (M, 3) up to `range_m`."""
        distance = self._ground(origin_ned_m, direction_ned, np.broadcast_to(range_m, origin_ned_m.shape[:1]))
        target = np.where(np.isfinite(distance), GROUND, NOTHING).astype(np.int64)
        boxes = len(self.world.boxes)
        for number in range(boxes + len(self._prisms)):
            if number < boxes:
                to_obstacle = self._box(number, origin_ned_m, direction_ned)
            else:
                to_obstacle = self._prisms[number - boxes].cast(origin_ned_m, direction_ned)
            nearer = to_obstacle < distance
            distance = np.where(nearer, to_obstacle, distance)
            target[nearer] = number
        beyond = distance > range_m
        distance[beyond] = np.inf
        target[beyond] = NOTHING
        return Hits(distance, target)

    def _box(self, number: int, origin: FloatArray, direction: FloatArray) -> FloatArray:
        """Distances to a box by a slab test in the box's axes; 0 for a ray that starts inside."""
        offset = origin - self._centre[number]
        rotated = [self._to_box_axes(number, offset), self._to_box_axes(number, direction)]
        at, along = rotated
        with np.errstate(divide="ignore", invalid="ignore"):
            first, second = (-self._half[number] - at) / along, (self._half[number] - at) / along
        near = np.fmax.reduce(np.fmin(first, second), axis=1)
        far = np.fmin.reduce(np.fmax(first, second), axis=1)
        # A ray parallel to a slab hits it only if it starts inside the slab.
        outside = ((along == 0.0) & (np.abs(at) > self._half[number])).any(axis=1)
        return np.where((far >= np.maximum(near, 0.0)) & ~outside, np.maximum(near, 0.0), np.inf)

    def _to_box_axes(self, number: int, vectors: FloatArray) -> FloatArray:
        c, s = self._cos[number], self._sin[number]
        return np.stack(
            [c * vectors[:, 0] + s * vectors[:, 1], c * vectors[:, 1] - s * vectors[:, 0], vectors[:, 2]],
            axis=1,
        )

    def _ground(self, origin: FloatArray, direction: FloatArray, range_m: FloatArray) -> FloatArray:
        down = direction[:, 2]
        if self.world.terrain.flat:
            with np.errstate(divide="ignore", invalid="ignore"):
                distance = np.where(down > 0.0, np.maximum(-origin[:, 2], 0.0) / down, np.inf)
            return distance
        return self._march(origin, direction, range_m)

    def _march(self, origin: FloatArray, direction: FloatArray, range_m: FloatArray) -> FloatArray:
        """Distances to terrain: steps that grow with the distance, then bisection between the last point
        above and the first point below the ground."""
        distance = np.full(origin.shape[0], np.inf)
        open_rays = np.flatnonzero(range_m > 0.0)
        before = np.zeros(open_rays.shape)
        for step in range(1, MARCH_STEPS + 1):
            if not open_rays.size:
                break
            at = range_m[open_rays] * (step / MARCH_STEPS) ** 1.5
            below = self._below(origin[open_rays], direction[open_rays], at)
            if below.any():
                rows = open_rays[below]
                distance[rows] = self._bisect(origin[rows], direction[rows], before[below], at[below])
            open_rays, before = open_rays[~below], at[~below]
        return distance

    def _bisect(
        self, origin: FloatArray, direction: FloatArray, low: FloatArray, high: FloatArray
    ) -> FloatArray:
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            below = self._below(origin, direction, middle)
            high = np.where(below, middle, high)
            low = np.where(below, low, middle)
        return high

    def _below(self, origin: FloatArray, direction: FloatArray, at: FloatArray) -> np.ndarray:
        point = origin + direction * at[:, None]
        return -point[:, 2] <= self.world.terrain.alt_home_m(point[:, 0], point[:, 1])
