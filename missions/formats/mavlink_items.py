"""Converts a plan to and from the items of the MAVLink mission protocol.

A `WireItem` has the fields of MISSION_ITEM_INT: parameters as 32-bit floats, x and y as integers
(1e-7 degrees in global frames, 1e-4 m in local frames, unscaled in MAV_FRAME_MISSION), z in metres.
https://mavlink.io/en/services/mission.html
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from missions.errors import PlanError, from_validation
from missions.items import CommandItem, Item, Jump, LegacyRoi, PlacedItem, Slot
from missions.plan import TYPED_ITEMS, Plan, PlanItem, SimpleItem
from missions.values import Altitude, FenceCircle, FencePolygon, FenceZone, Point, RallyPoint, Reference

MAV_FRAME_GLOBAL, MAV_FRAME_MISSION, MAV_FRAME_GLOBAL_RELATIVE_ALT = 0, 2, 3
MAV_FRAME_GLOBAL_INT, MAV_FRAME_GLOBAL_RELATIVE_ALT_INT = 5, 6
MAV_FRAME_GLOBAL_TERRAIN_ALT, MAV_FRAME_GLOBAL_TERRAIN_ALT_INT = 10, 11
MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION = 5001, 5002
MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION = 5003, 5004
MAV_CMD_NAV_FENCE_RETURN_POINT = 5000
MAV_CMD_NAV_RALLY_POINT = 5100
FENCE_COMMANDS = (
    MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
    MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
    MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION,
    MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION,
)

REFERENCE_OF_FRAME: dict[int, Reference] = {
    MAV_FRAME_GLOBAL: "amsl",
    MAV_FRAME_GLOBAL_INT: "amsl",
    MAV_FRAME_GLOBAL_RELATIVE_ALT: "home",
    MAV_FRAME_GLOBAL_RELATIVE_ALT_INT: "home",
    MAV_FRAME_GLOBAL_TERRAIN_ALT: "terrain",
    MAV_FRAME_GLOBAL_TERRAIN_ALT_INT: "terrain",
}
FILE_FRAME: dict[Reference, int] = {"amsl": 0, "home": 3, "terrain": 10}
"""Frames in files; files do not use _INT frames."""
WIRE_FRAME: dict[Reference, int] = {"amsl": 5, "home": 6, "terrain": 11}
RALLY_FRAME: dict[Reference, int] = FILE_FRAME
"""PX4's Return mode refuses _INT frames in rally points ("RTL: unsupported MAV_FRAME")."""
ROI_NONE = 0.0
MOST_REPEATS = 65_535.0
"""Sent for an endless jump: PX4 stores an unsigned 16-bit number, and C does not define what -1 becomes."""
LOCAL_FRAMES = frozenset({1, 4, 7, 8, 9, 12, 20, 21})

CLASS_OF_COMMAND: dict[int, type[Item]] = {each.COMMAND: each for each in TYPED_ITEMS}

Params = tuple[float | None, ...]
"""MAVLink's seven parameters; in global frames 5 and 6 are degrees; None means NaN."""


@dataclass(frozen=True, slots=True)
class WireItem:
    """The fields of one MISSION_ITEM_INT, NaN included."""

    seq: int
    frame: int
    command: int
    param1: float
    param2: float
    param3: float
    param4: float
    x: int
    y: int
    z: float
    autocontinue: bool = True
    current: bool = False


# --- items to seven parameters, and back --------------------------------------------------------------


def altitude_of(item: SimpleItem) -> Altitude | None:
    """The altitude of an item; None: the item has no position."""
    return item.altitude if isinstance(item, PlacedItem) else None


def params_of(item: SimpleItem) -> Params:
    """The seven parameters of an item. For a terrain altitude, parameter 7 is the height above ground."""
    if isinstance(item, CommandItem):
        return item.params
    values: list[float | None] = [_slot_value(item, slot) for slot in item.SLOTS]
    if isinstance(item, PlacedItem):
        values += [item.lat_deg, item.lon_deg, item.altitude.value_m]
    for number, value in item.spare_params:
        values[number - 1] = value
    return tuple(values)


def _slot_value(item: Item, slot: Slot) -> float | None:
    return getattr(item, slot) if isinstance(slot, str) else slot


def item_from_params(
    command: int, frame: int, params: Params, *, autocontinue: bool = True, original: str | None = None
) -> SimpleItem:
    """Converts seven parameters to an item. A command for which no class exists becomes a `CommandItem`.

    The frame of an item without a position is ignored, because files of other autopilots contain any
    value in this field.

    Raises:
        PlanError: A value is out of range; `place` names only the field, not the item.
    """
    cls = CLASS_OF_COMMAND.get(command)
    if cls is not None:
        fields = _fields(cls, frame, params)
        if fields is not None:
            fields |= {"autocontinue": autocontinue, "original": original}
            try:
                return cls.model_validate(fields)  # type: ignore[return-value]
            except ValidationError as error:
                raise from_validation(error) from None
    try:
        return CommandItem.model_validate(
            {
                "command": command,
                "frame": frame,
                "params": params,
                "autocontinue": autocontinue,
                "original": original,
            }
        )
    except ValidationError as error:
        raise from_validation(error) from None


def _fields(cls: type[Item], frame: int, params: Params) -> dict[str, Any] | None:
    """Fields of a typed item; None: the class cannot store the values (no position, unsupported frame)."""
    fields: dict[str, Any] = {}
    unusual: list[tuple[int, float | None]] = []
    has_position = issubclass(cls, PlacedItem)
    for number, (slot, value) in enumerate(zip(cls.SLOTS, params, strict=False), start=1):
        if not isinstance(slot, str):
            if value != slot:
                unusual.append((number, value))
        elif cls.model_fields[slot].annotation is int:
            if value is None or not float(value).is_integer():
                return None
            fields[slot] = int(value)
        else:
            fields[slot] = value
    if has_position:
        reference = REFERENCE_OF_FRAME.get(frame)
        if reference is None or None in params[4:7]:
            return None
        fields |= {"lat_deg": params[4], "lon_deg": params[5]}
        try:
            fields["altitude"] = Altitude.model_validate({"value_m": params[6], "reference": reference})
        except ValidationError as error:
            raise from_validation(error, ("altitude",)) from None
    fields["spare_params"] = tuple(unusual)
    return fields


def typed_plan(plan: Plan) -> Plan:
    """The plan with a typed item for each `CommandItem` that has the command and the values of one.

    PX4 flies both alike, and checks and estimates know typed items only.
    """
    if not any(isinstance(item, CommandItem) for item in plan.items):
        return plan
    return plan.model_copy(update={"items": tuple(_typed_item(item) for item in plan.items)})


def _typed_item(item: PlanItem) -> PlanItem:
    if not isinstance(item, CommandItem):
        return item
    has_position = issubclass(CLASS_OF_COMMAND.get(item.command, Item), PlacedItem)
    if has_position != (item.frame in REFERENCE_OF_FRAME):
        return item
    try:
        return item_from_params(
            item.command, item.frame, item.params, autocontinue=item.autocontinue, original=item.original
        )
    except PlanError:
        return item


def frame_of(item: SimpleItem, frames: dict[Reference, int]) -> int:
    """The item's MAV_FRAME; `frames` contains the frame of each altitude reference."""
    if isinstance(item, CommandItem):
        return item.frame
    return frames[item.altitude.reference] if isinstance(item, PlacedItem) else MAV_FRAME_MISSION


# --- a plan to MAVLink messages, and back -------------------------------------------------------------


def mission_items(plan: Plan) -> tuple[WireItem, ...]:
    """The mission items to upload. A terrain altitude is sent as `resolved_amsl_m` if that is known.

    Raises:
        PlanError: A value does not fit into the message; the error names the item.
    """
    wire_items: list[WireItem] = []
    for seq, (row, item) in enumerate(plan.simple_items()):
        try:
            wire_items.append(_to_wire(item, seq))
        except PlanError as error:
            raise PlanError(f"item {row + 1}, {error.place}", error.reason, error.fix) from None
    return tuple(wire_items)


def _to_wire(item: SimpleItem, seq: int) -> WireItem:
    frame, params = frame_of(item, WIRE_FRAME), params_of(item)
    altitude = altitude_of(item)
    if altitude is not None and altitude.resolved_amsl_m is not None:
        frame, params = MAV_FRAME_GLOBAL_INT, (*params[:6], altitude.resolved_amsl_m)
    command = item.command if isinstance(item, CommandItem) else item.COMMAND
    if isinstance(item, LegacyRoi) and item.mode == ROI_NONE:
        # PX4 returns a mode with a position as 0, so that "none" would become "location".
        frame, params = MAV_FRAME_MISSION, (*params[:4], 0.0, 0.0, 0.0)
    if isinstance(item, Jump) and item.repeat < 0:
        params = (params[0], MOST_REPEATS, *params[2:])
    p1, p2, p3, p4, _, _, z = (_float32(value, n) for n, value in enumerate(params, start=1))
    x, y = (_wire_integer(params[n - 1], frame, n) for n in (5, 6))
    return WireItem(seq, frame, command, p1, p2, p3, p4, x, y, z, item.autocontinue, current=seq == 0)


def _float32(value: float | None, number: int) -> float:
    try:
        return math.nan if value is None else struct.unpack("<f", struct.pack("<f", value))[0]
    except OverflowError:
        reason = "it is too large for a 32-bit number"
        raise PlanError(f"parameter {number}", reason, "Correct this value.") from None


def _wire_integer(value: float | None, frame: int, number: int) -> int:
    scale = 1e7 if frame in REFERENCE_OF_FRAME else 1e4 if frame in LOCAL_FRAMES else 1.0
    if value is None and frame in REFERENCE_OF_FRAME:
        raise PlanError(f"parameter {number}", "the position is missing", "Set latitude and longitude.")
    if value is None:
        return 0
    scaled = value * scale
    if scale == 1.0 and not float(value).is_integer():
        raise PlanError(f"parameter {number}", f"{value} is not a whole number", "Write a whole number.")
    if abs(scaled) > 2**31 - 1:
        raise PlanError(f"parameter {number}", f"{value} is too large for the message", "Correct this value.")
    return round(scaled)


def items_from_wire(items: Sequence[WireItem]) -> tuple[SimpleItem, ...]:
    """The items of a vehicle's mission. An item with an impossible value, for example a latitude of 95°,
    becomes a `CommandItem`."""
    return tuple(_from_wire(item) for item in items)


def _from_wire(item: WireItem) -> SimpleItem:
    scale = 1e7 if item.frame in REFERENCE_OF_FRAME else 1e4 if item.frame in LOCAL_FRAMES else 1.0
    raw = (item.param1, item.param2, item.param3, item.param4, item.x / scale, item.y / scale, item.z)
    params = tuple(_bounded(value) for value in raw)
    try:
        return item_from_params(item.command, item.frame, params, autocontinue=item.autocontinue)
    except PlanError:
        return CommandItem(
            command=item.command,
            frame=item.frame,
            params=params,  # type: ignore[arg-type]
            autocontinue=item.autocontinue,
        )


def _bounded(value: float) -> float | None:
    return value if math.isfinite(value) and abs(value) <= 1e9 else None


# --- fence and rally points ---------------------------------------------------------------------------


def fence_items(plan: Plan) -> tuple[WireItem, ...]:
    """The geofence items to upload; a polygon is one item for each corner."""
    wire_items: list[WireItem] = []
    for zone in plan.fence:
        corners: tuple[Point, ...] = (zone.center,) if isinstance(zone, FenceCircle) else zone.polygon
        value = _float32(zone.radius_m, 1) if isinstance(zone, FenceCircle) else float(len(corners))
        for corner in corners:
            wire_items.append(
                _point(len(wire_items), fence_command(zone), MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, corner, value)
            )
    return tuple(wire_items)


def fence_command(zone: FenceCircle | FencePolygon) -> int:
    """The MAV_CMD of a zone's items."""
    if isinstance(zone, FenceCircle):
        return MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION if zone.inclusion else MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION
    if zone.inclusion:
        return MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
    return MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION


def rally_items(plan: Plan) -> tuple[WireItem, ...]:
    """The rally items to upload."""
    wire_items: list[WireItem] = []
    for seq, rally in enumerate(plan.rally_points):
        amsl_m = rally.altitude.resolved_amsl_m
        frame = RALLY_FRAME[rally.altitude.reference] if amsl_m is None else MAV_FRAME_GLOBAL
        z = _float32(rally.altitude.value_m if amsl_m is None else amsl_m, 7)
        wire_items.append(_point(seq, MAV_CMD_NAV_RALLY_POINT, frame, rally, 0.0, z))
    return tuple(wire_items)


def _point(
    seq: int, command: int, frame: int, point: Point | RallyPoint, param1: float, z: float = 0.0
) -> WireItem:
    x, y = round(point.lat_deg * 1e7), round(point.lon_deg * 1e7)
    return WireItem(seq, frame, command, param1, 0.0, 0.0, 0.0, x, y, z, current=seq == 0)


def fence_from_wire(items: Sequence[WireItem]) -> tuple[FenceZone, ...]:
    """The geofence zones of a vehicle's fence items.

    Raises:
        PlanError: An item is not a geofence command, or corners of a polygon are missing; the error names the
            item.
    """
    zones: list[FenceZone] = []
    index = 0
    while index < len(items):
        item = items[index]
        inclusion = item.command in (
            MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
            MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION,
        )
        try:
            if item.command in (MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION):
                zones.append(FenceCircle(inclusion=inclusion, center=_position(item), radius_m=item.param1))
                index += 1
                continue
            corners = _corners(items, index)
            zones.append(FencePolygon(inclusion=inclusion, polygon=corners))
            index += len(corners)
        except ValidationError as error:
            raise from_validation(error, ("fence", len(zones))) from None
    return tuple(zones)


def _corners(items: Sequence[WireItem], first: int) -> tuple[Point, ...]:
    start, place = items[first], f"geofence item {first + 1}"
    if start.command not in (
        MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
        MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
    ):
        raise PlanError(
            place, f"command {start.command} is not a geofence command", "Upload the geofence again."
        )
    count = int(start.param1) if math.isfinite(start.param1) and 3 <= start.param1 <= len(items) else 0
    corners = items[first : first + count]
    if not count or len(corners) < count or any(each.command != start.command for each in corners):
        raise PlanError(
            place,
            f"its polygon does not have {start.param1:g} corners as stated",
            "Upload the geofence again.",
        )
    return tuple(_position(each) for each in corners)


def rally_from_wire(items: Sequence[WireItem]) -> tuple[RallyPoint, ...]:
    """The rally points of a vehicle's rally items.

    Raises:
        PlanError: An item is not a rally point, or has an impossible value; the error names the item.
    """
    rally_points: list[RallyPoint] = []
    for number, item in enumerate(items, start=1):
        reference = REFERENCE_OF_FRAME.get(item.frame)
        if item.command != MAV_CMD_NAV_RALLY_POINT or reference is None:
            reason = f"command {item.command} in frame {item.frame} is not a rally point"
            raise PlanError(f"rally item {number}", reason, "Upload the rally points again.")
        try:
            point, altitude = _position(item), Altitude(value_m=item.z, reference=reference)
        except ValidationError as error:
            raise from_validation(error, ("rally_points", number - 1)) from None
        rally_points.append(RallyPoint(lat_deg=point.lat_deg, lon_deg=point.lon_deg, altitude=altitude))
    return tuple(rally_points)


def _position(item: WireItem) -> Point:
    return Point(lat_deg=item.x / 1e7, lon_deg=item.y / 1e7)
