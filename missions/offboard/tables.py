"""Reads trajectories from tables of limited size: CSV text or a NumPy array."""

from __future__ import annotations

import csv
import io
import math

import numpy as np

from missions.bounded_json import decode_lines
from missions.curves import PathCurve
from missions.errors import PlanError
from missions.frames import Vector3
from missions.setpoints import Path, PathPoint
from missions.trajectory.points import MAX_COORDINATE_M

COLUMNS = ("t_s", "north_m", "east_m", "down_m", "yaw_ned_rad")
MAX_ROWS = 20_000
MAX_NPY_BYTES = 4 * 1024 * 1024
LONGEST_S = 86_400.0
_MAGIC = b"\x93NUMPY"


def read(data: bytes, offset_ned_m: Vector3, default_yaw_rad: float) -> PathCurve:
    """Reads the path of a table.

    Args:
        data: content of the file.
        offset_ned_m: added to its positions.
        default_yaw_rad: the heading for a table without yaw.

    Raises:
        PlanError: The table cannot be read or flown; the error names the row and the fix.
    """
    rows = _array(data) if data.startswith(_MAGIC) else _csv(data)
    if not 2 <= len(rows) <= MAX_ROWS:
        reason = f"it has {len(rows)} rows, 2 to {MAX_ROWS} are possible"
        raise PlanError("the table", reason, "Change the number of rows.")
    previous_s = -math.inf
    for number, row in enumerate(rows, 1):
        if not all(abs(value) <= MAX_COORDINATE_M for value in row):
            raise PlanError(f"row {number}", "a value is not finite or too large", "Correct this row.")
        if row[0] <= previous_s or row[0] - rows[0][0] > LONGEST_S:
            raise PlanError(
                f"row {number}, column t_s", "times must increase, and cover a day at most", "Sort the rows."
            )
        previous_s = row[0]
    n, e, d = offset_ned_m
    points = tuple(
        PathPoint(row[0] - rows[0][0], (row[1] + n, row[2] + e, row[3] + d), row[4] if len(row) > 4 else None)
        for row in rows
    )
    return PathCurve(Path(points), default_yaw_rad)


def _csv(data: bytes) -> list[list[float]]:
    reader = csv.reader(io.StringIO(decode_lines(data)))
    try:
        header = [name.strip() for name in next(reader, [])]
        lines = [line for line in reader if line]
    except csv.Error as error:
        raise PlanError(
            f"line {reader.line_num}", f"not valid CSV ({error})", "Export the table again."
        ) from None
    if header not in (list(COLUMNS), list(COLUMNS[:4])):
        reason = f"the columns are {', '.join(header)[:100] or 'missing'}"
        raise PlanError("line 1", reason, f"Write {','.join(COLUMNS)} (yaw_ned_rad is optional).")
    rows: list[list[float]] = []
    for number, line in enumerate(lines, 1):
        try:
            row = [float(text) for text in line]
        except ValueError:
            raise PlanError(f"row {number}", "a value is not a number", "Correct this row.") from None
        if len(row) != len(header):
            reason = f"{len(row)} values for {len(header)} columns"
            raise PlanError(f"row {number}", reason, "Give one value for each column.")
        rows.append(row)
    return rows


def _array(data: bytes) -> list[list[float]]:
    if len(data) > MAX_NPY_BYTES:
        raise PlanError("the table", f"{len(data) / 1e6:.0f} MB are too large", "Give fewer rows.")
    file = io.BytesIO(data)
    try:
        if np.lib.format.read_magic(file) != (1, 0):
            raise ValueError("only version 1.0 of the format is supported")
        shape, _, dtype = np.lib.format.read_array_header_1_0(file, max_header_size=1000)
        if math.prod(shape) * dtype.itemsize > len(data):
            raise ValueError("the file is shorter than its header says")
        values = np.load(io.BytesIO(data), allow_pickle=False)
    except (ValueError, OSError, EOFError, OverflowError) as error:
        raise PlanError(
            "the table", f"not a NumPy array ({error!s:.100})", "Save it with numpy.save."
        ) from None
    if values.ndim != 2 or values.shape[1] not in (4, 5) or values.dtype.kind not in "fiu":
        reason = f"shape {values.shape} of {values.dtype}"
        raise PlanError("the table", reason, f"Give numbers (N, 4 or 5): {', '.join(COLUMNS)}.")
    return values.astype(float).tolist()
