"""Writes rows as CSV or Parquet."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from typing import Any

import numpy as np

from gcs_server.logbook.exports.rows import CHUNK_ROWS, Rows, Values, chunks
from gcs_server.logbook.exports.sink import BadExport, Sink

NO_PARQUET = (
    "Parquet needs the package arro3-io on the server; install it with "
    "pip install 'offboard-gcs[parquet]'. CSV needs nothing."
)
_FORMULA = ("=", "+", "-", "@")
"""Begin of a text that a spreadsheet would compute."""


def write_csv(
    sink: Sink, rows: Rows, start_unix_s: float | None, from_s: float | None, to_s: float | None
) -> None:
    """Writes rows as CSV: `t_s` since the log's start, `unix_s` if the start is known, then the values; an
    empty place is no number."""
    names = ["t_s", *([] if start_unix_s is None else ["unix_s"])]
    names += [c.name if c.unit is None else f"{c.name} [{c.unit}]" for c in rows.columns]
    header = io.StringIO()
    csv.writer(header, lineterminator="\n").writerow(
        [f"'{name}" if name.startswith(_FORMULA) else name for name in names]
    )
    sink.write(header.getvalue())
    for times_s, values in chunks(rows, from_s, to_s):
        columns = [np.char.mod("%.6f", times_s).tolist()]
        if start_unix_s is not None:
            columns.append(np.char.mod("%.6f", times_s + start_unix_s).tolist())
        columns += [_texts(each) for each in values]
        sink.write("".join(",".join(row) + "\n" for row in zip(*columns, strict=True)))


def _texts(values: Values) -> list[str]:
    """Values as texts that are read as the same values again."""
    plain = values.tolist()
    if values.dtype.kind == "f":
        text = "%.9g" if values.dtype.itemsize <= 4 else "%r"
        texts = [(text % each).removesuffix(".0") for each in plain]
        return [t if ok else "" for t, ok in zip(texts, np.isfinite(values).tolist(), strict=True)]
    if values.dtype.kind == "b":
        return ["1" if each else "0" for each in plain]
    return [str(each) for each in plain] if values.dtype.kind in "iu" else [""] * len(plain)


def write_parquet(
    sink: Sink, rows: Rows, start_unix_s: float | None, from_s: float | None, to_s: float | None
) -> None:
    """Writes rows as Parquet: `t_s` and the values in their own types, compressed with zstd; units are in the
    metadata, as `unit of {column}`, and `start_unix_s`. Raises BadExport without the package."""
    core, io_module = parquet_modules()
    names = _distinct(["t_s", *(column.name for column in rows.columns)])

    def batch(times_s: Values, values: list[Values]) -> Any:
        arrays = [core.Array.from_numpy(_plain(each)) for each in (times_s, *values)]
        return core.RecordBatch.from_arrays(arrays, names=names)

    schema = batch(*_empty(rows)).schema

    def batches() -> Iterator[Any]:
        for times_s, values in chunks(rows, from_s, to_s):
            yield batch(times_s, values)

    units = {f"unit of {c.name}": c.unit for c in rows.columns if c.unit is not None}
    start = {} if start_unix_s is None else {"start_unix_s": f"{start_unix_s:.6f}"}
    io_module.write_parquet(
        core.RecordBatchReader.from_batches(schema, batches()),
        sink,
        compression="zstd(3)",
        max_row_group_size=5 * CHUNK_ROWS,
        key_value_metadata={**start, **units},
    )


def parquet_modules() -> tuple[Any, Any]:
    """The package's modules. Raises BadExport if it is not installed."""
    try:
        import arro3.core
        import arro3.io
    except ImportError as error:
        raise BadExport("format", NO_PARQUET) from error
    return arro3.core, arro3.io


def _empty(rows: Rows) -> tuple[Values, list[Values]]:
    return np.empty(0), [np.empty(0, column.dtype) for column in rows.columns]


def _plain(values: Values) -> Values:
    """In the computer's byte order, contiguous; a text becomes its bytes."""
    if values.dtype.kind == "S":
        values = values.view(np.uint8)
    return np.ascontiguousarray(values, values.dtype.newbyteorder("="))


def _distinct(names: list[str]) -> list[str]:
    """A field may be called `t_s`, or be chosen twice."""
    found: dict[str, int] = {}
    distinct: list[str] = []
    for name in names:
        found[name] = found.get(name, 0) + 1
        distinct.append(name if found[name] == 1 else f"{name} ({found[name]})")
    return distinct
