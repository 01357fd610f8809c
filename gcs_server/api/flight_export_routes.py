"""Routes of the values of a log: a table, and files for other programs."""

from __future__ import annotations

import contextlib
import re
from collections.abc import AsyncGenerator
from typing import Annotated, Any, Literal

from fastapi import Query, Response
from pydantic import Field
from starlette.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from gcs_server.api import flight_models as m
from gcs_server.api.problems import RESPONSES
from gcs_server.api.routes import Routes
from gcs_server.api.station import StationDep
from gcs_server.logbook.names import suffix_of

router = Routes(prefix="/flights", tags=["flights"], responses=RESPONSES)

MAX_TOPICS, MAX_FIELDS = 200, 32
MAX_TABLE_ROWS = 1000
MEDIA_TYPES = {
    "csv": "text/csv; charset=utf-8",
    "parquet": "application/vnd.apache.parquet",
    "geojson": "application/geo+json",
    "kml": "application/vnd.google-earth.kml+xml",
    "mcap": "application/octet-stream",
}
_NAMELESS = "log"
_UNSAFE = re.compile(r"[^A-Za-z0-9._+-]+")
_FROM = "Begin of the window [s since the log's start]."
_FILE: dict[int | str, dict[str, Any]] = {200: {"content": {each: {} for each in MEDIA_TYPES.values()}}}
_Texts = list[Annotated[str, Field(max_length=600)]]


class Export(StreamingResponse):
    """Sends pieces as the client reads them; a client that goes away ends their process."""

    def __init__(self, pieces: AsyncGenerator[bytes], **arguments: Any) -> None:
        super().__init__(pieces, **arguments)
        self._pieces = pieces

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Sends the response."""
        async with contextlib.aclosing(self._pieces):
            await super().__call__(scope, receive, send)


@router.get("/{f}/table", response_model=m.FlightTable)
async def flight_table(
    f: str,
    station: StationDep,
    topic: Annotated[str, Query(max_length=300, description="Id of a topic, as in the overview.")],
    from_row: Annotated[int, Query(ge=0, le=1 << 40, description="Number of the first row.")] = 0,
    at_s: Annotated[
        float | None,
        Query(ge=-1e7, le=1e7, description="Begins at this time instead [s since the log's start]."),
    ] = None,
    rows: Annotated[int, Query(ge=1, le=MAX_TABLE_ROWS, description="Maximum number of rows.")] = 100,
) -> Response:
    """Values of a topic as they were logged, some rows at a time; of a topic with very many fields fewer rows
    than asked for."""
    body = await station.logbook.table(f, topic, from_row, at_s, rows)
    return Response(body, media_type="application/json")


@router.get("/{f}/export", response_class=StreamingResponse, responses=_FILE)
async def flight_export(
    f: str,
    station: StationDep,
    format: Annotated[
        Literal["csv", "parquet", "geojson", "kml", "mcap"], Query(description="Kind of the file.")
    ],
    topic: Annotated[
        _Texts,
        Query(
            max_length=MAX_TOPICS,
            description="Id of a topic: exactly one for CSV and Parquet, unless there are fields; for MCAP "
            "repeated, or none for all.",
        ),
    ] = [],  # noqa: B006 FastAPI copies it
    field: Annotated[
        _Texts,
        Query(
            max_length=MAX_FIELDS,
            description="Fields or expressions as in `series`, at common times, for CSV and Parquet.",
        ),
    ] = [],  # noqa: B006
    rate_hz: Annotated[
        float | None,
        Query(
            gt=0,
            le=10_000,
            description="Rows a second of fields; without it, a row at each sample of the first field.",
        ),
    ] = None,
    from_s: Annotated[float | None, Query(ge=-1e7, le=1e7, description=_FROM)] = None,
    to_s: Annotated[float | None, Query(ge=-1e7, le=1e7, description="End of the window.")] = None,
) -> Response:
    """A log, or a part of it, for other programs, written while it is sent.

    `csv` and `parquet`: the rows of one topic, or fields of any topics at common times, each with its newest
    value, so that none is invented. `geojson` and `kml`: the flown path of each vehicle, with its times and
    altitudes above mean sea level (AMSL). `mcap`: all topics as JSON with their schemas, track, pose and
    messages as Foxglove draws them. A file that could not be completed ends without the end of its
    transfer."""
    request = {
        "format": format,
        "topics": topic,
        "fields": field,
        "rate_hz": rate_hz,
        "from_s": from_s,
        "to_s": to_s,
    }
    pieces = await station.logbook.export(f, request)
    try:
        await anext(pieces)
    except BaseException:
        await pieces.aclose()
        raise
    name = (await station.logbook.get(f)).path.name
    headers = {"content-disposition": f'attachment; filename="{_file_name(name, topic, format)}"'}
    return Export(pieces, media_type=MEDIA_TYPES[format], headers=headers)


def _file_name(log: str, topics: list[str], suffix: str) -> str:
    """A name of plain letters, from that of the log and of its only topic."""
    stem = log[: -len(suffix_of(log) or "")] if suffix_of(log) else log
    parts = [stem, *(topics if len(topics) == 1 else [])]
    clean = "-".join(_UNSAFE.sub("_", part).strip("._") for part in parts)[:150]
    return f"{clean or _NAMELESS}.{suffix}"
