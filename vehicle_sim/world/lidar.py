"""The vehicles' lidars: the downward lidar of PX4's simulation, and the lidars that a world adds."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.state import TruthState
from vehicle_sim.world.raycast import RayCaster
from vehicle_sim.world.world import World

FloatArray = NDArray[np.float64]

SECTORS = 72
"""Number of sectors of the 360° lidar."""
SECTOR_DEG = 5.0
SAMPLE_EVERY_STEPS = 5
"""50 Hz, like the distance sensor of PX4's simulation."""
MAX_RANGE_M = 655.0
"""Largest distance in DISTANCE_SENSOR and OBSTACLE_DISTANCE, whose fields are 16-bit centimetres."""


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
        self._sector_rays_frd = np.stack([np.cos(angles), np.sin(angles), np.zeros(SECTORS)], axis=1)
        self._down_ray_frd = np.array([[0.0, 0.0, 1.0]])
        self._forward_ray_frd = np.array([[1.0, 0.0, 0.0]])
        self._newest: dict[str, tuple[int, FloatArray]] = {}
        """Number of the newest sample and its distances, by the name of the lidar."""

    def down_m(self, step: int, attitude_matrix: FloatArray) -> FloatArray:
        """(N,) distance along the body's down axis; infinite: nothing in this direction."""
        if self.world.empty:  # faster than rays
            cos_tilt = attitude_matrix[:, 2, 2]
            with np.errstate(divide="ignore", invalid="ignore"):
                distance = np.maximum(-self._truth.position_ned_m[:, 2], 0.0) / cos_tilt
            return np.where(cos_tilt > 0.0, distance, math.inf)
        return self._measure("down", self._down_ray_frd, math.inf, step, attitude_matrix)[:, 0]

    def forward_m(self, step: int, attitude_matrix: FloatArray) -> FloatArray:
        """(N,) distance along the body's forward axis."""
        range_m = self.world.lidars.range_m
        return self._measure("forward", self._forward_ray_frd, range_m, step, attitude_matrix)[:, 0]

    def around_m(self, step: int, attitude_matrix: FloatArray) -> FloatArray:
        """(N, 72) distances clockwise from the nose."""
        range_m = self.world.lidars.range_m
        return self._measure("around", self._sector_rays_frd, range_m, step, attitude_matrix)

    def _measure(
        self, name: str, rays_frd: FloatArray, range_m: float, step: int, attitude_matrix: FloatArray
    ) -> FloatArray:
        """Distances (N, R) along rays (R, 3) in FRD from every vehicle."""
        sample_number = step // SAMPLE_EVERY_STEPS
        newest = self._newest.get(name)
        if newest is not None and newest[0] == sample_number:
            return newest[1]
        count, ray_count = attitude_matrix.shape[0], rays_frd.shape[0]
        direction = np.einsum("nij,rj->nri", attitude_matrix, rays_frd).reshape(-1, 3)
        origin = np.repeat(self._truth.position_ned_m, ray_count, axis=0)
        # The range must be finite, because the ray caster divides it into steps over terrain.
        hits = self._caster.cast(origin, direction, min(range_m, MAX_RANGE_M))
        distance = hits.distance_m.reshape(count, ray_count)
        self._newest[name] = sample_number, distance
        return distance
