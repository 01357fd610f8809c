"""Plans as a CSV table: one item per row, columns named after the item's fields.

`kind` is optional (default: waypoint). `altitude_m` and `altitude_reference` are the altitude. An empty cell
means the default of the field; "none" means no value. The separator is a comma, semicolon or tab. The
first row names the columns.
"""

from __future__ import annotations

import csv
import io
import json
from typing import Any

from pydantic import TypeAdapter, ValidationError

from missions.bounded_json import decode_lines
from missions.errors import PlanError, field_path
from missions.formats.results import Imported, ImportOptions, Written, loss_notes
from missions.items import CommandItem
from missions.plan import MAX_ITEMS, TYPED_ITEMS, Plan, SimpleItem

_ITEM: TypeAdapter[SimpleItem] = TypeAdapter(SimpleItem)
_ALTITUDE = {
    "altitude_m": "value_m",
    "altitude_reference": "reference",
    "altitude_resolved_amsl_m": "resolved_amsl_m",
}
_FIRST_COLUMNS = ("kind", "lat_deg", "lon_deg", *_ALTITUDE)
_FIELDS = frozenset(
    {name for cls in (*TYPED_ITEMS, CommandItem) for name in cls.model_fields} - {"original", "altitude"}
) | set(_ALTITUDE)
_TEXT_COLUMNS = frozenset({"kind", "altitude_reference"})


def read(data: bytes | str, options: ImportOptions | None = None) -> Imported:
    """The items of a table.

    Raises:
        PlanError: The table is too large, or a value is wrong; the error names line and column.
    """
    text = decode_lines(data)
    csv.field_size_limit(10_000)
    separator = max(",;\t", key=text.partition("\n")[0].count)
    items: list[SimpleItem] = []
    rows = csv.reader(io.StringIO(text), delimiter=separator, strict=True)
    names: list[str] | None = None
    try:
        for cells in rows:
            if not any(cell.strip() for cell in cells):
                continue
            if names is None:
                names = _checked_names([cell.strip().lower() for cell in cells])
                continue
            if len(items) >= MAX_ITEMS:
                raise PlanError(
                    "the file", f"more than {MAX_ITEMS} items", "Split the plan into smaller ones."
                )
            items.append(_item(rows.line_num, names, cells, options or ImportOptions()))
    except csv.Error as error:
        raise PlanError(
            f"line {rows.line_num}", f"not valid CSV ({error})", "Export the table again."
        ) from None
    if names is None:
        raise PlanError("the file", "it has no rows", "The first row names the columns: lat_deg, lon_deg.")
    return Imported(Plan(items=tuple(items)))


def _checked_names(names: list[str]) -> list[str]:
    for name in names:
        if name not in _FIELDS:
            fix = "Name it as a field of a mission item: lat_deg, lon_deg, altitude_m, altitude_reference."
            raise PlanError(f"line 1, column {name[:40]!r}", "no item has such a field", fix)
        if names.count(name) > 1:
            raise PlanError(f"line 1, column {name!r}", "it appears twice", "Remove one of them.")
    return names


def _item(line: int, names: list[str], cells: list[str], options: ImportOptions) -> SimpleItem:
    if len(cells) > len(names):
        raise PlanError(
            f"line {line}", f"{len(cells)} cells, but {len(names)} columns", "Remove the extra cells."
        )
    fields: dict[str, Any] = {"kind": "waypoint"}
    altitude: dict[str, Any] = {}
    for name, cell in zip(names, cells, strict=False):
        if not cell.strip():
            continue
        value = _value(line, name, cell.strip())
        if name in _ALTITUDE:
            altitude[_ALTITUDE[name]] = value
        else:
            fields[name] = value
    if altitude:
        fields["altitude"] = altitude
    elif "lat_deg" in fields:
        if options.altitude is None:
            fix = "Add altitude_m and altitude_reference, or give an altitude for the import."
            place = f"line {line}, column altitude_m"
            raise PlanError(place, "the point has no altitude", fix, field="altitude_m")
        fields["altitude"] = options.altitude.model_dump()
    try:
        return _ITEM.validate_json(json.dumps(fields))
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        parts = list(first["loc"])[1:]
        column = field_path(parts).replace("altitude.value_m", "altitude_m").replace("altitude.", "altitude_")
        reason = str(first["msg"])[:300]
        raise PlanError(f"line {line}, column {column or 'kind'}", reason, "Correct this value.") from None


def _value(line: int, name: str, cell: str) -> Any:
    if name in _TEXT_COLUMNS:
        return cell.lower()
    if cell.lower() in ("none", "true", "false"):
        return {"none": None, "true": True, "false": False}[cell.lower()]
    try:
        if name in ("params", "spare_params"):
            return json.loads(cell, parse_constant=_refuse_constant)
        return int(cell) if cell.lstrip("-").isdigit() and len(cell) < 20 else _number(cell)
    except (ValueError, RecursionError):
        place = f"line {line}, column {name}"
        raise PlanError(place, f"{cell[:30]!r} is not a finite number", "Write a number.") from None


def _number(cell: str) -> float:
    value = float(cell)
    if not abs(value) <= 1e9:
        raise ValueError(cell)
    return value


def _refuse_constant(text: str) -> float:
    raise ValueError(text)


def write(plan: Plan) -> Written:
    """The plan's items as a table with the columns in use; a complex item is written as its mission items."""
    rows: list[dict[str, str]] = []
    for _, item in plan.simple_items():
        fields = item.model_dump(mode="json", exclude={"original"})
        defaults = {
            name: info.default for name, info in type(item).model_fields.items() if not info.is_required()
        }
        kept = {name: value for name, value in fields.items() if name == "kind" or name not in defaults
                or value != _as_json_value(defaults[name])}  # fmt: skip
        altitude = kept.pop("altitude", {})
        for column, name in _ALTITUDE.items():
            if altitude.get(name) is not None:
                kept[column] = altitude[name]
        rows.append({name: _cell(value) for name, value in kept.items()})
    used = {name for row in rows for name in row}
    columns = [name for name in _FIRST_COLUMNS if name in used or name not in _ALTITUDE]
    columns += sorted(used - set(columns))
    out = io.StringIO()
    table = csv.DictWriter(out, columns, restval="", lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    return Written(out.getvalue().encode(), loss_notes(plan, "A table"))


def _as_json_value(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _cell(value: Any) -> str:
    if value is None:
        return "none"
    if isinstance(value, list):
        return json.dumps(value)
    return str(value).lower() if isinstance(value, bool) else str(value)
