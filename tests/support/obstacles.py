"""Obstacles for plans and missions in tests."""

from __future__ import annotations

from missions.geodesy import LocalOrigin
from missions.values import Altitude, Obstacle, Point, Reference


def block(
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
        north_m: its southern and its northern edge.
        east_m: its western and its eastern edge.
        top_m: altitude of its top above `reference`.
    """
    (south, north), (west, east) = north_m, east_m
    corners = ((south, west), (north, west), (north, east), (south, east))
    positions = [origin.to_geodetic((*corner, 0.0)) for corner in corners]
    polygon = tuple(Point(lat_deg=lat_deg, lon_deg=lon_deg) for lat_deg, lon_deg, _ in positions)
    return Obstacle(name=name, polygon=polygon, top=Altitude(value_m=top_m, reference=reference))
