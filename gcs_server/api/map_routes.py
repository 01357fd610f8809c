"""Routes of the operator's offline maps: the list and the tiles."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path as File
from typing import Annotated, TypeVar
from urllib.parse import quote

from fastapi import Header, Path, Response
from fastapi.responses import FileResponse

from gcs_server.api import responses
from gcs_server.api.problems import RESPONSES, Problem, problem
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import Station, StationDep
from gcs_server.maps.sources import MapSource
from gcs_server.maps.tiles import MapSourceFailed
from gcs_server.storage.maps import MapError, MapInfo, is_map_name, read_map, read_tile

router = Routes(prefix="/maps", tags=["station"])

MAX_ZOOM = 24
REVALIDATE = {"Cache-Control": "no-cache"}
"""Cache header: the browser may cache a tile, but must revalidate it."""
RANGE = re.compile(r"bytes=(?P<first>[0-9]{0,15})-(?P<last>[0-9]{0,15})")
ARCHIVE_TIMEOUT_S = 4.0
"""Maximum wait for a source's archive, because the page shows no map before [s]."""
GZIP_MAGIC = b"\x1f\x8b"
T = TypeVar("T")
_threads = ThreadPoolExecutor(2, thread_name_prefix="maps")


@router.get("", response_model=responses.Maps)
async def list_maps(station: StationDep) -> Response:
    """The chosen map source, the map files in the data folder, and the files that cannot be read."""
    maps, unreadable = await _in_thread(_scan_folder, station)
    source = station.map_sources.chosen
    if source is not None:
        try:
            maps.insert(0, await _source_view(station, source))
        except MapSourceFailed as error:
            unreadable.append(error.message)
    return json_response({"folder": str(station.maps), "maps": maps, "unreadable": unreadable})


@router.get(
    "/{name}",
    response_class=FileResponse,
    responses={
        **RESPONSES,
        200: {"content": {"application/octet-stream": {}}},
        206: {"description": "A part of the file.", "content": {"application/octet-stream": {}}},
        416: {"model": Problem, "description": "The Range header lies outside the file."},
    },
)
async def map_file(
    name: str, station: StationDep, range_header: Annotated[str | None, Header(alias="Range")] = None
) -> Response:
    """A PMTiles file, or the part requested by a Range header."""
    path = await _find_map(station, name)
    if path is None or path.suffix != ".pmtiles":
        return _unknown_map_response(name)
    if range_header is not None and not _is_within(range_header, path.stat().st_size):
        return problem(
            416,
            "No such part",
            "no_such_part",
            f"{name} has no part {range_header[:100]!r}.",
            remedy="Request `bytes=FIRST-LAST` within the file.",
        )
    return FileResponse(path, media_type="application/octet-stream", headers=REVALIDATE)


@router.get(
    "/{name}/{zoom}/{x}/{y}",
    response_class=Response,
    responses={
        **RESPONSES,
        200: {"content": {"image/png": {}}},
        204: {"description": "The map has no such tile."},
    },
)
async def map_tile(
    name: str,
    zoom: Annotated[int, Path(ge=0, le=MAX_ZOOM)],
    x: Annotated[int, Path(ge=0, lt=1 << MAX_ZOOM)],
    y: Annotated[int, Path(ge=0, lt=1 << MAX_ZOOM)],
    station: StationDep,
) -> Response:
    """A tile of an MBTiles file, y counted from the north."""
    path = await _find_map(station, name)
    if path is None or path.suffix != ".mbtiles":
        return _unknown_map_response(name)
    info = await _in_thread(read_map, path)
    tile = await _in_thread(read_tile, path, zoom, x, y)
    if tile is None:
        return Response(status_code=204, headers=REVALIDATE)
    encoding = {"Content-Encoding": "gzip"} if tile.startswith(GZIP_MAGIC) else {}
    return Response(tile, media_type=info.content_type, headers={**REVALIDATE, **encoding})


async def _in_thread(function: Callable[..., T], *arguments: object) -> T:
    """Reads maps in threads of their own, so that slow files take no thread from anything else."""
    return await asyncio.get_running_loop().run_in_executor(_threads, function, *arguments)


def _is_within(range_header: str, size: int) -> bool:
    """Whether this Range header requests one part inside the file."""
    match = RANGE.fullmatch(range_header)
    if match is None:
        return False
    first, last = match["first"], match["last"]
    if not first:
        return bool(last) and int(last) > 0
    return int(first) < size and (not last or int(last) >= int(first))


def _scan_folder(station: Station) -> tuple[list[dict[str, object]], list[str]]:
    maps: list[dict[str, object]] = []
    unreadable: list[str] = []
    if not station.maps.is_dir():
        return maps, unreadable
    for path in sorted(station.maps.iterdir()):
        if not is_map_name(path.name) or not path.is_file():
            continue
        try:
            maps.append(_map_view(read_map(path)))
        except MapError as error:
            unreadable.append(str(error))
    return maps, unreadable


def _map_view(info: MapInfo) -> dict[str, object]:
    return {
        "name": info.name,
        "url": f"/api/v1/maps/{quote(info.name)}",
        "format": info.format,
        "tiles": info.tiles,
        "min_zoom": info.min_zoom,
        "max_zoom": info.max_zoom,
        "bounds_deg": info.bounds_deg,
        "attribution": info.attribution,
        "layers": info.layers,
        "bytes": info.bytes,
    }


async def _source_view(station: Station, source: MapSource) -> dict[str, object]:
    """The chosen source as a map. Raises MapSourceFailed if its archive does not answer soon."""
    view: dict[str, object] = {
        "name": source.name,
        "url": f"/api/v1/map_sources/{source.id}",
        "format": "source",
        "tiles": "raster",
        "min_zoom": source.min_zoom,
        "max_zoom": source.max_zoom,
        "bounds_deg": None,
        "attribution": source.attribution,
        "layers": [],
        "bytes": 0,
    }
    if not source.is_archive:
        return view
    try:
        async with asyncio.timeout(ARCHIVE_TIMEOUT_S):
            info = await station.map_tiles.archive_info(source)
    except TimeoutError:
        text = f"The map source {source.name} ({source.host}) gives no tiles: no answer yet."
        raise MapSourceFailed(text) from None
    return {
        **view,
        "tiles": "vector" if info.is_vector else "raster",
        "min_zoom": info.min_zoom,
        "max_zoom": info.max_zoom,
        "bounds_deg": info.bounds_deg,
        "attribution": source.attribution or info.attribution,
        "layers": info.layers,
    }


async def _find_map(station: Station, name: str) -> File | None:
    if not is_map_name(name):
        return None
    path = station.maps / name
    return path if await asyncio.to_thread(path.is_file) else None


def _unknown_map_response(name: str) -> Response:
    detail = f"There is no map {name!r} of this kind; GET /api/v1/maps lists the maps."
    return problem(404, "Not found", "unknown_map", detail)
