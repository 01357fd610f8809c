"""The .waypoints text format "QGC WPL 110" of MAVProxy, Mission Planner and older QGroundControl.

One item per line: index, current, frame, command, four parameters, x, y, z, autocontinue. The first line is
the home position; the target of a jump is the index of an item. https://mavlink.io/en/file_formats/
"""

from __future__ import annotations

import math

from pydantic import ValidationError

from missions.bounded_json import decode_lines
from missions.errors import PlanError, from_validation
from missions.formats.mavlink_items import FILE_FRAME, frame_of, item_from_params, params_of
from missions.formats.results import Imported, Written, loss_notes
from missions.items import CommandItem, Jump, PlacedItem
from missions.plan import MAX_ITEMS, Plan, SimpleItem
from missions.values import HomePosition

HEADER = "QGC WPL 110"
_COLUMNS = ("index", "current", "frame", "command", "param1", "param2", "param3", "param4", "x", "y", "z")
_WAYPOINT, _GLOBAL = 16, 0


def read(data: bytes | str) -> Imported:
    """The plan of a .waypoints file.

    Programs write home as the first line: a waypoint without parameters at an altitude above mean sea level.
    Any other first line is the first item.

    Raises:
        PlanError: The file is too large or not a .waypoints file, or a value is wrong; the error names the
            line and the column.
    """
    lines = decode_lines(data).splitlines()
    if not lines or lines[0].strip() != HEADER:
        raise PlanError("line 1", f'it is not "{HEADER}"', "Choose a .waypoints file.")
    rows = [(n, line.split()) for n, line in enumerate(lines[1:], start=2) if line.strip()]
    if len(rows) > MAX_ITEMS + 1:
        raise PlanError("the file", f"{len(rows)} items, the maximum is {MAX_ITEMS}", "Split the plan.")
    values = [_row(n, cells) for n, cells in rows]
    home: HomePosition | None = None
    if values and _is_home(values[0]):
        home = _home(values.pop(0), rows.pop(0)[0])
    first_item = 0 if home is None else 1
    items = tuple(_item(n, row, first_item) for (n, _), row in zip(rows, values, strict=True))
    notes = () if home else ("The file has no home position; its first line is the first item.",)
    return Imported(Plan(items=items, planned_home=home), notes=notes)


def _row(line: int, cells: list[str]) -> list[float | None]:
    if len(cells) != 12:
        raise PlanError(f"line {line}", f"it has {len(cells)} columns, not 12", "Export the file again.")
    return [_value(line, name, cell) for name, cell in zip((*_COLUMNS, "autocontinue"), cells, strict=True)]


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


def _is_home(row: list[float | None]) -> bool:
    return row[2:8] == [_GLOBAL, _WAYPOINT, 0, 0, 0, 0]


def _home(row: list[float | None], line: int) -> HomePosition:
    try:
        return HomePosition(lat_deg=row[8], lon_deg=row[9], alt_amsl_m=row[10])  # type: ignore[arg-type]
    except ValidationError as error:
        invalid = from_validation(error)
        raise PlanError(f"line {line}, {invalid.place}", invalid.reason, invalid.fix) from None


def _item(line: int, row: list[float | None], first_item: int) -> SimpleItem:
    frame, command = int(row[2] or 0), int(row[3] or 0)
    try:
        item = item_from_params(command, frame, tuple(row[4:11]), autocontinue=bool(row[11]))
    except PlanError as error:
        raise PlanError(f"line {line}, {error.place}", error.reason, error.fix) from None
    if not isinstance(item, Jump):
        return item
    if item.target_index < first_item:
        raise PlanError(
            f"line {line}, column param1", "it jumps to the home position", "Enter an item's index."
        )
    return item.model_copy(update={"target_index": item.target_index - first_item})


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
        params = params_of(item)
        if isinstance(item, Jump):
            params = (item.target_index + 1, *params[1:])
        has_resolved |= isinstance(item, PlacedItem) and item.altitude.resolved_amsl_m is not None
        command = item.command if isinstance(item, CommandItem) else item.COMMAND
        lines.append(_line(index, frame_of(item, FILE_FRAME), command, params, item.autocontinue))
    notes = loss_notes(plan, "A .waypoints file", home=True)
    if has_resolved:
        notes += ("Terrain altitudes are heights above ground in this file; PX4 refuses them.",)
    return Written(("\n".join(lines) + "\n").encode(), notes)


def _line(index: int, frame: int, command: int, params: tuple[float | None, ...], autocontinue: bool) -> str:
    values = ["nan" if value is None else repr(float(value)) for value in params]
    return "\t".join(
        [str(index), str(int(index == 0)), str(frame), str(command), *values, str(int(autocontinue))]
    )
