"""The vehicles' lidars: the downward lidar of PX4's simulation, and the lidars of a world."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.state import TruthState
from vehicle_sim.world.raycast import RayCaster
from vehicle_sim.world.world import World

FloatArray = NDArray[np.float64]

SECTORS = 72
SECTOR_DEG = 5.0
SAMPLE_EVERY_STEPS = 5
"""50 Hz, like the distance sensor of PX4's simulation."""


class Lidar:
    """Lidars of N vehicles; distances are measured on request, at most at 50 Hz.

    Args:
        world: the obstacles and the ground.
        truth: the true state of the vehicles.
    """

    def __init__(self, world: World, truth: TruthState) -> None:
        self.world = world
        self._truth = truth
        self._caster = RayCaster(world)
        angles = np.radians(SECTOR_DEG) * np.arange(SECTORS)
        self._around_frd = np.stack([np.cos(angles), np.sin(angles), np.zeros(SECTORS)], axis=1)
        self._down_frd = np.array([[0.0, 0.0, 1.0]])
        self._forward_frd = np.array([[1.0, 0.0, 0.0]])
        self._cache: dict[str, tuple[int, FloatArray]] = {}

    def down_m(self, step: int, matrix: FloatArray) -> FloatArray:
        """(N,) distance along the body's down axis; infinite: nothing in this direction."""
        if self.world.empty:  # frequent case: no rays are needed over flat ground
            cos_tilt = matrix[:, 2, 2]
            with np.errstate(divide="ignore", invalid="ignore"):
                distance = np.maximum(-self._truth.position_ned_m[:, 2], 0.0) / cos_tilt
            return np.where(cos_tilt > 0.0, distance, math.inf)
        return self._measure("down", self._down_frd, math.inf, step, matrix)[:, 0]

    def forward_m(self, step: int, matrix: FloatArray) -> FloatArray:
        """(N,) distance along the body's forward axis."""
        return self._measure("forward", self._forward_frd, self.world.lidars.range_m, step, matrix)[:, 0]

    def around_m(self, step: int, matrix: FloatArray) -> FloatArray:
        """(N, 72) distances clockwise from the nose."""
        return self._measure("around", self._around_frd, self.world.lidars.range_m, step, matrix)

    def _measure(
        self, name: str, rays_frd: FloatArray, range_m: float, step: int, matrix: FloatArray
    ) -> FloatArray:
        """Distances (N, R) along rays (R, 3) in FRD from every vehicle."""
        slot = step // SAMPLE_EVERY_STEPS
        cached = self._cache.get(name)
        if cached is not None and cached[0] == slot:
            return cached[1]
        count, rays = matrix.shape[0], rays_frd.shape[0]
        direction = np.einsum("nij,rj->nri", matrix, rays_frd).reshape(-1, 3)
        origin = np.repeat(self._truth.position_ned_m, rays, axis=0)
        # Rays over terrain are computed in steps, up to the largest distance that the message can contain.
        max_range_m = min(range_m, 655.0)
        distance = self._caster.cast(origin, direction, max_range_m).distance_m.reshape(count, rays)
        self._cache[name] = slot, distance
        return distance
