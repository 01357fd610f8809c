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
from missions.values import (
    MAX_OBSTACLES,
    Altitude,
    FenceZone,
    HomePosition,
    Obstacle,
    Point,
    RallyPoint,
    Reference,
)

Geometry = Literal["none", "point", "line", "area"]
_OWN_ROLES = ("item", "fence", "rally", "obstacle", "home")
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
    reference: Reference | Literal["none"] | None = None
    """Reference of the coordinates' altitudes; "none": the file says that its altitudes mean nothing; None:
    the file does not state it."""


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
    reference = None if amsl_m is None else "amsl"
    return Feature(
        "point", (((point.lon_deg, point.lat_deg, amsl_m),),), {"role": role, **properties}, name, reference
    )


def to_plan(
    features: Sequence[Feature],
    options: ImportOptions,
    file_name: str,
    *,
    left_out: Sequence[str] = (),
    notes: Sequence[str] = (),
    heights_above: str | None = None,
) -> Imported:
    """The plan that the features of a file describe. Altitudes in the file are kept; if the file does not
    state their reference, it is taken from the options. If all of these are 0, they mean no altitude, because
    many programs write a 0 where there is none.

    Args:
        features: the features.
        options: values for what the file does not state.
        file_name: name of the file in notes.
        left_out: what the file contains besides, for example `1 Model`.
        notes: further notes on the file.
        heights_above: what the file says its altitudes are above, if that is no `Reference`.

    Raises:
        PlanError: A value is wrong, a point has no altitude or its reference is unknown, there are too many
            items, or there is nothing to import; the error names the feature.
    """
    all_notes = list(notes)
    heights = _unreferenced_heights(features)
    if any(heights):
        all_notes.append(_heights_note(heights, options, file_name, heights_above))
    if any(z for feature in features if feature.reference == "none" for *_, z in feature.rings[0]):
        all_notes.append(f"{file_name} clamps its altitudes to the ground, so they are not used.")
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
                    _add_from_other_program(feature, options, any(heights), items, areas)
        except ValidationError as error:
            invalid = from_validation(error)
            raise PlanError(f"{place}, {invalid.place}", invalid.reason, invalid.fix) from None
        except PlanError as error:
            raise PlanError(f"{place}, {error.place}", error.reason, error.fix, field=error.field) from None
        _check_counts(items, fence, rally, obstacles)
    plan = Plan(
        items=tuple(items), fence=tuple(fence), rally_points=tuple(rally), obstacles=tuple(obstacles),
        planned_home=home,
    )  # fmt: skip
    if plan == Plan() and not areas:
        found = ", ".join(left_out) or "no point, line or area"
        raise PlanError(
            file_name[0].lower() + file_name[1:],
            f"nothing in it can be imported; found: {found}",
            "Export the points, lines or areas of the plan.",
        )
    if areas:
        all_notes.append(f"{file_name} has {count(len(areas), 'area')}: choose a use for each.")
    if left_out:
        all_notes.append(f"Left out: {', '.join(left_out)}.")
    return Imported(plan, tuple(areas), tuple(all_notes))


_ABOVE = {"home": "above home", "amsl": "above mean sea level", "terrain": "above the ground"}


def _unreferenced_heights(features: Sequence[Feature]) -> list[float]:
    """Altitudes of points and lines of other programs whose reference is not known [m]."""
    return [
        z
        for feature in features
        if feature.properties.get("role") not in _OWN_ROLES
        and feature.geometry in ("point", "line")
        and feature.reference is None
        for ring in feature.rings
        for _, _, z in ring
        if z is not None
    ]


def _heights_note(
    heights: Sequence[float], options: ImportOptions, file_name: str, heights_above: str | None
) -> str:
    """The note that altitudes are kept, and above what.

    Raises:
        PlanError: Their reference is not known.
    """
    low, high = min(heights), max(heights)
    span = f"of {low:g} m" if low == high else f"from {low:g} to {high:g} m"
    found = f"it has {count(len(heights), 'altitude')} {span}"
    reference = options.reference_of_heights
    if reference is not None:
        return f"{file_name}: {found}; they are kept, as altitudes {_ABOVE[reference]}."
    stated = f" above {heights_above}" if heights_above else ", but does not state what they are above"
    raise PlanError(
        file_name[0].lower() + file_name[1:],
        f"{found}{stated}",
        "Give the altitude reference of the file: home, amsl or terrain.",
        field="altitude_reference",
    )


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
    feature: Feature,
    options: ImportOptions,
    has_heights: bool,
    items: list[SimpleItem],
    areas: list[Area],
) -> None:
    if len(items) + sum(map(len, feature.rings)) > MAX_ITEMS:
        raise PlanError("its line or area", f"more than {MAX_ITEMS} points", "Simplify it.")
    if feature.geometry == "area":
        rings = [tuple(Point(lat_deg=lat, lon_deg=lon) for lon, lat, _ in ring) for ring in feature.rings]
        if any(len(ring) < 3 for ring in rings):
            raise PlanError("its area", "it has fewer than 3 corners", "Correct the area.")
        areas.append(Area(feature.name[:100], rings[0], tuple(rings[1:])))
        return
    reference = feature.reference
    if reference is None and has_heights:
        reference = options.reference_of_heights
    for lon, lat, z in feature.rings[0] if feature.rings else ():
        altitude = options.altitude
        if z is not None and reference is not None and reference != "none":
            altitude = Altitude(value_m=z, reference=reference)
        if altitude is None:
            raise PlanError(
                "its altitude",
                "the file does not state it",
                "Give an altitude with its reference for the import.",
                field="altitude_m",
            )
        items.append(Waypoint(lat_deg=lat, lon_deg=lon, altitude=altitude))
