"""Geofence and rally points of a .plan file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pydantic import ValidationError

from missions import bounded_json
from missions.errors import PlanError, from_validation
from missions.formats.qgc_item import optional_list, require_list, require_number, require_object
from missions.plan import Plan
from missions.values import Altitude, FenceCircle, FencePolygon, FenceZone, HomePosition, Point, RallyPoint


def read_fence(fence: dict[str, Any]) -> tuple[FenceZone, ...]:
    """The zones of a file: polygons, then circles."""
    polygons = [_polygon(n, raw) for n, raw in enumerate(optional_list(fence, "polygons", "geoFence"))]
    circles = [_circle(n, raw) for n, raw in enumerate(optional_list(fence, "circles", "geoFence"))]
    return (*polygons, *circles)


def _polygon(n: int, raw: Any) -> FencePolygon:
    place = f"geofence polygon {n + 1}"
    part = require_object(raw, place)
    corners = require_list(part.get("polygon"), f"{place}, field polygon")
    points = tuple(_point(each, f"{place}, field polygon[{k}]") for k, each in enumerate(corners))
    try:
        return FencePolygon(
            inclusion=_inclusion(part, place), polygon=points, original=bounded_json.dump(raw)
        )
    except ValidationError as error:
        raise _error_at(place, error) from None


def _circle(n: int, raw: Any) -> FenceCircle:
    place = f"geofence circle {n + 1}"
    part = require_object(raw, place)
    circle = require_object(part.get("circle"), f"{place}, field circle")
    center = _point(circle.get("center"), f"{place}, field circle.center")
    radius_m = require_number(circle.get("radius"), f"{place}, field circle.radius")
    try:
        return FenceCircle(
            inclusion=_inclusion(part, place),
            center=center,
            radius_m=radius_m,
            original=bounded_json.dump(raw),
        )
    except ValidationError as error:
        raise _error_at(place, error) from None


def _error_at(place: str, error: ValidationError) -> PlanError:
    invalid = from_validation(error)
    return PlanError(f"{place}, {invalid.place}", invalid.reason, invalid.fix)


def _inclusion(part: dict[str, Any], place: str) -> bool:
    value = part.get("inclusion")
    if not isinstance(value, bool):
        raise PlanError(f"{place}, field inclusion", "it is neither true nor false", "Write true or false.")
    return value


def _point(raw: Any, place: str) -> Point:
    values = require_list(raw, place)
    if len(values) < 2:
        raise PlanError(place, "it has no latitude and longitude", "Write [latitude, longitude].")
    lat, lon = (require_number(value, f"{place}[{n}]") for n, value in enumerate(values[:2]))
    try:
        return Point(lat_deg=lat, lon_deg=lon)
    except ValidationError as error:
        raise _error_at(place, error) from None


def write_fence(document: dict[str, Any], zones: Sequence[FenceZone]) -> None:
    """Puts the zones into a document; an unchanged zone is written exactly as it was read."""
    if not zones and "geoFence" not in document:
        return
    fence = document.setdefault("geoFence", {"version": 2})
    for key, shape in (("circles", "circle"), ("polygons", "polygon")):
        written = [_write_zone(zone) for zone in zones if zone.shape == shape]
        if written or key in fence:
            fence[key] = written


def _write_zone(zone: FenceZone) -> dict[str, Any]:
    raw: dict[str, Any] = bounded_json.load(zone.original) if zone.original else {"version": 1}
    if isinstance(zone, FenceCircle):
        if zone.original and _circle(0, raw).model_copy(update={"original": zone.original}) == zone:
            return raw
        center = [zone.center.lat_deg, zone.center.lon_deg]
        return {**raw, "circle": {**raw.get("circle", {}), "center": center, "radius": zone.radius_m},
                "inclusion": zone.inclusion}  # fmt: skip
    if zone.original and _polygon(0, raw).model_copy(update={"original": zone.original}) == zone:
        return raw
    corners = [[point.lat_deg, point.lon_deg] for point in zone.polygon]
    return {**raw, "inclusion": zone.inclusion, "polygon": corners}


def read_rally(n: int, raw: Any) -> RallyPoint:
    """One rally point, [latitude, longitude, altitude above home]."""
    place = f"rally point {n + 1}"
    point = _point(raw, place)
    if len(raw) < 3:
        raise PlanError(place, "it has no altitude", "Write [latitude, longitude, altitude above home].")
    try:
        altitude = Altitude(value_m=require_number(raw[2], f"{place}[2]"), reference="home")
    except ValidationError as error:
        raise _error_at(place, error) from None
    return RallyPoint(lat_deg=point.lat_deg, lon_deg=point.lon_deg, altitude=altitude)


def write_rally(document: dict[str, Any], plan: Plan) -> None:
    """Puts the rally points into a document; an unchanged point is written exactly as it was read."""
    if not plan.rally_points and "rallyPoints" not in document:
        return
    part = document.setdefault("rallyPoints", {"version": 2})
    original_points = part.get("points", [])
    points: list[Any] = []
    for n, rally in enumerate(plan.rally_points):
        if n < len(original_points) and read_rally(n, original_points[n]) == rally:
            points.append(original_points[n])
        else:
            points.append([rally.lat_deg, rally.lon_deg, _above_home_m(rally, n, plan.planned_home)])
    if points or "points" in part:
        part["points"] = points


def _above_home_m(rally: RallyPoint, n: int, home: HomePosition | None) -> float:
    if rally.altitude.reference == "home":
        return rally.altitude.value_m
    amsl_m = rally.altitude.amsl_m(None)
    if home is None or amsl_m is None:
        reason = "in a .plan file altitudes of rally points are above home only"
        raise PlanError(f"rally point {n + 1}, field altitude", reason, "Set its altitude above home.")
    return amsl_m - home.alt_amsl_m
