"""QGroundControl's `.params` files: one parameter a line, with vehicle, component, name, value and type.
Pure.

    # Vehicle-Id Component-Id Name Value Type
    1	1	MNT_MODE_IN	4	6

Types are MAV_PARAM_TYPE. A line that cannot be read becomes a row with its number and the reason; nothing
raises.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Iterable
from dataclasses import dataclass

from gcs_server.mavlink import dialect as d
from gcs_server.vehicle.param_review import WantedParam
from gcs_server.vehicle.param_table import Param

MAX_LINES = 10_000
MAX_SHOWN = 60
"""Characters of a line, or of a value in the header, that texts show."""
INTEGER_TYPES = frozenset(
    (
        d.MAV_PARAM_TYPE_UINT8, d.MAV_PARAM_TYPE_INT8, d.MAV_PARAM_TYPE_UINT16, d.MAV_PARAM_TYPE_INT16,
        d.MAV_PARAM_TYPE_UINT32, d.MAV_PARAM_TYPE_INT32,
    )
)  # fmt: skip
FLOAT_TYPES = frozenset((d.MAV_PARAM_TYPE_REAL32, d.MAV_PARAM_TYPE_REAL64))
_name = re.compile(r"[A-Za-z0-9_]{1,16}")
_header = re.compile(r"#\s*(Stack|Version|Vehicle)\s*:\s*(.*\S)")
_integer = re.compile(r"[+-]?\d{1,20}")
_number = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,4})?")


@dataclass(frozen=True, slots=True)
class ParamFile:
    """The content of a file."""

    rows: tuple[WantedParam, ...]
    """One for each line with a parameter, also for lines that cannot be read."""
    stack: str | None
    """Autopilot in the header, such as PX4 Pro."""
    version: str | None
    """Version of the firmware in the header."""
    vehicle_ids: tuple[int, ...]
    """MAVLink system ids in the lines."""


def read(text: str, component_id: int) -> ParamFile:
    """Reads a file.

    Args:
        text: the file.
        component_id: the autopilot's component; parameters of others are refused.
    """
    rows: list[WantedParam] = []
    header: dict[str, str] = {}
    vehicle_ids: set[int] = set()
    for number, line in enumerate(text.removeprefix("\ufeff").splitlines(), 1):
        if number > MAX_LINES:
            rows.append(
                WantedParam("", None, line=number, problem=f"The file has more than {MAX_LINES:,} lines.")
            )
            break
        stripped = line.strip()
        if stripped.startswith("#"):
            match = _header.match(stripped)
            if match is not None:
                header.setdefault(match[1], match[2][:MAX_SHOWN])
        elif stripped:
            rows.append(_row(stripped, number, component_id, vehicle_ids))
    return ParamFile(tuple(rows), header.get("Stack"), header.get("Version"), tuple(sorted(vehicle_ids)))


def _row(line: str, number: int, component_id: int, vehicle_ids: set[int]) -> WantedParam:
    fields = line.split("\t") if "\t" in line else line.split()
    fields = [field.strip() for field in fields]

    def refused(problem: str, name: str = "") -> WantedParam:
        return WantedParam(name, None, line=number, problem=problem)

    if len(fields) != 5:
        shown = line if len(line) <= MAX_SHOWN else line[: MAX_SHOWN - 1] + "…"
        return refused(f"Not vehicle, component, name, value and type: {shown!r}.")
    vehicle, component, name, value, kind = fields
    if _name.fullmatch(name) is None:
        return refused(f"{name[:MAX_SHOWN]!r} is not a parameter name.")
    if not all(_integer.fullmatch(field) for field in (vehicle, component, kind)):
        return refused("Vehicle, component and type must be whole numbers.", name)
    if int(component) != component_id:
        return refused(f"It is a parameter of component {int(component)}, not of the autopilot.", name)
    if 0 < int(vehicle) < 256:
        vehicle_ids.add(int(vehicle))
    if int(kind) in INTEGER_TYPES:
        if _integer.fullmatch(value) is None:
            return refused(f"{value[:MAX_SHOWN]!r} is not a whole number, but its type is one.", name)
        return WantedParam(name, int(value), True, number)
    if int(kind) not in FLOAT_TYPES:
        return refused(f"Type {int(kind)} is not supported (6: whole number, 9: number).", name)
    if _number.fullmatch(value) is None or not math.isfinite(float(value)):
        return refused(f"{value[:MAX_SHOWN]!r} is not a number.", name)
    try:
        stored = struct.unpack("<f", struct.pack("<f", float(value)))[0]
    except OverflowError:
        return refused(f"{value[:MAX_SHOWN]!r} does not fit a 32-bit float.", name)
    return WantedParam(name, stored, False, number)


def notes(file: ParamFile, system_id: int, firmware: str | None) -> tuple[str, ...]:
    """What a person should know before the file is applied to this vehicle.

    Args:
        file: the file.
        system_id: the vehicle's MAVLink system id.
        firmware: the vehicle's version; None: not known.
    """
    found: list[str] = []
    if not file.rows:
        found.append("The file has no parameters.")
    if file.stack is not None and "px4" not in file.stack.lower():
        found.append(f"The file is of {file.stack}, not of PX4.")
    if file.version is not None and firmware is not None and not file.version.startswith(firmware):
        found.append(f"The file is of version {file.version}; the vehicle has {firmware}.")
    if file.vehicle_ids and file.vehicle_ids != (system_id,):
        ids = ", ".join(map(str, file.vehicle_ids))
        found.append(f"The file is of vehicle {ids}; this is vehicle {system_id}.")
    return tuple(found)


def write(params: Iterable[Param], system_id: int, component_id: int, firmware: str | None) -> str:
    """The file of a vehicle's parameters. NaN is left out, because no reader takes it."""
    lines = [
        f"# Onboard parameters for Vehicle {system_id}",
        "#",
        "# Stack: PX4 Pro",
        *(() if firmware is None else (f"# Version: {firmware}",)),
        "#",
        "# Vehicle-Id Component-Id Name Value Type",
    ]
    for param in params:
        if not math.isfinite(param.value):
            continue
        kind = d.MAV_PARAM_TYPE_INT32 if param.is_integer else d.MAV_PARAM_TYPE_REAL32
        value = str(int(param.value)) if param.is_integer else float32_text(param.value)
        lines.append(f"{system_id}\t{component_id}\t{param.name}\t{value}\t{kind}")
    return "\n".join(lines) + "\n"


def float32_text(value: float) -> str:
    """The shortest text that a 32-bit float is read from again.

    >>> float32_text(struct.unpack("<f", struct.pack("<f", 0.3))[0])
    '0.3'
    """
    for digits in range(6, 10):
        text = f"{value:.{digits}g}"
        if struct.pack("<f", float(text)) == struct.pack("<f", value):
            return text
    return repr(value)
