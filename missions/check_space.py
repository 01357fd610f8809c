"""Checks of a plan's positions: distances, geofence, rally points."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import shapely
from shapely.geometry import LineString, Polygon
from shapely.geometry import Point as ShapelyPoint
from shapely.geometry.base import BaseGeometry

from missions.check_context import Context, Finding, item_name
from missions.geodesy import LocalOrigin, distance_m
from missions.items import PlacedItem
from missions.route import is_flown_to
from missions.values import FenceCircle, FencePolygon, FenceZone, Point

TOLERANCE_M = 0.05
"""A point this close to an edge counts as allowed [m]."""
CIRCLE_SEGMENTS = 64
"""Polygon segments for a quarter of a circle; the error is 0.008 % of the radius."""
NorthEast = tuple[float, float]
"""North and east of the local origin [m]."""


def _distances(context: Context) -> Iterator[Finding]:
    home = context.plan.planned_home
    if home is not None:
        yield from _from_home(context, home.lat_deg, home.lon_deg)
    leg_max_m = context.limits.leg_max_m
    reported: set[int] = set()
    for leg in context.legs:
        if leg_max_m is None or leg.length_m <= leg_max_m or leg.step.seq in reported:
            continue
        reported.add(leg.step.seq)
        message = f"{item_name(leg.step.row, leg.step.item)} is {leg.length_m:.0f} m from the previous item."
        yield Finding("leg_too_long", message, leg.step.row, fix="Check that the plan is for this site.")


def _from_home(context: Context, lat_deg: float, lon_deg: float) -> Iterator[Finding]:
    first_max_m, fence_m = context.vehicle.first_waypoint_max_m, context.vehicle.fence_radius_m
    flown_to = [
        (row, item) for row, item in context.items if isinstance(item, PlacedItem) and is_flown_to(item)
    ]
    for index, (row, item) in enumerate(flown_to):
        away_m = distance_m(lat_deg, lon_deg, item.lat_deg, item.lon_deg)
        if index == 0 and 0.0 < first_max_m < away_m:
            message = f"{item_name(row, item)}, the first waypoint, is {away_m:.0f} m from home."
            yield Finding("first_waypoint_far", message, row, fix="Check that this is the right plan.")
        if 0.0 < fence_m < away_m:
            message = (
                f"{item_name(row, item)} is {away_m:.0f} m from home; the geofence limit is {fence_m:.0f} m."
            )
            yield Finding("radius_exceeded", message, row, fix="Move it nearer to home.")


def _fence(context: Context) -> Iterator[Finding]:
    area = _allowed_area_of(context)
    if area is None:
        return
    home = context.plan.planned_home
    if home is not None and not area.covers(
        ShapelyPoint(_north_east_of(context, home.lat_deg, home.lon_deg))
    ):
        message = "Home is outside the geofence: PX4 refuses this geofence."
        yield Finding("fence_home_outside", message, fix="Move the home or the geofence.")
    # the previous position, and whether the previous position is inside the geofence
    previous: tuple[NorthEast, bool] | None = None
    if home is not None:
        position = _north_east_of(context, home.lat_deg, home.lon_deg)
        previous = (position, bool(area.covers(ShapelyPoint(position))))
    reported: set[tuple[str, int]] = set()
    for step in context.route.steps:
        item = step.item
        if not isinstance(item, PlacedItem) or not is_flown_to(item):
            continue
        position = _north_east_of(context, item.lat_deg, item.lon_deg)
        inside = bool(area.covers(ShapelyPoint(position)))
        if not inside and ("point", step.seq) not in reported:
            reported.add(("point", step.seq))
            message = f"{item_name(step.row, item)} is outside the geofence."
            yield Finding("fence_violation", message, step.row, fix="Move it inside, or change the geofence.")
        # a path is checked only if both its ends are inside
        start = previous[0] if inside and previous is not None and previous[1] else position
        if ("path", step.seq) not in reported and inside and not area.covers(LineString([start, position])):
            reported.add(("path", step.seq))
            message = f"The straight path to {item_name(step.row, item).lower()} leaves the geofence."
            yield Finding("fence_crossed", message, step.row, fix="Add a waypoint around the edge.")
        previous = (position, inside)
    for index, rally in enumerate(context.plan.rally_points):
        if not area.covers(ShapelyPoint(_north_east_of(context, rally.lat_deg, rally.lon_deg))):
            message = f"Rally point {index + 1} is outside the geofence."
            yield Finding("rally_outside_fence", message, rally_point=index, fix="Move it inside.")


def _zones(context: Context) -> Iterator[Finding]:
    for index, zone in enumerate(context.plan.fence):
        if isinstance(zone, FencePolygon) and context.origin is not None:
            shape = Polygon([_north_east_of(context, point.lat_deg, point.lon_deg) for point in zone.polygon])
            if not shape.is_valid or shape.area <= 0.0:
                message = f"The sides of geofence zone {index + 1} cross, or it has no area."
                yield Finding("fence_invalid", message, zone=index, fix="Draw the zone again.")
    for index, rally in enumerate(context.plan.rally_points):
        if rally.altitude.reference == "terrain" and rally.altitude.resolved_amsl_m is None:
            message = f"Rally point {index + 1} has a terrain altitude, which PX4 refuses."
            yield Finding("rally_terrain", message, rally_point=index, fix="Set its altitude above home.")


def _north_east_of(context: Context, lat_deg: float, lon_deg: float) -> NorthEast:
    """North and east of the origin [m]."""
    assert context.origin is not None
    north, east, _ = context.origin.to_ned(lat_deg, lon_deg, 0.0)
    return (north, east)


def _allowed_area_of(context: Context) -> BaseGeometry | None:
    """The allowed area: inside all inclusions, outside all exclusions; None without a fence."""
    if not context.plan.fence or context.origin is None:
        return None
    return allowed_area(context.plan.fence, context.origin)


def allowed_area(fence: Sequence[FenceZone], origin: LocalOrigin) -> BaseGeometry:
    """The area inside all inclusions and outside all exclusions, in metres north and east of an origin."""
    area: BaseGeometry = shapely.box(-3e7, -3e7, 3e7, 3e7)
    for zone in fence:
        if isinstance(zone, FenceCircle):
            center = ShapelyPoint(_north_east(origin, zone.center))
            shape: BaseGeometry = center.buffer(zone.radius_m, quad_segs=CIRCLE_SEGMENTS)
        else:
            shape = shapely.make_valid(Polygon([_north_east(origin, point) for point in zone.polygon]))
        grown = shape.buffer(TOLERANCE_M if zone.inclusion else -TOLERANCE_M)
        area = area.intersection(grown) if zone.inclusion else area.difference(grown)
    shapely.prepare(area)
    return area


def _north_east(origin: LocalOrigin, point: Point) -> NorthEast:
    north, east, _ = origin.to_ned(point.lat_deg, point.lon_deg, 0.0)
    return (north, east)


RULES = (_distances, _zones, _fence)
