"""Reads and writes QGroundControl's .plan files without loss.

Each part of a plan keeps its JSON (`original`), so that fields not modelled here are written back in the same
order. A changed part keeps its unknown keys. The format:
https://docs.qgroundcontrol.com/master/en/qgc-dev-guide/file_formats/plan.html
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any, Final

from pydantic import TypeAdapter, ValidationError

from missions import bounded_json
from missions.errors import PlanError, from_validation
from missions.formats import qgc_item, qgc_pattern
from missions.formats.here import is_here, resolve_here
from missions.formats.qgc_fence import read_fence, read_rally, write_fence, write_rally
from missions.formats.qgc_item import optional_list, require_list, require_number, require_object
from missions.formats.results import Imported, Written
from missions.items import CommandItem, Jump
from missions.plan import ComplexItem, ItemGroup, PatternItem, Plan, PlanItem, SimpleItem, check_item_count
from missions.values import HomePosition, Obstacle, Obstacles

_VERSIONS: Final = {"mission": 2, "geoFence": 2, "rallyPoints": 2}
_SKIPPED_PARTS: Final = {"geoFence": "geofence", "rallyPoints": "list of rally points"}
"""Parts whose version 1 QGroundControl ignores, because its content has changed entirely."""
_SPEEDS: Final = {"cruiseSpeed": "cruise_speed_m_s", "hoverSpeed": "hover_speed_m_s"}
_PX4, _QUADROTOR = 12, 2
_OBSTACLES_KEY: Final = "offboardGcsObstacles"
"""Key of the obstacles, which are written as in this project's JSON. QGroundControl ignores this key, and
does not save it."""
_OBSTACLES_ADAPTER: TypeAdapter[tuple[Obstacle, ...]] = TypeAdapter(Obstacles)


def read(data: bytes | str) -> Imported:
    """The plan of a .plan file.

    Raises:
        PlanError: The file is too large, not JSON or not a plan, or a value is wrong; the error names item,
            field and fix.
    """
    document = require_object(bounded_json.load(data), "the file")
    if document.get("fileType") != "Plan":
        raise PlanError("field fileType", 'it is not "Plan"', "Choose a .plan file.")
    document, skipped_notes = _without_old_parts(document)
    for part, version in _VERSIONS.items():
        if part in document:
            _check_version(require_object(document[part], f"field {part}"), part, version)
    mission = require_object(document.get("mission"), "field mission")
    items, notes = _read_items(require_list(mission.get("items"), "field mission.items"))
    fence = require_object(document.get("geoFence", {}), "field geoFence")
    rally = require_object(document.get("rallyPoints", {}), "field rallyPoints")
    points = optional_list(rally, "points", "rallyPoints")
    try:
        plan = Plan(
            items=items,
            fence=read_fence(fence),
            rally_points=tuple(read_rally(n, raw) for n, raw in enumerate(points)),
            planned_home=_home(mission),
            obstacles=_obstacles(document),
            original=bounded_json.dump(_without_items_and_zones(document)),
            cruise_speed_m_s=_speed(mission, "cruiseSpeed"),
            hover_speed_m_s=_speed(mission, "hoverSpeed"),
        )
    except ValidationError as error:
        raise from_validation(error) from None
    home: tuple[float, float] | None = None
    if plan.planned_home is None and mission.get("plannedHomePosition") is not None:
        home = _home_position(mission)
        what = "is at latitude 0, longitude 0" if home is None else "has no altitude"
        notes += (f"The planned home {what}, so it counts as not set.",)
    plan, here_notes = resolve_here(check_item_count(plan), home)
    return Imported(plan, notes=(*skipped_notes, *notes, *here_notes))


def write(plan: Plan) -> Written:
    """The plan as a .plan file for PX4 multicopters; an unchanged plan is written exactly as it was read.

    Raises:
        PlanError: A rally point's altitude cannot be converted to an altitude above home.
    """
    document = _original_document(plan.original) if plan.original else _empty_document()
    mission = document["mission"]
    mission["items"], pattern_notes = _write_items(plan)
    if plan.planned_home != _home(mission):
        mission["plannedHomePosition"] = None
        if plan.planned_home is not None:
            home = plan.planned_home
            mission["plannedHomePosition"] = [home.lat_deg, home.lon_deg, home.alt_amsl_m]
    for key, field in _SPEEDS.items():
        if getattr(plan, field) != _speed(mission, key):
            mission[key] = getattr(plan, field)
    write_fence(document, plan.fence)
    write_rally(document, plan)
    if plan.obstacles != _obstacles(document):
        document[_OBSTACLES_KEY] = [
            each.model_dump(mode="json", exclude_defaults=True) for each in plan.obstacles
        ]
    text = json.dumps(document, ensure_ascii=False, allow_nan=False, indent=4) + "\n"
    # a lone surrogate cannot be encoded in UTF-8, so the text is written in ASCII
    if any("\ud800" <= letter <= "\udfff" for letter in text):
        text = json.dumps(document, allow_nan=False, indent=4) + "\n"
    if not plan.planned_home:
        pattern_notes.append("QGroundControl opens only plans with a home position.")
    return Written(text.encode(), tuple(pattern_notes))


# --- document -----------------------------------------------------------------------------------------


def _without_old_parts(document: dict[str, Any]) -> tuple[dict[str, Any], tuple[str, ...]]:
    """The document without parts of version 1, and notes about them."""
    kept, notes = dict(document), list[str]()
    for key, name in _SKIPPED_PARTS.items():
        part = document.get(key)
        if isinstance(part, dict) and part.get("version", 1) == 1:
            del kept[key]
            if key == "geoFence" or any(value for field, value in part.items() if field != "version"):
                notes.append(f"The {name} of the file has an old version (1) and is left out: draw it again.")
    return kept, tuple(notes)


def _check_version(part: dict[str, Any], name: str, version: int) -> None:
    if part.get("version") != version:
        reason = f"version {str(part.get('version'))[:20]} is not supported, only {version}"
        raise PlanError(f"field {name}.version", reason, "Save the file with a current QGroundControl.")


def _empty_document() -> dict[str, Any]:
    return {
        "fileType": "Plan",
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "groundStation": "QGroundControl",
        "mission": {
            "firmwareType": _PX4,
            "globalPlanAltitudeMode": 0,
            "items": [],
            "vehicleType": _QUADROTOR,
            "version": 2,
        },
        "rallyPoints": {"points": [], "version": 2},
        "version": 1,
    }


def _original_document(original: str) -> dict[str, Any]:
    """The original document. It is checked again, because the JSON of the plan may have been edited."""
    document = require_object(bounded_json.load(original), "field original")
    for key in ("mission", *(key for key in ("geoFence", "rallyPoints") if key in document)):
        require_object(document.get(key), f"field original, field {key}")
    optional_list(document.get("rallyPoints", {}), "points", "original.rallyPoints")
    return document


def _without_items_and_zones(document: dict[str, Any]) -> dict[str, Any]:
    """The document without items and zones; each item and zone keeps its own JSON."""
    kept = dict(document)
    kept["mission"] = {**document["mission"], "items": []}
    if "geoFence" in document:
        fence = document["geoFence"]
        kept["geoFence"] = {**fence, **{key: [] for key in ("circles", "polygons") if key in fence}}
    return kept


def _home(mission: dict[str, Any]) -> HomePosition | None:
    raw = mission.get("plannedHomePosition")
    if raw is None:
        return None
    place = "field mission.plannedHomePosition"
    values = require_list(raw, place)
    if len(values) != 3:
        raise PlanError(place, f"it has {len(values)} numbers, not 3", "Write latitude, longitude, altitude.")
    position = _home_position(mission)
    if position is None or values[2] is None:
        return None
    alt = require_number(values[2], f"{place}[2]")
    try:
        return HomePosition(lat_deg=position[0], lon_deg=position[1], alt_amsl_m=alt)
    except ValidationError as error:
        raise from_validation(error, ("planned_home",)) from None


def _home_position(mission: dict[str, Any]) -> tuple[float, float] | None:
    """Latitude and longitude of the planned home; None: they are 0/0, which is no position."""
    raw = mission["plannedHomePosition"]
    lat, lon = (require_number(raw[n], f"field mission.plannedHomePosition[{n}]") for n in range(2))
    return None if is_here(lat, lon) else (lat, lon)


def _obstacles(document: dict[str, Any]) -> tuple[Obstacle, ...]:
    raws = require_list(document.get(_OBSTACLES_KEY, []), f"field {_OBSTACLES_KEY}")
    try:
        return _OBSTACLES_ADAPTER.validate_json(bounded_json.dump(raws))
    except ValidationError as error:
        raise from_validation(error, ("obstacles",)) from None


def _speed(mission: dict[str, Any], key: str) -> float | None:
    """A planned speed in m/s; QGroundControl writes 0 or null for no planned speed."""
    raw = mission.get(key)
    if raw is None:
        return None
    value = require_number(raw, f"field mission.{key}")
    return value if value > 0.0 else None


# --- items --------------------------------------------------------------------------------------------


def _read_items(raws: list[Any]) -> tuple[tuple[PlanItem, ...], tuple[str, ...]]:
    items: list[PlanItem] = []
    ids: list[int] = []
    notes: list[str] = []
    for n, each in enumerate(raws, start=1):
        part = require_object(each, f"item {n}")
        if part.get("type") == "SimpleItem":
            items.append(qgc_item.read_simple(part, f"item {n}"))
            ids.append(qgc_item.jump_id(part, len(ids)))
            continue
        item, inner, note = _read_complex(part, n)
        items.append(item)
        ids += [qgc_item.jump_id(raw, len(ids) + k) for k, raw in enumerate(inner)]
        # no jump of the file names an item that was made here
        ids += [-len(ids) - k for k in range(1, len(item.items) - len(inner) + 1)]
        notes += [] if note is None else [note]
    # of several items with the same doJumpId, the first counts
    index_of = {each_id: index for index, each_id in reversed(list(enumerate(ids)))}
    return tuple(_with_targets(item, index_of) for item in items), tuple(notes)


def _read_complex(
    part: dict[str, Any], n: int
) -> tuple[ComplexItem | PatternItem, list[dict[str, Any]], str | None]:
    """A pattern, the JSON objects of its mission items in the file, and a note for the pilot."""
    name = str(part.get("complexItemType", part.get("type")))[:100]
    inner: list[dict[str, Any]] = []
    transects = part.get("TransectStyleComplexItem")
    if isinstance(transects, dict) and "Items" in transects:
        place = f"item {n}, field TransectStyleComplexItem.Items"
        inner = [
            require_object(raw, f"{place}[{k}]")
            for k, raw in enumerate(require_list(transects["Items"], place))
        ]
    items = tuple(qgc_item.read_simple(each, f"item {n}, part {k}") for k, each in enumerate(inner, start=1))
    original = bounded_json.dump(_without_items(part))
    note: str | None = None
    try:
        pattern, reason = qgc_pattern.read(part, f"item {n}")
        if pattern is not None:
            try:
                return qgc_pattern.item_of(pattern, items, original), inner, None
            except PlanError as error:
                reason = f"{error.place}: {error.reason}"
        if not items:
            note = f"Item {n} ({name}) contains no mission items: it is kept, but cannot be flown"
        elif reason is not None:
            note = f"Item {n} ({name}) is kept as it is, and flown with the items in the file"
        note = None if note is None else f"{note} ({reason})." if reason else f"{note}."
        return ComplexItem(complex_type=name, items=items, original=original), inner, note
    except ValidationError as error:
        raise from_validation(error, ("items", n - 1)) from None


def _without_items(part: dict[str, Any]) -> dict[str, Any]:
    transects = part.get("TransectStyleComplexItem")
    if not isinstance(transects, dict) or "Items" not in transects:
        return part
    return {**part, "TransectStyleComplexItem": {**transects, "Items": []}}


def _with_targets(item: PlanItem, index_of: dict[int, int]) -> PlanItem:
    """Converts the target of a jump from the file's doJumpId to the index in the plan."""
    if isinstance(item, ItemGroup):
        return item.model_copy(update={"items": tuple(_with_targets(each, index_of) for each in item.items)})
    if not isinstance(item, Jump):
        return item
    index = index_of.get(item.target_index)
    if index is not None:
        return item.model_copy(update={"target_index": index})
    params = (float(item.target_index), float(item.repeat), 0.0, 0.0, 0.0, 0.0, 0.0)
    return CommandItem(
        command=item.COMMAND, frame=2, params=params, autocontinue=item.autocontinue, original=item.original
    )


def _write_items(plan: Plan) -> tuple[list[Any], list[str]]:
    """The items of the file, and notes about patterns that QGroundControl does not have."""
    simple = [item for _, item in plan.simple_items()]
    ids = _jump_ids(simple)
    index_of = {each: index for index, each in enumerate(ids)}
    first = 0
    written: list[Any] = []
    notes: list[str] = []
    for number, item in enumerate(plan.items, start=1):
        count = len(item.items) if isinstance(item, ItemGroup) else 1
        parts = [_write_simple(simple[k], ids[k], ids, index_of) for k in range(first, first + count)]
        first += count
        if isinstance(item, ComplexItem):
            raw = require_object(bounded_json.load(item.original), "the complex item")
            written.append(qgc_pattern.with_items(raw, parts))
        elif isinstance(item, PatternItem):
            rows, reason = qgc_pattern.write(item, parts)
            written += rows
            if reason is not None:
                name = f"Item {number} ({item.pattern.kind})"
                notes.append(f"{name} is written as the items inside it: {reason}.")
        else:
            written += parts
    return written, notes


def _jump_ids(items: Sequence[SimpleItem]) -> list[int]:
    """A doJumpId for each item: the doJumpId from the file if it is unique, otherwise a new one."""
    originals: list[int | None] = []
    used_ids: set[int] = set()
    for item in items:
        original = qgc_item.original_jump_id(item)
        originals.append(None if original in used_ids else original)
        if original is not None:
            used_ids.add(original)
    last = 0
    ids: list[int] = []
    for original in originals:
        if original is None:
            last += 1
            while last in used_ids:
                last += 1
            used_ids.add(last)
        ids.append(last if original is None else original)
    return ids


def _write_simple(
    item: SimpleItem, item_jump_id: int, ids: list[int], index_of: dict[int, int]
) -> dict[str, Any]:
    new_object = qgc_item.simple_object(item, item_jump_id)
    if isinstance(item, Jump):
        target = item.target_index
        new_object["params"][0] = ids[target] if target < len(ids) else max(ids) + 1
    if item.original is None:
        return new_object
    raw = require_object(bounded_json.load(item.original), "the item")
    as_read = _with_targets(qgc_item.read_simple(raw, "the item"), index_of)
    if as_read != item:
        return {**raw, **new_object}
    if "doJumpId" in raw:
        raw["doJumpId"] = item_jump_id
    return raw
