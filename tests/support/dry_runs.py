"""A short plan for dry runs in tests, and the aircraft that flies it."""

from __future__ import annotations

from missions.dry_run.plans import FlyablePlan
from missions.dry_run.setup import Aircraft
from missions.geodesy import LocalOrigin
from missions.items import Land, Takeoff, Waypoint
from missions.plan import Plan
from missions.values import Altitude, FenceCircle, HomePosition, Point

HOME = HomePosition(lat_deg=47.397, lon_deg=8.545, alt_amsl_m=480.0)
ORIGIN = LocalOrigin(HOME.lat_deg, HOME.lon_deg, HOME.alt_amsl_m)
FAST_PARAMETERS = {"MPC_TKO_SPEED": 3.0, "MPC_LAND_SPEED": 2.0, "MPC_LAND_CRWL": 1.5, "MPC_XY_CRUISE": 8.0}
AIRCRAFT = Aircraft(HOME, parameters=FAST_PARAMETERS, endurance_s=300.0)


def item_at(item_class, north_m: float, east_m: float, alt_home_m: float, **fields):
    """An item of this class at this position relative to home."""
    lat_deg, lon_deg, _ = ORIGIN.to_geodetic((north_m, east_m, 0.0))
    altitude = Altitude(value_m=alt_home_m, reference="home")
    return item_class(lat_deg=lat_deg, lon_deg=lon_deg, altitude=altitude, **fields)


def short_plan(north_m: float = 15.0, *, fence_radius_m: float | None = None, land: bool = True) -> Plan:
    """A plan that takes off to 4 m above home, flies north, and lands if `land`.

    Args:
        north_m: distance of the waypoint from home.
        fence_radius_m: radius of a circular geofence around home; None: no geofence.
        land: whether the plan ends with a landing.
    """
    items = [item_at(Takeoff, 0.0, 0.0, 4.0), item_at(Waypoint, north_m, 0.0, 4.0)]
    if land:
        items.append(item_at(Land, north_m, 0.0, 0.0))
    centre = Point(lat_deg=HOME.lat_deg, lon_deg=HOME.lon_deg)
    fence = (
        ()
        if fence_radius_m is None
        else (FenceCircle(inclusion=True, center=centre, radius_m=fence_radius_m),)
    )
    return Plan(planned_home=HOME, items=tuple(items), fence=fence)


def flyable_plan(plan: Plan, aircraft: Aircraft = AIRCRAFT) -> FlyablePlan:
    """The plan, resolved for the tests' aircraft."""
    return FlyablePlan.from_plan(plan, aircraft)
