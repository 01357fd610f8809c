"""A plan as geographic features, shared by GeoJSON and KML.

Items with a position, fence zones, rally points, obstacles and home are features with a geometry; other items
are features without a geometry. The properties contain the item's fields, so that a file written here can be
read back without loss. A feature of another program has no `role`: its points and lines become waypoints, and
its areas become `Area`s.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from pydantic import BaseModel, TypeAdapter, ValidationError

from missions.errors import PlanError, from_validation
from missions.formats.results import Area, Imported, ImportOptions, Written, count, loss_notes
from missions.items import PlacedItem, Waypoint
from missions.plan import MAX_FENCE_ZONES, MAX_ITEMS, MAX_RALLY_POINTS, Plan, SimpleItem
from missions.values import MAX_OBSTACLES, Altitude, FenceZone, HomePosition, Obstacle, Point, RallyPoint

Geometry = Literal["none", "point", "line", "area"]
Coordinate = tuple[float, float, float | None]
"""Longitude and latitude in degrees, altitude in metres or None."""
_ITEM: TypeAdapter[SimpleItem] = TypeAdapter(SimpleItem)
_ZONE: TypeAdapter[FenceZone] = TypeAdapter(FenceZone)


@dataclass(frozen=True, slots=True)
class Feature:
    """One feature of a file."""

    geometry: Geometry
    rings: tuple[tuple[Coordinate, ...], ...] = ()
    """A point or line has one list of coordinates; an area has the outer ring, then the holes. The first
    corner of a ring is not repeated at its end."""
    properties: dict[str, Any] = field(default_factory=dict[str, Any])
    name: str = ""
    altitude: Altitude | None = None
    """Altitude reference of the coordinates; None if the format does not state it."""


def features_of_plan(plan: Plan) -> list[Feature]:
    """The features of a plan."""
    features: list[Feature] = []
    if plan.planned_home is not None:
        home = plan.planned_home
        features.append(
            _point_feature("home", home, {"alt_amsl_m": home.alt_amsl_m}, home.alt_amsl_m, "Home")
        )
    home_amsl_m = plan.planned_home.alt_amsl_m if plan.planned_home else None
    for number, (_, item) in enumerate(plan.simple_items(), start=1):
        properties = _fields(item)
        name = f"{number} {item.kind.replace('_', ' ')}"
        if isinstance(item, PlacedItem):
            features.append(_point_feature("item", item, properties, item.altitude.amsl_m(home_amsl_m), name))
        else:
            features.append(Feature("none", properties={"role": "item", **properties}, name=name))
    for zone in plan.fence:
        zone_type = "inclusion" if zone.inclusion else "exclusion"
        if zone.shape == "circle":
            properties = {"shape": "circle", "inclusion": zone.inclusion, "radius_m": zone.radius_m}
            features.append(_point_feature("fence", zone.center, properties, None, f"Geofence {zone_type}"))
        else:
            ring = tuple((point.lon_deg, point.lat_deg, None) for point in zone.polygon)
            properties = {"role": "fence", "shape": "polygon", "inclusion": zone.inclusion}
            features.append(Feature("area", (ring,), properties, f"Geofence {zone_type}"))
    for number, rally in enumerate(plan.rally_points, start=1):
        amsl_m = rally.altitude.amsl_m(home_amsl_m)
        features.append(_point_feature("rally", rally, _fields(rally), amsl_m, f"Rally point {number}"))
    for obstacle in plan.obstacles:
        ring = tuple((point.lon_deg, point.lat_deg, None) for point in obstacle.polygon)
        properties = {"role": "obstacle", "top": _fields(obstacle.top)}
        features.append(Feature("area", (ring,), properties, obstacle.name))
    return features


def result_with_notes(data: bytes, plan: Plan, format_name: str) -> Written:
    """The result of writing a file, with notes about data that the format cannot store."""
    return Written(data, loss_notes(plan, format_name, fence=True, rally=True, home=True, obstacles=True))


def _fields(model: BaseModel) -> dict[str, Any]:
    kept = model.model_dump(mode="json", exclude={"lat_deg", "lon_deg", "original"}, exclude_defaults=True)
    return {"kind": getattr(model, "kind"), **kept} if hasattr(model, "kind") else kept  # noqa: B009


def _point_feature(
    role: str, point: Any, properties: dict[str, Any], amsl_m: float | None, name: str
) -> Feature:
    altitude = None if amsl_m is None else Altitude(value_m=amsl_m, reference="amsl")
    return Feature(
        "point", (((point.lon_deg, point.lat_deg, amsl_m),),), {"role": role, **properties}, name, altitude
    )


def to_plan(features: Sequence[Feature], options: ImportOptions, file_name: str) -> Imported:
    """The plan that the features of a file describe. `file_name` is the name of the file in notes.

    Raises:
        PlanError: A value is wrong, a point has no altitude, or there are too many items; the error names the
            feature.
    """
    items: list[SimpleItem] = []
    fence: list[FenceZone] = []
    rally: list[RallyPoint] = []
    obstacles: list[Obstacle] = []
    areas: list[Area] = []
    home: HomePosition | None = None
    for number, feature in enumerate(features, start=1):
        place = f"feature {number}" + (f" ({feature.name[:40]})" if feature.name else "")
        try:
            match feature.properties.get("role"):
                case "item":
                    items.append(_ITEM.validate_json(_json_without_role(feature)))
                case "fence":
                    fence.append(_read_fence_zone(feature))
                case "rally":
                    rally.append(RallyPoint.model_validate_json(_json_without_role(feature)))
                case "obstacle":
                    obstacles.append(_read_obstacle(feature))
                case "home":
                    home = HomePosition.model_validate_json(_json_without_role(feature))
                case _:
                    _add_from_other_program(feature, options, items, areas)
        except ValidationError as error:
            invalid = from_validation(error)
            raise PlanError(f"{place}, {invalid.place}", invalid.reason, invalid.fix) from None
        except PlanError as error:
            raise PlanError(f"{place}, {error.place}", error.reason, error.fix) from None
        _check_counts(items, fence, rally, obstacles)
    plan = Plan(
        items=tuple(items), fence=tuple(fence), rally_points=tuple(rally), obstacles=tuple(obstacles),
        planned_home=home,
    )  # fmt: skip
    note = (f"{file_name} has {count(len(areas), 'area')}: choose a use for each.",) if areas else ()
    return Imported(plan, tuple(areas), note)


def _check_counts(
    items: Sequence[Any], fence: Sequence[Any], rally: Sequence[Any], obstacles: Sequence[Any]
) -> None:
    counts = (len(items), len(fence), len(rally), len(obstacles))
    limits = (MAX_ITEMS, MAX_FENCE_ZONES, MAX_RALLY_POINTS, MAX_OBSTACLES)
    if any(number > limit for number, limit in zip(counts, limits, strict=True)):
        reason = (
            f"it has more than {MAX_ITEMS} items, {MAX_FENCE_ZONES} geofence zones, "
            f"{MAX_RALLY_POINTS} rally points or {MAX_OBSTACLES} obstacles"
        )
        raise PlanError("the file", reason, "Split the plan into smaller ones.")


def _json_without_role(feature: Feature) -> str:
    fields = {key: value for key, value in feature.properties.items() if key != "role"}
    if feature.geometry == "point":
        lon, lat, _ = feature.rings[0][0]
        fields |= {"lat_deg": lat, "lon_deg": lon}
    return json.dumps(fields)


def _read_obstacle(feature: Feature) -> Obstacle:
    fields = {key: value for key, value in feature.properties.items() if key != "role"}
    corners = {"name": feature.name, "polygon": _corners(feature)}
    return Obstacle.model_validate_json(json.dumps({**fields, **corners}))


def _corners(feature: Feature) -> list[dict[str, float]]:
    return [{"lat_deg": lat, "lon_deg": lon} for lon, lat, _ in feature.rings[0]] if feature.rings else []


def _read_fence_zone(feature: Feature) -> FenceZone:
    fields = {key: value for key, value in feature.properties.items() if key != "role"}
    points = _corners(feature)
    if fields.get("shape") == "circle":
        fields["center"] = points[0] if points else None
    else:
        fields["polygon"] = points
    return _ZONE.validate_json(json.dumps(fields))


def _add_from_other_program(
    feature: Feature, options: ImportOptions, items: list[SimpleItem], areas: list[Area]
) -> None:
    if len(items) + sum(map(len, feature.rings)) > MAX_ITEMS:
        raise PlanError("its line or area", f"more than {MAX_ITEMS} points", "Simplify it.")
    if feature.geometry == "area":
        rings = [tuple(Point(lat_deg=lat, lon_deg=lon) for lon, lat, _ in ring) for ring in feature.rings]
        if any(len(ring) < 3 for ring in rings):
            raise PlanError("its area", "it has fewer than 3 corners", "Correct the area.")
        areas.append(Area(feature.name[:100], rings[0], tuple(rings[1:])))
        return
    for lon, lat, z in feature.rings[0] if feature.rings else ():
        altitude = options.altitude
        if feature.altitude is not None and z is not None:
            altitude = feature.altitude.model_copy(update={"value_m": z})
        if altitude is None:
            reason = "the file does not state its altitude reference"
            raise PlanError("its altitude", reason, "Give an altitude with its reference for the import.")
        checked = Altitude.model_validate(altitude.model_dump())
        items.append(Waypoint(lat_deg=lat, lon_deg=lon, altitude=checked))
