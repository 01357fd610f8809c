"""A log's values as rows: those of one topic as they were logged, or fields of any topics at common times."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_server.logbook.columns import Columns, UnknownField
from gcs_server.logbook.exports.sink import BadExport
from gcs_server.logbook.expressions import is_expression, used_fields
from gcs_server.logbook.log import Times
from gcs_server.logbook.series import split, values_of

CHUNK_ROWS = 10_000
MAX_ROWS = 50_000_000
"""Maximum number of rows of fields at a chosen rate."""
MAX_PAGE_VALUES = 100_000
"""Maximum number of values of a page."""
MARGIN_S = 1.0
"""Expressions are computed from this long before the first row of a chunk on, so that a derivative there is
that of the whole log [s]."""

Values = NDArray[Any]


@dataclass(frozen=True, slots=True)
class Column:
    """One column of a table."""

    name: str
    unit: str | None
    dtype: np.dtype[Any]


class TopicRows:
    """All samples of a topic. Raises BadExport if the log has no such topic."""

    def __init__(self, log: Columns, topic: str) -> None:
        try:
            self._times = log.times(topic)
        except UnknownField as error:
            raise BadExport("topic", f"The log has no topic {topic[:120]!r}.") from error
        named = {name: log.column(topic, name) for name in log.fields(topic)}
        self._values = [values for values, _ in named.values()]
        self.columns = [Column(name, unit, values.dtype) for name, (values, unit) in named.items()]

    def __len__(self) -> int:
        return len(self._times)

    def index_at(self, t_s: float) -> int:
        """The first row at or after a time."""
        return int(np.searchsorted(self._times, t_s, "left"))

    def slice(self, first: int, end: int) -> tuple[Times, list[Values]]:
        """Times and values of some rows."""
        return np.asarray(self._times[first:end]), [np.asarray(each[first:end]) for each in self._values]


class FieldRows:
    """Fields and expressions at common times: at each time the newest value of each, so that no value is
    invented; NaN before its first.

    Args:
        log: the log.
        fields: the fields and expressions.
        rate_hz: rows a second from the first sample of any of the fields to the last; None: a row at each
            sample of the first field.

    Raises:
        UnknownField: the log has no such field, or an expression is invalid.
        BadExport: too many rows.
    """

    def __init__(self, log: Columns, fields: list[str], rate_hz: float | None) -> None:
        self._log, self._fields = log, fields
        self._times = self._common_times(rate_hz)
        probe = float(self._times[0])
        units = [values_of(log, field, probe, probe)[2] for field in fields]
        self.columns = [
            Column(name, unit, self._type(name)) for name, unit in zip(fields, units, strict=True)
        ]

    def __len__(self) -> int:
        return len(self._times)

    def index_at(self, t_s: float) -> int:
        """The first row at or after a time."""
        return int(np.searchsorted(self._times, t_s, "left"))

    def slice(self, first: int, end: int) -> tuple[Times, list[Values]]:
        """Times and values of some rows."""
        times_s = np.asarray(self._times[first:end])
        return times_s, [self._held(column, times_s) for column in self.columns] if len(times_s) else []

    def _type(self, field: str) -> np.dtype[Any]:
        """Single precision stays; whole numbers need a place for "no value yet"."""
        single = not is_expression(field) and self._log.column(*split(field))[0].dtype == np.float32
        return np.dtype(np.float32 if single else np.float64)

    def _held(self, column: Column, times_s: Times) -> Values:
        at_s, values, _ = values_of(self._log, column.name, float(times_s[0]) - MARGIN_S, float(times_s[-1]))
        index = np.searchsorted(at_s, times_s, "right") - 1
        held = values[np.clip(index, 0, None)].astype(column.dtype)
        held[index < 0] = np.nan
        return held

    def _common_times(self, rate_hz: float | None) -> Times:
        topics = [
            split(name)[0]
            for field in self._fields
            for name in (used_fields(field) if is_expression(field) else [field])
        ]
        if not topics:
            raise BadExport("field", "The expressions have no field of the log.")
        times = [self._log.times(topic) for topic in topics]
        if rate_hz is None:
            return times[0]
        begin_s, end_s = min(float(t[0]) for t in times), max(float(t[-1]) for t in times)
        count = int((end_s - begin_s) * rate_hz) + 1
        if count > MAX_ROWS:
            raise BadExport("rate_hz", f"{count:,} rows are too many; at most {MAX_ROWS:,} are written.")
        return begin_s + np.arange(count) / rate_hz


Rows = TopicRows | FieldRows


def chunks(rows: Rows, from_s: float | None, to_s: float | None) -> Iterator[tuple[Times, list[Values]]]:
    """The rows in a window of time, some thousand at once."""
    first = 0 if from_s is None else rows.index_at(from_s)
    end = len(rows) if to_s is None else rows.index_at(np.nextafter(to_s, np.inf))
    for begin in range(first, end, CHUNK_ROWS):
        yield rows.slice(begin, min(begin + CHUNK_ROWS, end))


def page(log: Columns, topic: str, from_row: int | None, at_s: float | None, count: int) -> dict[str, Any]:
    """Some rows of a topic as plain values; what is no number is None. Raises BadExport."""
    rows = TopicRows(log, topic)
    count = max(1, min(count, MAX_PAGE_VALUES // max(1, len(rows.columns))))
    last = max(0, len(rows) - 1)
    first = min(last, rows.index_at(at_s)) if at_s is not None else min(last, from_row or 0)
    times_s, values = rows.slice(first, first + count)
    shown = [_plain(each) for each in values]
    return {
        "topic": topic,
        "samples": len(rows),
        "from_row": first,
        "columns": [{"name": c.name, "unit": c.unit, "type": c.dtype.name} for c in rows.columns],
        "t_s": np.round(times_s, 6).tolist(),
        "rows": [list(row) for row in zip(*shown, strict=True)] if shown else [],
    }


def _plain(values: Values) -> list[Any]:
    if values.dtype.kind != "f":
        return [each.decode("latin-1") if isinstance(each, bytes) else each for each in values.tolist()]
    finite = np.isfinite(values).tolist()
    if values.dtype == np.float32:
        values = np.array([f"{each:.9g}" for each in values.tolist()], np.float64)
    return [each if ok else None for each, ok in zip(values.tolist(), finite, strict=True)]
