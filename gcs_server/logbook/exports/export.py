"""What a request for an export chooses, checked before anything is written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Literal

from gcs_server.logbook import columns
from gcs_server.logbook.exports import mcap_file, table_files, tracks
from gcs_server.logbook.exports.rows import FieldRows, Rows, TopicRows
from gcs_server.logbook.exports.sink import BadExport, Send, Sink
from gcs_server.logbook.log import Log

Format = Literal["csv", "parquet", "geojson", "kml", "mcap"]
_MAX_UNIX_S = 4e9
"""A later start, in 2096, is damaged [s since 1970]."""


@dataclass(frozen=True, slots=True)
class Request:
    """What is written."""

    format: Format
    topics: list[str] = field(default_factory=list[str])
    """Ids of topics; tables have exactly one, unless they have fields."""
    fields: list[str] = field(default_factory=list[str])
    """Fields and expressions of a table with common times."""
    rate_hz: float | None = None
    """Rows a second of such a table; None: a row at each sample of the first field."""
    from_s: float | None = None
    """Begin of the window [s since the log's start]; None: the log's."""
    to_s: float | None = None
    """End of the window."""


def prepared(folder: Path, name: str, request: Request) -> Callable[[Send], None]:
    """A function that writes the export of the log in a folder, and sends it in pieces.

    Raises:
        BadExport: the log has not what is asked for, or the request is no possible one.
        UnknownField: the log has no such field, or an expression is invalid.
        OSError: the folder was removed.
    """
    log = columns.load(folder)
    if log.start_unix_s is not None and not 0 < log.start_unix_s < _MAX_UNIX_S:
        log.start_unix_s = None
    write = _writer(folder, name, log, request)

    def send_all(send: Send) -> None:
        sink = Sink(send)
        write(sink)
        sink.flush()

    return send_all


def _writer(folder: Path, name: str, log: Log, request: Request) -> Callable[[Sink], None]:
    window = {"from_s": request.from_s, "to_s": request.to_s}
    if request.format == "mcap":
        mcap_file.require_topics(log, request.topics)
        return partial(mcap_file.write_mcap, log=log, topics=request.topics, **window)
    if request.format in ("geojson", "kml"):
        found = tracks.tracks(log, **window)
        if not found:
            raise BadExport("format", "The log has no positions in this time, so it has no track.")
        if request.format == "geojson":
            return partial(tracks.write_geojson, log=log, found=found)
        return partial(tracks.write_kml, log=log, name=name, found=found)
    rows = _rows(columns.Columns(folder), request)
    if request.format == "parquet":
        table_files.parquet_modules()
        return partial(table_files.write_parquet, rows=rows, start_unix_s=log.start_unix_s, **window)
    return partial(table_files.write_csv, rows=rows, start_unix_s=log.start_unix_s, **window)


def _rows(log: columns.Columns, request: Request) -> Rows:
    if request.fields:
        if request.topics:
            raise BadExport("topic", "A table has either one topic or fields, not both.")
        return FieldRows(log, request.fields, request.rate_hz)
    if len(request.topics) != 1:
        raise BadExport("topic", "A table has exactly one topic, or fields.")
    return TopicRows(log, request.topics[0])
