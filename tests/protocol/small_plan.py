"""A small plan to fly in tests of missions."""

from __future__ import annotations

from missions.items import Land, Takeoff, Waypoint
from missions.plan import Plan
from missions.values import Altitude

ALTITUDE = Altitude(value_m=5.0, reference="home")
GROUND = Altitude(value_m=0.0, reference="home")


def plan_around(lat_deg: float, lon_deg: float) -> Plan:
    """A plan that flies ten metres to the north, back, and lands."""
    north_lat_deg = lat_deg + 10 / 111_320
    items = (
        Takeoff(lat_deg=lat_deg, lon_deg=lon_deg, altitude=ALTITUDE),
        Waypoint(lat_deg=north_lat_deg, lon_deg=lon_deg, altitude=ALTITUDE),
        Waypoint(lat_deg=lat_deg, lon_deg=lon_deg, altitude=ALTITUDE),
        Land(lat_deg=lat_deg, lon_deg=lon_deg, altitude=GROUND),
    )
    return Plan(items=items)
