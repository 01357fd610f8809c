"""PX4's geofence: uploaded polygons and circles (zones), and the cylinder around home."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from vehicle_sim.autopilot.mission.items import Item
from vehicle_sim.geodesy import to_local

POLYGON_INCLUSION, POLYGON_EXCLUSION, CIRCLE_INCLUSION, CIRCLE_EXCLUSION = 5001, 5002, 5003, 5004
"""MAV_CMD_NAV_FENCE_*."""


class Breach(Enum):
    """Which part of the fence is violated."""

    ZONE = "zone"
    DISTANCE = "distance"
    ALTITUDE = "altitude"


@dataclass(frozen=True, slots=True)
class Zone:
    """A polygon (three corners or more) or a circle (one corner and a radius).

    A polygon of which not all corners were uploaded has no corners: PX4 finds no position inside it.
    """

    inclusion: bool
    corners: tuple[tuple[float, float], ...]
    """Latitude and longitude in degrees."""
    radius_m: float = 0.0

    def contains(self, lat_deg: float, lon_deg: float) -> bool:
        """Whether a position lies inside the zone."""
        if len(self.corners) == 1:
            lat, lon = self.corners[0]
            return distance_m(lat_deg, lon_deg, lat, lon) < abs(self.radius_m)  # False for NaN
        return bool(self.corners) and _in_polygon(self.corners, lat_deg, lon_deg)

    def allows(self, lat_deg: float, lon_deg: float) -> bool:
        """Whether a vehicle may be at a position, as far as this zone is concerned."""
        return self.contains(lat_deg, lon_deg) == self.inclusion


def read_zones(items: Sequence[Item]) -> tuple[Zone, ...]:
    """Zones of an uploaded fence.

    As in PX4, the first corner of a polygon states how many items belong to it, whatever their commands.
    """
    zones: list[Zone] = []
    k = 0
    while k < len(items):
        item = items[k]
        if item.command in (CIRCLE_INCLUSION, CIRCLE_EXCLUSION):
            zones.append(
                Zone(item.command == CIRCLE_INCLUSION, ((item.lat_deg, item.lon_deg),), item.parameters[0])
            )
            k += 1
        elif item.command in (POLYGON_INCLUSION, POLYGON_EXCLUSION):
            count = int(item.parameters[0])
            corners = tuple((each.lat_deg, each.lon_deg) for each in items[k : k + count])
            zones.append(Zone(item.command == POLYGON_INCLUSION, corners if len(corners) == count else ()))
            k += count
        else:
            k += 1
    return tuple(zones)


def inside(zones: Sequence[Zone], lat_deg: float, lon_deg: float) -> bool:
    """Whether a position is in an inclusion zone (if the fence has any) and in no exclusion zone."""
    inclusions = [zone for zone in zones if zone.inclusion]
    if inclusions and not any(zone.contains(lat_deg, lon_deg) for zone in inclusions):
        return False
    return not any(zone.contains(lat_deg, lon_deg) for zone in zones if not zone.inclusion)


@dataclass(frozen=True, slots=True)
class Cylinder:
    """GF_MAX_HOR_DIST and GF_MAX_VER_DIST around home; 0: no limit. NaN latitude: home unknown, no limits."""

    home_lat_deg: float
    home_lon_deg: float
    home_alt_amsl_m: float
    radius_m: float
    height_m: float


def breaches(
    zones: Sequence[Zone], cylinder: Cylinder, lat_deg: float, lon_deg: float, alt_amsl_m: float
) -> frozenset[Breach]:
    """The parts of the fence that a position violates."""
    violated: set[Breach] = set()
    if not inside(zones, lat_deg, lon_deg):
        violated.add(Breach.ZONE)
    if math.isfinite(cylinder.home_lat_deg):
        if cylinder.radius_m > 0.0:
            from_home_m = distance_m(lat_deg, lon_deg, cylinder.home_lat_deg, cylinder.home_lon_deg)
            if from_home_m > cylinder.radius_m:
                violated.add(Breach.DISTANCE)
        if cylinder.height_m > 0.0 and alt_amsl_m - cylinder.home_alt_amsl_m > cylinder.height_m:
            violated.add(Breach.ALTITUDE)
    return frozenset(violated)


def distance_m(lat_deg: float, lon_deg: float, other_lat_deg: float, other_lon_deg: float) -> float:
    """Horizontal distance between two positions."""
    n, e = to_local(lat_deg, lon_deg, other_lat_deg, other_lon_deg)  # type: ignore[arg-type]
    return math.hypot(float(n), float(e))


def _in_polygon(corners: Sequence[tuple[float, float]], lat_deg: float, lon_deg: float) -> bool:
    """Counts the edges that a ray from the position crosses: an odd number means inside."""
    is_inside = False
    lat_b, lon_b = corners[-1]
    for lat_a, lon_a in corners:
        if (lon_a >= lon_deg) != (lon_b >= lon_deg) and lat_deg <= (lat_b - lat_a) * (lon_deg - lon_a) / (
            lon_b - lon_a
        ) + lat_a:
            is_inside = not is_inside
        lat_b, lon_b = lat_a, lon_a
    return is_inside
