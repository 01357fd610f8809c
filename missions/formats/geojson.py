"""Plans as GeoJSON (RFC 7946): positions are longitude, latitude, altitude.

The standard defines altitudes above the WGS84 ellipsoid, but most programs write other altitudes. Therefore
the altitudes of another program's file are kept, and the import has to state their reference. Files written
here contain the AMSL altitude for display only.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from missions import bounded_json
from missions.errors import PlanError
from missions.formats import features
from missions.formats.features import Coordinate, Feature
from missions.formats.qgc_item import require_list, require_number, require_object
from missions.formats.results import Imported, ImportOptions, Written
from missions.plan import Plan

_PART_OF_MULTI = {"MultiPoint": "Point", "MultiLineString": "LineString", "MultiPolygon": "Polygon"}


def read(data: bytes | str, options: ImportOptions | None = None) -> Imported:
    """The plan of a GeoJSON file.

    Raises:
        PlanError: The file is too large or not GeoJSON, a value is wrong, a point has no altitude, the
            reference of the altitudes is not known, or the file contains nothing to import.
    """
    document = require_object(bounded_json.load(data), "the file")
    return features.to_plan(list(_features(document)), options or ImportOptions(), "The GeoJSON file")


def _features(document: dict[str, Any]) -> Iterator[Feature]:
    match document.get("type"):
        case "FeatureCollection":
            raw_features = require_list(document.get("features"), "field features")
        case "Feature":
            raw_features = [document]
        case _:
            raw_features = [{"type": "Feature", "geometry": document}]
    for n, raw in enumerate(raw_features, start=1):
        place = f"feature {n}"
        feature = require_object(raw, place)
        properties = feature.get("properties")
        properties = require_object({} if properties is None else properties, f"{place}, field properties")
        name = properties.get("name")
        name = name if isinstance(name, str) else ""
        kept = {key: value for key, value in properties.items() if key != "name"}
        yield from _geometries(feature.get("geometry"), kept, name, place)


def _geometries(raw: Any, properties: dict[str, Any], name: str, place: str) -> Iterator[Feature]:
    if raw is None:
        yield Feature("none", properties=properties, name=name)
        return
    geometry = require_object(raw, f"{place}, field geometry")
    kind, place = geometry.get("type"), f"{place}, field geometry"
    if kind == "GeometryCollection":
        for each in require_list(geometry.get("geometries"), f"{place}.geometries"):
            yield from _geometries(each, properties, name, place)
        return
    parts = [geometry.get("coordinates")]
    if isinstance(kind, str) and kind in _PART_OF_MULTI:
        parts, kind = require_list(geometry.get("coordinates"), f"{place}.coordinates"), _PART_OF_MULTI[kind]
    for coordinates in parts:
        yield _geometry(kind, coordinates, properties, name, f"{place}.coordinates")


def _geometry(kind: Any, raw: Any, properties: dict[str, Any], name: str, place: str) -> Feature:
    match kind:
        case "Point":
            return Feature("point", ((_position(raw, place),),), properties, name)
        case "LineString":
            return Feature("line", (_positions(raw, place),), properties, name)
        case "Polygon":
            rings = tuple(_positions(each, place) for each in require_list(raw, place))
            if not rings:
                raise PlanError(place, "the polygon has no corners", "Correct the polygon.")
            return Feature("area", tuple(open_ring(ring) for ring in rings), properties, name)
        case _:
            reason = f"{str(kind)[:30]!r} is not a GeoJSON geometry"
            raise PlanError(place, reason, "Choose a GeoJSON file.")


def _positions(raw: Any, place: str) -> tuple[Coordinate, ...]:
    return tuple(_position(each, place) for each in require_list(raw, place))


def open_ring(ring: tuple[Coordinate, ...]) -> tuple[Coordinate, ...]:
    """A ring without its last corner if that corner equals the first."""
    return ring[:-1] if len(ring) > 1 and ring[0][:2] == ring[-1][:2] else ring


def _position(raw: Any, place: str) -> Coordinate:
    values = require_list(raw, place)
    if len(values) < 2:
        raise PlanError(place, "a position has no longitude and latitude", "Write [longitude, latitude].")
    lon, lat = (require_number(value, place) for value in values[:2])
    return (lon, lat, require_number(values[2], place) if len(values) > 2 else None)


def write(plan: Plan) -> Written:
    """The plan as a GeoJSON FeatureCollection."""
    written = [
        {
            "type": "Feature",
            "geometry": _to_json(feature),
            "properties": {"name": feature.name, **feature.properties},
        }
        for feature in features.features_of_plan(plan)
    ]
    text = json.dumps({"type": "FeatureCollection", "features": written}, allow_nan=False, indent=1)
    return features.result_with_notes(text.encode(), plan, "A GeoJSON file")


def _to_json(feature: Feature) -> dict[str, Any] | None:
    if feature.geometry == "none":
        return None
    rings = [[[value for value in each if value is not None] for each in ring] for ring in feature.rings]
    if feature.geometry == "point":
        return {"type": "Point", "coordinates": rings[0][0]}
    return {"type": "Polygon", "coordinates": [[*ring, ring[0]] for ring in rings]}
