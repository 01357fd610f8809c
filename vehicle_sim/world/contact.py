"""Contact of vehicles with the world: surfaces that support them, and collisions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.world.prism import PrismShape
from vehicle_sim.world.world import World

FloatArray = NDArray[np.float64]

BODY_RADIUS_M = 0.3
"""Distance from the centre to the tips of the propellers: arm length SIH_L_ROLL plus propeller radius."""
ROOF_TOLERANCE_M = 0.15
"""A roof supports a vehicle that is at most this deep in it."""
SLOPE_CRASH_M_S = 1.5
"""Speed towards rising ground above which a vehicle crashes; PX4's flat ground causes no crash."""
SEARCH_EVERY_STEPS, SEARCHED_M = 25, 10.0
"""Interval of the search for prisms near a vehicle, and search distance: 0.1 s of flight at 100 m/s."""
REBOUND = 0.2
"""Fraction of the speed kept after a collision."""


@dataclass(frozen=True, slots=True)
class Collision:
    """Vehicle `row` has hit an obstacle or the ground."""

    row: int
    obstacle: str
    """Name of the obstacle, or "the ground"."""


class Contact:
    """Contact of N vehicles with the world.

    Args:
        world: the world, with terrain or obstacles.
        count: N.
    """

    def __init__(self, world: World, count: int) -> None:
        self._world = world
        self._prisms = [PrismShape(each) for each in world.prisms]
        self._near = self._prisms
        """Prisms near a vehicle, the only ones that each step checks."""
        self._steps_until_search = 1
        self._velocity_before_step_ned_m_s = np.zeros((count, 3))
        self.crashed = np.zeros(count, dtype=np.bool_)
        """(N,) vehicles that have crashed since their last reset."""

    def support_down_m(self, position_ned_m: FloatArray) -> FloatArray:
        """(N,) position down of the surface below each vehicle, ground or roof."""
        north, east, down = position_ned_m[:, 0], position_ned_m[:, 1], position_ned_m[:, 2]
        support = -self._world.terrain.alt_home_m(north, east)
        for number, box in enumerate(self._world.boxes):
            x, y = self._in_box_frame(number, position_ned_m)
            roof = -box.roof_alt_home_m
            over = (np.abs(x) <= box.length_m / 2) & (np.abs(y) <= box.width_m / 2)
            over &= down <= roof + ROOF_TOLERANCE_M
            support = np.where(over, np.minimum(support, roof), support)
        for prism in self._near_prisms(position_ned_m):
            over = prism.covers(position_ned_m[:, :2]) & (down <= prism.roof_down_m + ROOF_TOLERANCE_M)
            support = np.where(over, np.minimum(support, prism.roof_down_m), support)
        return support

    def store_velocity(self, velocity_ned_m_s: FloatArray) -> None:
        """Stores the velocities before a step, because ground contact sets them to zero during the step."""
        self._velocity_before_step_ned_m_s[:] = velocity_ned_m_s

    def collide(self, position_ned_m: FloatArray, velocity_ned_m_s: FloatArray) -> list[Collision]:
        """Moves vehicles out of obstacles that they hit; returns the new collisions.

        Changes positions and velocities in place. A crashed vehicle causes no new collision.
        """
        collisions: list[Collision] = []
        self._hit_slopes(position_ned_m, velocity_ned_m_s, collisions)
        for number, box in enumerate(self._world.boxes):
            x, y = self._in_box_frame(number, position_ned_m)
            down = position_ned_m[:, 2]
            reach_x, reach_y = box.length_m / 2 + BODY_RADIUS_M, box.width_m / 2 + BODY_RADIUS_M
            hit = (np.abs(x) < reach_x) & (np.abs(y) < reach_y)
            hit &= (down > -box.roof_alt_home_m + ROOF_TOLERANCE_M) & (
                down < -box.base_alt_home_m + BODY_RADIUS_M
            )
            for row in np.flatnonzero(hit):
                self._push_out(int(row), number, position_ned_m, velocity_ned_m_s)
                self._crash(int(row), box.name, collisions)
        self._steps_until_search -= 1
        for prism in self._near_prisms(position_ned_m):
            self._hit_prism(prism, position_ned_m, velocity_ned_m_s, collisions)
        return collisions

    def reset(self, row: int) -> None:
        """Clears the crash of a vehicle that is reset."""
        self.crashed[row] = False
        self._near, self._steps_until_search = self._prisms, 1

    def _near_prisms(self, position: FloatArray) -> list[PrismShape]:
        if self._prisms and self._steps_until_search <= 0:
            self._steps_until_search = SEARCH_EVERY_STEPS
            self._near = [each for each in self._prisms if each.any_near(position[:, :2], SEARCHED_M)]
        return self._near

    def _hit_prism(
        self, prism: PrismShape, position: FloatArray, velocity: FloatArray, collisions: list[Collision]
    ) -> None:
        """Moves vehicles that touch a prism out of the prism through the nearest side."""
        below = position[:, 2] > prism.roof_down_m + ROOF_TOLERANCE_M
        if not below.any():
            return
        nearest = prism.nearest_on_outline(position[:, :2])
        outwards = position[:, :2] - nearest
        distance_m = np.hypot(outwards[:, 0], outwards[:, 1])
        inside = prism.covers(position[:, :2])
        for row in np.flatnonzero(below & (inside | (distance_m < BODY_RADIUS_M))):
            normal = outwards[row] / max(float(distance_m[row]), 1e-9) * (-1.0 if inside[row] else 1.0)
            position[row, :2] = nearest[row] + normal * BODY_RADIUS_M
            _rebound(velocity, int(row), normal)
            self._crash(int(row), prism.name, collisions)

    def _hit_slopes(self, position: FloatArray, velocity: FloatArray, collisions: list[Collision]) -> None:
        terrain = self._world.terrain
        if terrain.flat:
            return
        north, east = position[:, 0], position[:, 1]
        below = position[:, 2] > -terrain.alt_home_m(north, east)
        if not below.any():
            return
        rise_north, rise_east = terrain.slope(north, east)
        velocity_before = self._velocity_before_step_ned_m_s
        closing = rise_north * velocity_before[:, 0] + rise_east * velocity_before[:, 1]
        for row in np.flatnonzero(below & (closing > SLOPE_CRASH_M_S)):
            velocity[row] = 0.0
            self._crash(int(row), "the ground", collisions)

    def _crash(self, row: int, obstacle: str, collisions: list[Collision]) -> None:
        if not self.crashed[row]:
            self.crashed[row] = True
            collisions.append(Collision(row, obstacle))

    def _in_box_frame(self, number: int, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Horizontal positions in the axes of a box."""
        box = self._world.boxes[number]
        north, east = position[:, 0] - box.north_m, position[:, 1] - box.east_m
        c, s = np.cos(box.yaw_ned_rad), np.sin(box.yaw_ned_rad)
        return c * north + s * east, c * east - s * north

    def _push_out(self, row: int, number: int, position: FloatArray, velocity: FloatArray) -> None:
        box = self._world.boxes[number]
        xs, ys = self._in_box_frame(number, position[row : row + 1])
        x, y = float(xs[0]), float(ys[0])
        underside = -box.base_alt_home_m + BODY_RADIUS_M
        overlaps = {
            "x": box.length_m / 2 + BODY_RADIUS_M - abs(x),
            "y": box.width_m / 2 + BODY_RADIUS_M - abs(y),
        }
        if box.base_alt_home_m > 0.0:
            overlaps["down"] = underside - float(position[row, 2])
        nearest = min(overlaps, key=overlaps.__getitem__)
        if nearest == "down":
            position[row, 2] = underside
            velocity[row, 2] = abs(float(velocity[row, 2])) * REBOUND
            return
        c, s = np.cos(box.yaw_ned_rad), np.sin(box.yaw_ned_rad)
        normal = (
            np.array([c, s]) * np.sign(x or 1.0) if nearest == "x" else np.array([-s, c]) * np.sign(y or 1.0)
        )
        position[row, :2] += normal * overlaps[nearest]
        _rebound(velocity, row, normal)


def _rebound(velocity: FloatArray, row: int, normal: FloatArray) -> None:
    """Reflects and damps a velocity towards the side of an obstacle with this outward normal."""
    inward = float(velocity[row, :2] @ normal)
    if inward < 0.0:
        velocity[row, :2] -= (1.0 + REBOUND) * inward * normal
