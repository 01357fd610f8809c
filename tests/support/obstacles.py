"""Obstacles for plans and missions in tests."""

from __future__ import annotations

from missions.geodesy import LocalOrigin
from missions.values import Altitude, Obstacle, Point, Reference


def box_obstacle(
    origin: LocalOrigin,
    north_m: tuple[float, float],
    east_m: tuple[float, float],
    top_m: float,
    *,
    reference: Reference = "home",
    name: str = "",
) -> Obstacle:
    """A rectangular obstacle.

    Args:
        origin: the origin of the distances.
        north_m: southern and northern edge of the obstacle.
        east_m: western and eastern edge of the obstacle.
        top_m: altitude of the obstacle's top above `reference`.
    """
    (south, north), (west, east) = north_m, east_m
    corners = ((south, west), (north, west), (north, east), (south, east))
    positions = [origin.to_geodetic((*corner, 0.0)) for corner in corners]
    polygon = tuple(Point(lat_deg=lat_deg, lon_deg=lon_deg) for lat_deg, lon_deg, _ in positions)
    return Obstacle(name=name, polygon=polygon, top=Altitude(value_m=top_m, reference=reference))
