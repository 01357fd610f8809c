"""The world of the vehicles: ground, boxes, walls, prisms and the vehicles' lidars.

Positions are local NED from home. The lower side of a box or wall is at `base_alt_home_m` above home, so that
vehicles can fly under a bridge. Vehicles can land on roofs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from vehicle_sim.world.prism import Prism
from vehicle_sim.world.terrain import Terrain


@dataclass(frozen=True, slots=True)
class Box:
    """An upright box; a wall is a thin box."""

    name: str
    north_m: float
    east_m: float
    """North and east of the centre."""
    length_m: float
    """Length along the box's x axis, which points north if the yaw is 0."""
    width_m: float
    height_m: float
    base_alt_home_m: float = 0.0
    """Altitude of the lower side above home."""
    yaw_ned_rad: float = 0.0

    @property
    def roof_alt_home_m(self) -> float:
        """Altitude of the upper side above home."""
        return self.base_alt_home_m + self.height_m


def wall(
    name: str, start_ne_m: tuple[float, float], end_ne_m: tuple[float, float], *, height_m: float,
    thickness_m: float, base_alt_home_m: float = 0.0,
) -> Box:  # fmt: skip
    """A thin box from one position to another."""
    length_north_m, length_east_m = end_ne_m[0] - start_ne_m[0], end_ne_m[1] - start_ne_m[1]
    return Box(
        name,
        0.5 * (start_ne_m[0] + end_ne_m[0]),
        0.5 * (start_ne_m[1] + end_ne_m[1]),
        math.hypot(length_north_m, length_east_m),
        thickness_m,
        height_m,
        base_alt_home_m,
        math.atan2(length_east_m, length_north_m),
    )


@dataclass(frozen=True, slots=True)
class Lidars:
    """The lidars of each vehicle in addition to the downward lidar of PX4's simulation."""

    forward: bool = False
    """A second DISTANCE_SENSOR, pointing forward."""
    around: bool = False
    """OBSTACLE_DISTANCE: 72 sectors of 5 degrees in the body's horizontal plane."""
    range_m: float = 20.0
    """Range of the forward and the 360° lidar."""


@dataclass(frozen=True, slots=True)
class World:
    """Ground, obstacles and lidars, shared by all vehicles."""

    name: str = "flat"
    terrain: Terrain = field(default_factory=Terrain)
    boxes: tuple[Box, ...] = ()
    lidars: Lidars = field(default_factory=Lidars)
    prisms: tuple[Prism, ...] = ()

    @property
    def empty(self) -> bool:
        """Whether the world is only flat ground, as in PX4's simulation."""
        return self.terrain.flat and not self.boxes and not self.prisms
