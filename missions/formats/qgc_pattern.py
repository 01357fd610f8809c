"""Reads and writes QGroundControl's survey, corridor scan and structure scan as patterns.

What is changed is written into the file's own JSON: keys that do not depend on the change keep their values,
and unknown keys are kept. Names and meanings of the keys:
https://docs.qgroundcontrol.com/master/en/qgc-dev-guide/file_formats/plan.html
"""

from __future__ import annotations

from typing import Any, Final

from missions import bounded_json
from missions.errors import PlanError
from missions.formats.qgc_camera import (
    CAMERA_DATA,
    CUSTOM_CAMERA,
    MANUAL_CAMERA,
    camera_keys,
    read_coverage,
    reference_of,
)
from missions.formats.qgc_fields import Fields, whole
from missions.items import ChangeSpeed, PlacedItem
from missions.pattern_settings import CorridorPattern, PatternDocument, StructurePattern, SurveyPattern
from missions.plan import PatternItem, SimpleItem
from missions.values import Altitude

TRANSECTS: Final = "TransectStyleComplexItem"
CAMERA: Final = "CameraCalc"
VERSIONS: Final = {"survey": (4, 5), "CorridorScan": (2,), "StructureScan": (3,)}
"""The versions of QGroundControl 4 and 5."""
MIN_SPACING_M = 0.5
"""Below this spacing, QGroundControl flies a single line."""

Raw = dict[str, Any]


def read(part: Raw, place: str) -> tuple[PatternDocument | None, str | None]:
    """The pattern of a complex item.

    Returns:
        The pattern; or None and the reason why this program does not know a pattern like it, or None if the
        complex item is none of these patterns.

    Raises:
        PlanError: A value is missing or wrong; the message starts with `place` and names the field.
    """
    kind = part.get("complexItemType")
    if kind not in VERSIONS:
        return None, None
    fields = Fields(part, f"{place} ({kind})")
    version = fields.number("version")
    if version not in VERSIONS[kind]:
        return None, f"version {version:g} of this pattern is not known"
    if kind == "StructureScan":
        return _structure(fields)
    transects = fields.part(TRANSECTS)
    if transects.flag("HoverAndCapture"):
        return None, "it stops for each photo, which patterns here do not"
    if transects.flag("FollowTerrain"):
        return None, "it follows the terrain in the way of an old version"
    return (_survey if kind == "survey" else _corridor)(fields, transects)


def _survey(fields: Fields, transects: Fields) -> tuple[PatternDocument | None, str | None]:
    camera = transects.part(CAMERA)
    coverage = read_coverage(camera)
    if coverage.spacing_m is not None and coverage.spacing_m < MIN_SPACING_M:
        return None, "its lines have no spacing"
    return SurveyPattern(
        kind="survey",
        outer=fields.points("polygon", 3),
        coverage=coverage,
        altitude=Altitude(value_m=coverage.distance_m, reference=reference_of(camera)),
        heading_deg=fields.number("angle"),
        turnaround_m=transects.number("TurnAroundDistance", 0.0, 1e6),
        crosshatch=transects.flag("Refly90Degrees"),
    ), None


def _corridor(fields: Fields, transects: Fields) -> tuple[PatternDocument | None, str | None]:
    camera = transects.part(CAMERA)
    coverage = read_coverage(camera)
    width_m = fields.number("CorridorWidth", 0.0, 1e6)
    if width_m == 0.0 or (coverage.spacing_m is not None and coverage.spacing_m < MIN_SPACING_M):
        return None, "it has a single line"
    return CorridorPattern(
        kind="corridor",
        points=fields.points("polyline", 2),
        width_m=width_m,
        coverage=coverage,
        altitude=Altitude(value_m=coverage.distance_m, reference=reference_of(camera)),
        turnaround_m=transects.number("TurnAroundDistance", 0.0, 1e6),
    ), None


def _structure(fields: Fields) -> tuple[PatternDocument | None, str | None]:
    """A structure scan. All its altitudes are above home; its lowest round is half a round's height above
    the bottom of the scan, or its highest one half a round's height below the top."""
    coverage = read_coverage(fields.part(CAMERA), sideways=True)
    spacing_m = _spacing_m(coverage)
    layers = fields.number("Layers", 1, 100)
    if not layers.is_integer():
        raise PlanError(fields.place("Layers"), "it is not a whole number", "Write a whole number.")
    return StructurePattern(
        kind="structure",
        outline=fields.points("polygon", 3),
        coverage=coverage,
        base=Altitude(value_m=0.0, reference="home"),
        height_m=fields.number("StructureHeight", 0.0, 10_000.0),
        lowest_m=max(0.0, fields.number("ScanBottomAlt", -10_000.0, 10_000.0) + spacing_m / 2.0),
        from_top=fields.flag("StartFromTop"),
        gimbal_pitch_deg=fields.number("GimbalPitch", -360.0, 360.0),
        layers=int(layers),
        entrance=Altitude(value_m=fields.number("EntranceAltitude", -10_000.0, 10_000.0), reference="home"),
    ), None


def _spacing_m(coverage: Any, *, sideways: bool = True) -> float:
    from missions.patterns.document import coverage_of  # shapely, 0.2 s to import

    values = coverage_of(coverage)
    return (values.sideways() if sideways else values).spacing_m


def item_of(pattern: PatternDocument, items: tuple[SimpleItem, ...], original: str) -> PatternItem:
    """The row of the plan: with the items of the file, or where it has none with those made here.

    Raises:
        PlanError: The file has no items, and the pattern has no path.
    """
    from missions.patterns.current import pattern_item  # shapely, 0.2 s to import

    return pattern_item(pattern, items or None, original=original)


# --- writing ------------------------------------------------------------------------------------------


def write(item: PatternItem, parts: list[Raw]) -> tuple[list[Raw], str | None]:
    """The rows of the file for a pattern.

    Args:
        item: the pattern.
        parts: its mission items as SimpleItems.

    Returns:
        The complex item, after an item with the speed if the pattern has one; or `parts` and the reason why
        QGroundControl has no such pattern.
    """
    reason = _missing_in_qgroundcontrol(item.pattern)
    if reason is not None:
        return parts, reason
    before = None
    raw = bounded_json.load(item.original) if item.original is not None else None
    if raw is not None:
        before, _ = read(raw, "the pattern")
    if raw is None or before is None or before.kind != item.pattern.kind:
        raw = _template(item.pattern.kind)
    keys = _keys(item.pattern)
    changed = before is None or item.pattern != before
    if changed:
        _merge(raw, keys, {} if before is None else _keys(before))
    starts_with_speed = bool(item.items) and isinstance(item.items[0], ChangeSpeed) and changed
    speed, lines = (parts[:1], parts[1:]) if starts_with_speed else ([], parts)
    if changed and TRANSECTS in raw:
        raw[TRANSECTS]["VisualTransectPoints"] = [
            [each.lat_deg, each.lon_deg] for each in item.items if isinstance(each, PlacedItem)
        ]
        raw[TRANSECTS]["CameraShots"] = _photos(item.pattern)
    return [*speed, with_items(raw, lines)], None


def with_items(raw: Raw, parts: list[Raw]) -> Raw:
    """The complex item with its mission items, if it is of a kind that contains them."""
    transects = raw.get(TRANSECTS)
    if isinstance(transects, dict) and "Items" in transects:
        transects["Items"] = parts
    return raw


def _missing_in_qgroundcontrol(pattern: PatternDocument) -> str | None:
    """Why QGroundControl cannot fly the same pattern; None: it can."""
    if isinstance(pattern, SurveyPattern | CorridorPattern) and pattern.altitude.value_m <= 0.0:
        return "QGroundControl's patterns are above 0 m only"
    if isinstance(pattern, SurveyPattern):
        return "QGroundControl's survey has no holes" if pattern.holes else None
    if isinstance(pattern, StructurePattern):
        altitudes = [pattern.base, *([] if pattern.entrance is None else [pattern.entrance])]
        if any(each.reference != "home" for each in altitudes):
            return "QGroundControl's structure scan has altitudes above home only"
        if pattern.layers is None or pattern.entrance is None:
            return "QGroundControl's structure scan needs a number of rounds and an entrance altitude"
        return None
    return None if isinstance(pattern, CorridorPattern) else "QGroundControl has no such pattern"


def _keys(pattern: PatternDocument) -> Raw:
    """The keys of QGroundControl that a pattern determines."""
    if isinstance(pattern, StructurePattern):
        half_m = _spacing_m(pattern.coverage) / 2.0
        base_m = pattern.base.value_m
        return {
            "polygon": [[each.lat_deg, each.lon_deg] for each in pattern.outline],
            "StructureHeight": whole(base_m + pattern.height_m),
            "ScanBottomAlt": whole(round(base_m + pattern.lowest_m - half_m, 6)),
            "EntranceAltitude": whole(pattern.entrance.value_m if pattern.entrance else 0.0),
            "StartFromTop": pattern.from_top,
            "GimbalPitch": whole(pattern.gimbal_pitch_deg),
            "Layers": pattern.layers,
            CAMERA: camera_keys(pattern.coverage, None),
        }
    assert isinstance(pattern, SurveyPattern | CorridorPattern)
    transects: Raw = {
        "TurnAroundDistance": whole(pattern.turnaround_m),
        CAMERA: camera_keys(pattern.coverage, pattern.altitude),
    }
    if isinstance(pattern, CorridorPattern):
        line = [[each.lat_deg, each.lon_deg] for each in pattern.points]
        return {"polyline": line, "CorridorWidth": whole(pattern.width_m), TRANSECTS: transects}
    return {
        "polygon": [[each.lat_deg, each.lon_deg] for each in pattern.outer],
        "angle": whole(_heading_deg(pattern)),
        TRANSECTS: {**transects, "Refly90Degrees": pattern.crosshatch},
    }


def _heading_deg(pattern: SurveyPattern) -> float:
    from missions.patterns.document import make  # shapely, 0.2 s to import

    return pattern.heading_deg if pattern.heading_deg is not None else make(pattern).heading_deg or 0.0


def _photos(pattern: PatternDocument) -> int:
    from missions.patterns.document import make  # shapely, 0.2 s to import

    return make(pattern).photos


def _merge(raw: Raw, keys: Raw, before: Raw) -> None:
    """Writes the keys whose values are not those of `before` into the JSON."""
    for key, value in keys.items():
        if isinstance(value, dict):
            inner = raw.setdefault(key, {})
            _merge(inner, value, before.get(key, {}))
        elif key not in before or before[key] != value:
            raw[key] = value
    if CAMERA_DATA[0] in keys:
        has_no_camera = raw.get("CameraName", MANUAL_CAMERA) == MANUAL_CAMERA
        if has_no_camera or any(before.get(key, keys[key]) != keys[key] for key in CAMERA_DATA):
            raw["CameraName"] = CUSTOM_CAMERA
    if "DistanceMode" in raw and "DistanceToSurfaceRelative" in raw:  # version 1 has the latter only
        del raw["DistanceToSurfaceRelative"]
        raw["version"] = 2


def _template(kind: str) -> Raw:
    """A new complex item; the pattern's own keys are still missing."""
    camera: Raw = {"version": 2}
    if kind == "structure":
        return {"type": "ComplexItem", "complexItemType": "StructureScan", "version": 3, CAMERA: camera}
    transects: Raw = {
        "version": 2,
        "CameraTriggerInTurnAround": False,
        "HoverAndCapture": False,
        "Refly90Degrees": False,
        CAMERA: camera,
        "Items": [],
    }
    if kind == "corridor":
        own: Raw = {"complexItemType": "CorridorScan", "version": 2, "EntryPoint": 0}
    else:
        own = {"complexItemType": "survey", "version": 5, "entryLocation": 0, "flyAlternateTransects": False}
        own["splitConcavePolygons"] = False
    return {"type": "ComplexItem", **own, TRANSECTS: transects}
