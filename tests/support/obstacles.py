"""Obstacles of plans and missions for tests."""

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
    """A rectangle from south to north and from west to east of an origin."""
    (south, north), (west, east) = north_m, east_m
    corners = ((south, west), (north, west), (north, east), (south, east))
    places = [origin.to_geodetic((*corner, 0.0)) for corner in corners]
    polygon = tuple(Point(lat_deg=lat_deg, lon_deg=lon_deg) for lat_deg, lon_deg, _ in places)
    return Obstacle(name=name, polygon=polygon, top=Altitude(value_m=top_m, reference=reference))
