"""The .waypoints format "QGC WPL 110" of MAVProxy, Mission Planner, MAVSDK and older QGroundControl.

One item per line: index, current, frame, command, four parameters, x, y, z, autocontinue. Blank lines and
lines that begin with # count for nothing. The target of a jump is the index of an item.
https://mavlink.io/en/file_formats/

**Home.** In version 110 the first row, if its index is 0, is home if it is a waypoint (command 16) or has no
command (0), of any frame, radius, yaw and `current`, as these programs read and write it. Its altitude
is above mean sea level, also in a relative frame. Any other first row is the first item: MAVSDK's files begin
with a take-off, files of geofences with a corner. A home at 0/0, or without a number for its position or
altitude, was not set. In version 120, of older QGroundControl, no row is home.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

from pydantic import ValidationError

from missions.bounded_json import decode_lines
from missions.errors import PlanError, from_validation
from missions.formats.here import is_here, resolve_here
from missions.formats.mavlink_items import (
    FENCE_COMMANDS,
    FILE_FRAME,
    MAV_CMD_NAV_FENCE_RETURN_POINT,
    MAV_CMD_NAV_RALLY_POINT,
    WireItem,
    fence_from_wire,
    frame_of,
    item_from_params,
    params_of,
    rally_from_wire,
)
from missions.formats.results import Imported, Written, count, loss_notes
from missions.items import CommandItem, Jump, PlacedItem
from missions.plan import MAX_ITEMS, Plan, SimpleItem
from missions.values import HomePosition

HEADER = "QGC WPL 110"
_HEADER_WITHOUT_HOME = "QGC WPL 120"
_COLUMNS = ("index", "current", "frame", "command", "param1", "param2", "param3", "param4", "x", "y", "z")
_WAYPOINT, _GLOBAL = 16, 0
_HOME_COMMANDS = (_WAYPOINT, 0)
_YAW = 3
"""Index of the yaw in the parameters of items with a position."""
_NORTH_DEG = 360.0
"""How the yaw 0 is written, because a yaw of 0 means none."""


@dataclass(frozen=True, slots=True)
class _Row:
    """One line: command, frame, seven parameters (None: not a number)."""

    line: int
    index: float
    frame: int
    command: int
    params: tuple[float | None, ...]
    autocontinue: bool


def read(data: bytes | str) -> Imported:
    """The plan of a .waypoints file, with the geofence and the rally points among its rows.

    A position at 0/0 means "here" (`formats.here`). A yaw of 0 means that the item has no yaw, because most
    autopilots ignore it and most programs write 0.

    Raises:
        PlanError: The file is too large or not a .waypoints file, or a value is wrong; the error names the
            line and the column.
    """
    lines = [
        (n, line.strip())
        for n, line in enumerate(decode_lines(data).splitlines(), start=1)
        if line.strip() and not line.strip().startswith("#")
    ]
    header = " ".join(lines[0][1].split()) if lines else ""
    if header not in (HEADER, _HEADER_WITHOUT_HOME):
        place = f"line {lines[0][0]}" if lines else "line 1"
        raise PlanError(place, f'it is not "{HEADER}"', "Choose a .waypoints file.")
    rows = [_row(n, line.split()) for n, line in lines[1:]]
    if len(rows) > MAX_ITEMS + 1:
        raise PlanError("the file", f"{len(rows)} items, the maximum is {MAX_ITEMS}", "Split the plan.")
    if not rows:
        raise PlanError("the file", "it has no rows", "Choose another file.")
    may_be_home = header == HEADER and rows[0].index == 0 and rows[0].command in _HOME_COMMANDS
    home_row = rows[0] if may_be_home else None
    home = None if home_row is None else _home(home_row)
    notes: list[str] = []
    if home_row is None:
        notes.append("The file has no home position; its first row is the first item.")
    elif home is None:
        notes.append(f"Home in line {home_row.line} is not set: the plan has no home.")
    fence_rows = [row for row in rows if row.command in FENCE_COMMANDS]
    rally_rows = [row for row in rows if row.command == MAV_CMD_NAV_RALLY_POINT]
    plan = Plan(
        items=_items(rows, home_row),
        fence=fence_from_wire(_wire_items(fence_rows)),
        rally_points=rally_from_wire(_wire_items(rally_rows)),
        planned_home=home,
    )
    return_points = sum(row.command == MAV_CMD_NAV_FENCE_RETURN_POINT for row in rows)
    if return_points:
        text = count(return_points, "return point")
        notes.append(f"Left out: {text} of the geofence, because PX4 returns to home or a rally point.")
    plan, here_notes = resolve_here(plan)
    return Imported(plan, notes=(*notes, *here_notes))


def _items(rows: list[_Row], home_row: _Row | None) -> tuple[SimpleItem, ...]:
    commands_elsewhere = (*FENCE_COMMANDS, MAV_CMD_NAV_RALLY_POINT, MAV_CMD_NAV_FENCE_RETURN_POINT)
    is_item = [row is not home_row and row.command not in commands_elsewhere for row in rows]
    numbers = [row.index for row in rows]
    if len(set(numbers)) < len(rows):
        numbers = [float(n) for n in range(len(rows))]
    item_numbers = itertools.count()
    index_of = {n: next(item_numbers) if item else None for n, item in zip(numbers, is_item, strict=True)}
    return tuple(_item(row, index_of) for row, item in zip(rows, is_item, strict=True) if item)


def _wire_items(rows: list[_Row]) -> list[WireItem]:
    """Rows of a geofence or of rally points as items of the protocol."""
    wire_items: list[WireItem] = []
    for seq, row in enumerate(rows):
        p1, _, _, _, lat, lon, z = row.params
        if lat is None or lon is None or is_here(lat, lon) or abs(lat) > 90.0 or abs(lon) > 180.0:
            raise PlanError(
                f"line {row.line}, columns x and y", "it has no position", "Correct the position."
            )
        if z is None and row.command == MAV_CMD_NAV_RALLY_POINT:
            raise PlanError(f"line {row.line}, column z", "the rally point has no altitude", "Set it.")
        radius, altitude_m = p1 or 0.0, z or 0.0
        x, y = round(lat * 1e7), round(lon * 1e7)
        wire_items.append(WireItem(seq, row.frame, row.command, radius, 0, 0, 0, x, y, altitude_m))
    return wire_items


def _row(line: int, cells: list[str]) -> _Row:
    if len(cells) != 12:
        raise PlanError(f"line {line}", f"it has {len(cells)} columns, not 12", "Export the file again.")
    names = (*_COLUMNS, "autocontinue")
    values = [_value(line, name, cell) for name, cell in zip(names, cells, strict=True)]
    frame, command = int(values[2] or 0), int(values[3] or 0)
    return _Row(line, values[0] or 0.0, frame, command, tuple(values[4:11]), bool(values[11]))


def _value(line: int, column: str, cell: str) -> float | None:
    place = f"line {line}, column {column}"
    if column not in ("index", "current", "frame", "command", "autocontinue") and cell.lower() == "nan":
        return None
    try:
        value = float(cell)
    except ValueError:
        raise PlanError(place, f"{cell[:30]!r} is not a number", "Write a number.") from None
    if not math.isfinite(value) or abs(value) > 1e9:
        raise PlanError(place, f"{cell[:30]!r} is not a possible value", "Correct this value.")
    if column in ("frame", "command") and not value.is_integer():
        raise PlanError(place, f"{cell[:30]!r} is not a whole number", "Write a whole number.")
    return value


def _home(row: _Row) -> HomePosition | None:
    """The home position of a row; None: it is not set."""
    lat, lon, alt_m = row.params[4:7]
    if lat is None or lon is None or alt_m is None or is_here(lat, lon):
        return None
    try:
        return HomePosition(lat_deg=lat, lon_deg=lon, alt_amsl_m=alt_m)
    except ValidationError as error:
        invalid = from_validation(error)
        raise PlanError(f"line {row.line}, {invalid.place}", invalid.reason, invalid.fix) from None


def _item(row: _Row, index_of: dict[float, int | None]) -> SimpleItem:
    """The item of a row; `index_of` has the index of the item of each row, by the row's number (None: the row
    is no item)."""
    try:
        item = item_from_params(row.command, row.frame, row.params, autocontinue=row.autocontinue)
    except PlanError as error:
        raise PlanError(f"line {row.line}, {error.place}", error.reason, error.fix) from None
    yaw = getattr(item, "yaw_ned_deg", None)
    if yaw in (0.0, _NORTH_DEG):
        return item.model_copy(update={"yaw_ned_deg": 0.0 if yaw else None})
    if not isinstance(item, Jump):
        return item
    target = item.target_index
    if target in index_of:
        index = index_of[target]
        if index is None:
            what = "the home position" if target == 0 else "a row that is not an item"
            reason = f"it jumps to {what}"
            raise PlanError(f"line {row.line}, column param1", reason, "Enter an item's index.")
        return item.model_copy(update={"target_index": index})
    # a jump beyond the file stays one: the checks report it
    beyond = target - max(index_of, default=0)
    count_of_items = sum(index is not None for index in index_of.values())
    return item.model_copy(update={"target_index": count_of_items - 1 + max(1, int(beyond))})


def write(plan: Plan) -> Written:
    """The plan's items as a .waypoints file; a complex item is written as its mission items.

    Raises:
        PlanError: The plan has no home position, which is the file's first line.
    """
    if plan.planned_home is None:
        reason = "the first line of a .waypoints file is the home position, and this plan has none"
        raise PlanError("field planned_home", reason, "Set the planned home position.")
    home = plan.planned_home
    lines = [
        HEADER,
        _line(0, _GLOBAL, _WAYPOINT, (0, 0, 0, 0, home.lat_deg, home.lon_deg, home.alt_amsl_m), True),
    ]
    has_resolved = False
    for index, (_, item) in enumerate(plan.simple_items(), start=1):
        params = _params(item)
        has_resolved |= isinstance(item, PlacedItem) and item.altitude.resolved_amsl_m is not None
        command = item.command if isinstance(item, CommandItem) else item.COMMAND
        lines.append(_line(index, frame_of(item, FILE_FRAME), command, params, item.autocontinue))
    notes = loss_notes(plan, "A .waypoints file", home=True)
    if has_resolved:
        notes += ("Terrain altitudes are heights above ground in this file; PX4 refuses them.",)
    return Written(("\n".join(lines) + "\n").encode(), notes)


def _params(item: SimpleItem) -> tuple[float | None, ...]:
    """The seven parameters of an item in a file."""
    params = params_of(item)
    if isinstance(item, Jump):
        return (item.target_index + 1, *params[1:])
    if hasattr(item, "yaw_ned_deg"):
        yaw = params[_YAW]
        yaw = 0.0 if yaw is None else _NORTH_DEG if yaw == 0.0 else yaw
        return (*params[:_YAW], yaw, *params[_YAW + 1 :])
    return params


def _line(index: int, frame: int, command: int, params: tuple[float | None, ...], autocontinue: bool) -> str:
    # Mission Planner reads no other spelling of NaN
    values = ["NaN" if value is None else repr(float(value)) for value in params]
    return "\t".join(
        [str(index), str(int(index == 0)), str(frame), str(command), *values, str(int(autocontinue))]
    )
