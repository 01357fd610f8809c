"""Values for a plot: fields and expressions in a window of time, reduced to a number of points whose extremes
are those of all samples."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_server.logbook.columns import Columns, UnknownField
from gcs_server.logbook.expressions import evaluate, is_expression
from gcs_server.logbook.log import Times

Values = NDArray[np.float64]


def thinned(values: Values, points: int) -> NDArray[np.int64]:
    """Indices of at most `points` values, ascending: the first and the last, and of each run of equal length
    the lowest and the highest."""
    count = len(values)
    if count <= points:
        return np.arange(count)
    length = -(-count // max(1, points // 2 - 1))
    whole = count - count % length
    rows = [values[:whole].reshape(-1, length), values[whole:].reshape(1, -1)]
    firsts = [np.arange(0, whole, length), np.array([whole])]
    found = [
        first + index for row, first in zip(rows, firsts, strict=True) if row.size for index in _extremes(row)
    ]
    return np.unique(np.concatenate(([0, count - 1], *found)))


def _extremes(rows: Values) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Index of the lowest and of the highest value of each row, (R, n). Only rows with a value that is not a
    number are copied."""
    lowest, highest = np.argmin(rows, axis=1), np.argmax(rows, axis=1)
    (damaged,) = np.nonzero(np.isnan(rows[np.arange(len(rows)), lowest]))
    if len(damaged):
        some = rows[damaged]
        missing = np.isnan(some)
        lowest[damaged] = np.argmin(np.where(missing, np.inf, some), axis=1)
        highest[damaged] = np.argmax(np.where(missing, -np.inf, some), axis=1)
    return lowest, highest


def window(times_s: Times, from_s: float | None, to_s: float | None) -> slice:
    """The samples in a window, with one before and one after it, so that lines reach its edges."""
    first = 0 if from_s is None else max(0, int(np.searchsorted(times_s, from_s, "left")) - 1)
    end = len(times_s) if to_s is None else int(np.searchsorted(times_s, to_s, "right")) + 1
    return slice(first, min(end, len(times_s)))


def split(field: str) -> tuple[str, str]:
    """Topic and field of `vehicle_attitude:0/q[0]`. Raises UnknownField."""
    topic, separator, name = field.partition("/")
    if not separator:
        raise UnknownField(f"{field!r} is not of the form topic:instance/field")
    return topic, name


def series(
    columns: Columns, fields: list[str], from_s: float | None, to_s: float | None, points: int
) -> list[dict[str, Any]]:
    """The values of each field or expression.

    Raises:
        UnknownField: the log has no such topic or field, or an expression is invalid.
    """
    return [_one(columns, field, from_s, to_s, points) for field in fields]


def _one(
    columns: Columns, field: str, from_s: float | None, to_s: float | None, points: int
) -> dict[str, Any]:
    times_s, values, unit = values_of(columns, field, from_s, to_s)
    kept = thinned(values, points)
    shown = values[kept]
    finite = np.isfinite(shown)
    return {
        "field": field,
        "unit": unit,
        "samples": len(values),
        "t_s": np.round(times_s[kept], 6).tolist(),
        "values": [value if ok else None for value, ok in zip(shown.tolist(), finite.tolist(), strict=True)],
    }


def values_of(
    columns: Columns, field: str, from_s: float | None, to_s: float | None
) -> tuple[Times, Values, str | None]:
    """Times, values and unit of a field or expression in a window (`window`). Raises UnknownField."""
    if is_expression(field):
        return evaluate(field, lambda name: _values(columns, name, from_s, to_s))
    return _values(columns, field, from_s, to_s)


def _values(
    columns: Columns, field: str, from_s: float | None, to_s: float | None
) -> tuple[Times, Values, str | None]:
    topic, name = split(field)
    values, unit = columns.column(topic, name)
    times_s = columns.times(topic)
    part = window(times_s, from_s, to_s)
    return np.asarray(times_s[part]), np.asarray(values[part]).astype(np.float64), unit
