"""Reads trajectories from tables of limited size: CSV text or a NumPy array.

A document stores tables as CSV text, so `import_file` converts a NumPy array to CSV.
"""

from __future__ import annotations

import csv
import io
import math
import tokenize
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.bounded_json import decode_lines
from missions.curves import PathCurve
from missions.errors import PlanError
from missions.frames import Vector3
from missions.offboard.document import MAX_TABLE_LENGTH
from missions.offboard.names import MAX_NAME_LENGTH, valid_name
from missions.setpoints import Path, PathPoint
from missions.trajectory.points import MAX_COORDINATE_M

COLUMNS = ("t_s", "north_m", "east_m", "down_m", "yaw_ned_rad")
MAX_ROWS = 20_000
MAX_NPY_BYTES = 4 * 1024 * 1024
MAX_DURATION_S = 86_400.0
_NPY_MAGIC = b"\x93NUMPY"
_ZIP_MAGIC = b"PK"
_HEADER_ERRORS = (
    ValueError, TypeError, KeyError, OSError, EOFError, OverflowError, SyntaxError, MemoryError,
    RecursionError, tokenize.TokenError,
)  # fmt: skip
"""Exceptions that NumPy raises for an invalid header, because it evaluates the header as a Python literal."""


@dataclass(frozen=True, slots=True)
class ImportedTable:
    """A trajectory from a file, in the form that a document stores."""

    name: str
    """Name for the document's `tables`: the name of the file, with `.csv`."""
    text: str
    """CSV text for the document's `tables`."""
    rows: int
    """Number of rows."""
    duration_s: float
    """Time from the first row to the last [s]."""
    has_yaw: bool
    """Whether the trajectory has the column `yaw_ned_rad`."""


def import_file(data: bytes, filename: str) -> ImportedTable:
    """Reads and checks a file. CSV text is kept as it is; the numbers of an array are not rounded.

    Args:
        data: content of the file.
        filename: name of the file, from which the name of the table is made.

    Raises:
        PlanError: The file cannot be read or flown; the error names the row and the fix.
    """
    is_array = data.startswith(_NPY_MAGIC)
    if not is_array and filename.lower().endswith((".npy", ".npz")):
        reason = "it is an archive of arrays" if data.startswith(_ZIP_MAGIC) else "it is not a NumPy array"
        raise PlanError("the table", reason, "Save one array with numpy.save.")
    rows = read_rows(data)
    text = csv_text(rows) if is_array else decode_lines(data)
    if len(text) > MAX_TABLE_LENGTH:
        reason = f"as CSV it has {len(text)} characters; the maximum is {MAX_TABLE_LENGTH}"
        fix = "Give fewer rows, or round the values: numpy.round(array, 4)."
        raise PlanError("the table", reason, fix)
    return ImportedTable(_name_of(filename), text, len(rows), rows[-1][0] - rows[0][0], len(rows[0]) > 4)


def _name_of(filename: str) -> str:
    has_ending = filename.lower().endswith((".npy", ".csv"))
    stem = valid_name(filename[:-4] if has_ending else filename, "path")
    return f"{stem[: MAX_NAME_LENGTH - 4]}.csv"


def csv_text(rows: Sequence[Sequence[float]]) -> str:
    """Rows as CSV text, from which `read_rows` reads the same values."""
    lines = [",".join(COLUMNS[: len(rows[0])]), *(",".join(map(_number, row)) for row in rows)]
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    return repr(int(value)) if value.is_integer() else repr(value)


def read(data: bytes, offset_ned_m: Vector3, default_yaw_rad: float) -> PathCurve:
    """Reads the path of a table.

    Args:
        data: content of the file.
        offset_ned_m: added to the positions of the table.
        default_yaw_rad: the heading for a table without yaw.

    Raises:
        PlanError: The table cannot be read or flown; the error names the row and the fix.
    """
    rows = read_rows(data)
    n, e, d = offset_ned_m
    points = tuple(
        PathPoint(row[0] - rows[0][0], (row[1] + n, row[2] + e, row[3] + d), row[4] if len(row) > 4 else None)
        for row in rows
    )
    return PathCurve.of(Path(points), default_yaw_rad)


def read_rows(data: bytes) -> list[list[float]]:
    """The checked rows of a table: time, north, east, down, and the heading if the table has one.

    Raises:
        PlanError: The table cannot be read or flown; the error names the row and the fix.
    """
    rows = _read_array(data) if data.startswith(_NPY_MAGIC) else _read_csv(data)
    if not 2 <= len(rows) <= MAX_ROWS:
        reason = f"it has {len(rows)} rows; it must have 2 to {MAX_ROWS}"
        raise PlanError("the table", reason, "Change the number of rows.")
    previous_s = -math.inf
    for number, row in enumerate(rows, 1):
        if not all(abs(value) <= MAX_COORDINATE_M for value in row):
            raise PlanError(f"row {number}", "a value is not finite or too large", "Correct this row.")
        if row[0] <= previous_s or row[0] - rows[0][0] > MAX_DURATION_S:
            raise PlanError(
                f"row {number}, column t_s", "times must increase, and cover a day at most", "Sort the rows."
            )
        previous_s = row[0]
    return rows


def _read_csv(data: bytes) -> list[list[float]]:
    if (line_count := max(data.count(b"\n"), data.count(b"\r"))) > MAX_ROWS + 1:
        reason = f"it has {line_count} lines; the maximum is {MAX_ROWS} rows"
        raise PlanError("the table", reason, "Give fewer rows.")
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


def _read_array(data: bytes) -> list[list[float]]:
    if len(data) > MAX_NPY_BYTES:
        raise PlanError("the table", f"{len(data) / 1e6:.0f} MB are too large", "Give fewer rows.")
    shape, is_fortran, dtype, values_begin = _read_array_header(data)
    if dtype.kind not in "fiu":
        reason = f"its values are of type {dtype!s:.60}, not numbers"
        raise PlanError("the table", reason, "Save it as numbers: numpy.save(file, array.astype(float)).")
    if len(shape) != 2 or shape[1] not in (4, 5):
        reason = f"its shape is {shape!s:.60}"
        is_transposed = len(shape) == 2 and shape[0] in (4, 5)
        transpose_hint = " Rows and columns may be swapped: save array.T." if is_transposed else ""
        fix = f"Save shape (N, 4) or (N, 5): {', '.join(COLUMNS)}.{transpose_hint}"
        raise PlanError("the table", reason, fix)
    size_bytes = shape[0] * shape[1] * dtype.itemsize
    if not 0 <= size_bytes <= len(data) - values_begin:
        reason = f"its header states {shape[0]} rows, but the file ends before them"
        raise PlanError("the table", reason, "Copy the file again, or save it again with numpy.save.")
    values: NDArray[np.generic] = np.frombuffer(data[values_begin : values_begin + size_bytes], dtype)
    if dtype.kind == "f" and dtype.itemsize < 8:
        values = values.astype(str)  # a float32 of 0.1 becomes 0.1, not 0.10000000149
    with np.errstate(over="ignore"):  # `read_rows` refuses infinity
        numbers = values.astype(float)
    return numbers.reshape(shape, order="F" if is_fortran else "C").tolist()


def _read_array_header(data: bytes) -> tuple[tuple[int, ...], bool, np.dtype[np.generic], int]:
    """Shape, order and type of an array in a file, and where its values begin; no value is read."""
    file = io.BytesIO(data)
    try:
        if np.lib.format.read_magic(file) != (1, 0):
            raise ValueError("only version 1.0 of the format is supported")
        shape, is_fortran, dtype = np.lib.format.read_array_header_1_0(file, max_header_size=1000)
    except _HEADER_ERRORS as error:
        reason = f"not a NumPy array ({error!s:.100})"
        raise PlanError("the table", reason, "Save it with numpy.save.") from None
    return shape, is_fortran, dtype, file.tell()
