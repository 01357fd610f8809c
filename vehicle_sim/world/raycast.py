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
"""Number of points on each ray at which the altitude of the terrain is checked."""
BISECTIONS = 12


@dataclass(frozen=True, slots=True)
class Hits:
    """What M rays hit."""

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
        self._half_size = np.array([[b.length_m, b.width_m, b.height_m] for b in boxes]).reshape(-1, 3) / 2
        yaw = np.array([b.yaw_ned_rad for b in boxes])
        self._cos, self._sin = np.cos(yaw), np.sin(yaw)
        self._prisms = [PrismShape(prism) for prism in world.prisms]

    def cast(self, origin_ned_m: FloatArray, direction_ned: FloatArray, range_m: FloatArray | float) -> Hits:
        """Casts rays from (M, 3) along unit vectors (M, 3) up to `range_m`."""
        ranges_m = np.broadcast_to(range_m, origin_ned_m.shape[:1])
        distance = self._ground_distance(origin_ned_m, direction_ned, ranges_m)
        target = np.where(np.isfinite(distance), GROUND, NOTHING).astype(np.int64)
        box_count = len(self.world.boxes)
        for number in range(box_count + len(self._prisms)):
            if number < box_count:
                to_obstacle = self._box_distance(number, origin_ned_m, direction_ned)
            else:
                to_obstacle = self._prisms[number - box_count].cast(origin_ned_m, direction_ned)
            nearer = to_obstacle < distance
            distance = np.where(nearer, to_obstacle, distance)
            target[nearer] = number
        too_far = distance > range_m
        distance[too_far] = np.inf
        target[too_far] = NOTHING
        return Hits(distance, target)

    def _box_distance(self, number: int, origin: FloatArray, direction: FloatArray) -> FloatArray:
        """Distances to a box by a slab test in the box's axes; 0 for a ray that starts inside."""
        origin_in_box = self._to_box_axes(number, origin - self._centre[number])
        direction_in_box = self._to_box_axes(number, direction)
        half_size = self._half_size[number]
        with np.errstate(divide="ignore", invalid="ignore"):
            to_lower = (-half_size - origin_in_box) / direction_in_box
            to_upper = (half_size - origin_in_box) / direction_in_box
        entry_m = np.maximum(np.fmax.reduce(np.fmin(to_lower, to_upper), axis=1), 0.0)
        exit_m = np.fmin.reduce(np.fmax(to_lower, to_upper), axis=1)
        # A ray parallel to a slab hits the slab only if the ray starts inside the slab.
        misses = ((direction_in_box == 0.0) & (np.abs(origin_in_box) > half_size)).any(axis=1)
        return np.where((exit_m >= entry_m) & ~misses, entry_m, np.inf)

    def _to_box_axes(self, number: int, vectors: FloatArray) -> FloatArray:
        c, s = self._cos[number], self._sin[number]
        return np.stack(
            [c * vectors[:, 0] + s * vectors[:, 1], c * vectors[:, 1] - s * vectors[:, 0], vectors[:, 2]],
            axis=1,
        )

    def _ground_distance(self, origin: FloatArray, direction: FloatArray, range_m: FloatArray) -> FloatArray:
        down = direction[:, 2]
        if self.world.terrain.flat:
            with np.errstate(divide="ignore", invalid="ignore"):
                return np.where(down > 0.0, np.maximum(-origin[:, 2], 0.0) / down, np.inf)
        return self._march(origin, direction, range_m)

    def _march(self, origin: FloatArray, direction: FloatArray, range_m: FloatArray) -> FloatArray:
        """Distances to terrain, by steps that become longer along the ray, then by bisection between the last
        point above and the first point below the ground."""
        distance = np.full(origin.shape[0], np.inf)
        unfinished = np.flatnonzero(range_m > 0.0)
        last_above = np.zeros(unfinished.shape)
        for step in range(1, MARCH_STEPS + 1):
            if not unfinished.size:
                break
            along_ray = range_m[unfinished] * (step / MARCH_STEPS) ** 1.5
            hit = self._is_below_ground(origin[unfinished], direction[unfinished], along_ray)
            if hit.any():
                rows = unfinished[hit]
                distance[rows] = self._bisect(origin[rows], direction[rows], last_above[hit], along_ray[hit])
            unfinished, last_above = unfinished[~hit], along_ray[~hit]
        return distance

    def _bisect(
        self, origin: FloatArray, direction: FloatArray, last_above: FloatArray, first_below: FloatArray
    ) -> FloatArray:
        for _ in range(BISECTIONS):
            middle = 0.5 * (last_above + first_below)
            is_below = self._is_below_ground(origin, direction, middle)
            first_below = np.where(is_below, middle, first_below)
            last_above = np.where(is_below, last_above, middle)
        return first_below

    def _is_below_ground(self, origin: FloatArray, direction: FloatArray, distance: FloatArray) -> np.ndarray:
        point = origin + direction * distance[:, None]
        return -point[:, 2] <= self.world.terrain.alt_home_m(point[:, 0], point[:, 1])
