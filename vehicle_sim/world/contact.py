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
"""A roof supports a vehicle that is at most this far below the roof."""
SLOPE_CRASH_M_S = 1.5
"""Speed into a slope above which a vehicle crashes; PX4's flat ground causes no crash."""
SEARCH_EVERY_STEPS, SEARCH_DISTANCE_M = 25, 10.0
"""Period and distance of the search for prisms near a vehicle: 10 m in 25 steps (0.1 s) are 100 m/s."""
REBOUND_FACTOR = 0.2
"""Speed away from an obstacle after a collision, divided by the speed towards the obstacle before."""


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
        self._prisms = [PrismShape(prism) for prism in world.prisms]
        self._nearby_prisms = self._prisms
        """Prisms near any vehicle; the other prisms are not checked."""
        self._steps_until_search = 1
        self._velocity_before_step_ned_m_s = np.zeros((count, 3))
        self.crashed = np.zeros(count, dtype=np.bool_)
        """(N,) vehicles that have crashed."""

    def support_down_m(self, position_ned_m: FloatArray) -> FloatArray:
        """(N,) NED down position of the ground or roof below each vehicle."""
        north, east, down = position_ned_m[:, 0], position_ned_m[:, 1], position_ned_m[:, 2]
        surface = -self._world.terrain.alt_home_m(north, east)
        for box_number, box in enumerate(self._world.boxes):
            x, y = self._in_box_frame(box_number, position_ned_m)
            roof_down_m = -box.roof_alt_home_m
            supported = (np.abs(x) <= box.length_m / 2) & (np.abs(y) <= box.width_m / 2)
            supported &= down <= roof_down_m + ROOF_TOLERANCE_M
            surface = np.where(supported, np.minimum(surface, roof_down_m), surface)
        for prism in self._find_nearby_prisms(position_ned_m):
            supported = prism.covers(position_ned_m[:, :2]) & (down <= prism.roof_down_m + ROOF_TOLERANCE_M)
            surface = np.where(supported, np.minimum(surface, prism.roof_down_m), surface)
        return surface

    def store_velocity(self, velocity_ned_m_s: FloatArray) -> None:
        """Stores the velocities before a step, because ground contact sets them to zero during the step."""
        self._velocity_before_step_ned_m_s[:] = velocity_ned_m_s

    def collide(self, position_ned_m: FloatArray, velocity_ned_m_s: FloatArray) -> list[Collision]:
        """Moves vehicles out of obstacles that they hit; returns the new collisions.

        Changes positions and velocities in place. A crashed vehicle causes no new collision.
        """
        collisions: list[Collision] = []
        self._hit_slopes(position_ned_m, velocity_ned_m_s, collisions)
        for box_number, box in enumerate(self._world.boxes):
            x, y = self._in_box_frame(box_number, position_ned_m)
            down = position_ned_m[:, 2]
            max_x, max_y = box.length_m / 2 + BODY_RADIUS_M, box.width_m / 2 + BODY_RADIUS_M
            touching = (np.abs(x) < max_x) & (np.abs(y) < max_y)
            touching &= (down > -box.roof_alt_home_m + ROOF_TOLERANCE_M) & (
                down < -box.base_alt_home_m + BODY_RADIUS_M
            )
            for row in np.flatnonzero(touching):
                self._push_out(int(row), box_number, position_ned_m, velocity_ned_m_s)
                self._crash(int(row), box.name, collisions)
        self._steps_until_search -= 1
        for prism in self._find_nearby_prisms(position_ned_m):
            self._hit_prism(prism, position_ned_m, velocity_ned_m_s, collisions)
        return collisions

    def _find_nearby_prisms(self, position: FloatArray) -> list[PrismShape]:
        if self._prisms and self._steps_until_search <= 0:
            self._steps_until_search = SEARCH_EVERY_STEPS
            self._nearby_prisms = [
                prism for prism in self._prisms if prism.any_near(position[:, :2], SEARCH_DISTANCE_M)
            ]
        return self._nearby_prisms

    def _hit_prism(
        self, prism: PrismShape, position: FloatArray, velocity: FloatArray, collisions: list[Collision]
    ) -> None:
        """Moves vehicles that touch a prism out of the prism through the nearest side."""
        below_roof = position[:, 2] > prism.roof_down_m + ROOF_TOLERANCE_M
        if not below_roof.any():
            return
        on_outline = prism.nearest_on_outline(position[:, :2])
        from_outline = position[:, :2] - on_outline
        distance_m = np.hypot(from_outline[:, 0], from_outline[:, 1])
        inside = prism.covers(position[:, :2])
        for row in np.flatnonzero(below_roof & (inside | (distance_m < BODY_RADIUS_M))):
            normal = from_outline[row] / max(float(distance_m[row]), 1e-9) * (-1.0 if inside[row] else 1.0)
            position[row, :2] = on_outline[row] + normal * BODY_RADIUS_M
            _rebound(velocity, int(row), normal)
            self._crash(int(row), prism.name, collisions)

    def _hit_slopes(self, position: FloatArray, velocity: FloatArray, collisions: list[Collision]) -> None:
        terrain = self._world.terrain
        if terrain.flat:
            return
        north, east = position[:, 0], position[:, 1]
        below_ground = position[:, 2] > -terrain.alt_home_m(north, east)
        if not below_ground.any():
            return
        rise_north, rise_east = terrain.slope(north, east)
        velocity_before = self._velocity_before_step_ned_m_s
        speed_into_slope = rise_north * velocity_before[:, 0] + rise_east * velocity_before[:, 1]
        for row in np.flatnonzero(below_ground & (speed_into_slope > SLOPE_CRASH_M_S)):
            velocity[row] = 0.0
            self._crash(int(row), "the ground", collisions)

    def _crash(self, row: int, obstacle: str, collisions: list[Collision]) -> None:
        if not self.crashed[row]:
            self.crashed[row] = True
            collisions.append(Collision(row, obstacle))

    def _in_box_frame(self, box_number: int, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions along the horizontal x and y axes of a box, from the box's centre."""
        box = self._world.boxes[box_number]
        north, east = position[:, 0] - box.north_m, position[:, 1] - box.east_m
        c, s = np.cos(box.yaw_ned_rad), np.sin(box.yaw_ned_rad)
        return c * north + s * east, c * east - s * north

    def _push_out(self, row: int, box_number: int, position: FloatArray, velocity: FloatArray) -> None:
        """Moves a vehicle that touches a box out of the box through the nearest side."""
        box = self._world.boxes[box_number]
        xs, ys = self._in_box_frame(box_number, position[row : row + 1])
        x, y = float(xs[0]), float(ys[0])
        down_at_underside = -box.base_alt_home_m + BODY_RADIUS_M
        overlaps = {
            "x": box.length_m / 2 + BODY_RADIUS_M - abs(x),
            "y": box.width_m / 2 + BODY_RADIUS_M - abs(y),
        }
        if box.base_alt_home_m > 0.0:
            overlaps["down"] = down_at_underside - float(position[row, 2])
        nearest_axis = min(overlaps, key=overlaps.__getitem__)
        if nearest_axis == "down":
            position[row, 2] = down_at_underside
            velocity[row, 2] = abs(float(velocity[row, 2])) * REBOUND_FACTOR
            return
        c, s = np.cos(box.yaw_ned_rad), np.sin(box.yaw_ned_rad)
        normal = (
            np.array([c, s]) * np.sign(x or 1.0)
            if nearest_axis == "x"
            else np.array([-s, c]) * np.sign(y or 1.0)
        )
        position[row, :2] += normal * overlaps[nearest_axis]
        _rebound(velocity, row, normal)


def _rebound(velocity: FloatArray, row: int, normal: FloatArray) -> None:
    """Reverses and reduces a velocity into the side of an obstacle; `normal` points out of the obstacle."""
    outward = float(velocity[row, :2] @ normal)
    if outward < 0.0:
        velocity[row, :2] -= (1.0 + REBOUND_FACTOR) * outward * normal
