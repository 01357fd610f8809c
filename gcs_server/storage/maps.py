"""The operator's own offline maps: PMTiles and MBTiles files in one folder, and their metadata."""

from __future__ import annotations

import functools
import json
import re
import sqlite3
import struct
import time
import zlib
from collections.abc import Generator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, cast

from gcs_server.errors import GcsError
from gcs_server.storage.folder import MAX_FILE_NAME_BYTES
from missions.values import hidden_character

Tiles = Literal["raster", "vector"]
Bounds = tuple[float, float, float, float]

PMTILES_HEADER = struct.Struct("<7sB11Q6B4iB2i")
"""Version 3: magic, version, eleven offsets and counts, six bytes, bounds, centre."""
GZIP = 2
NO_COMPRESSION = 1
VECTOR = 1
MAX_METADATA_BYTES = 1_000_000
"""Maximum size of the metadata, packed and unpacked."""
MAX_METADATA_ROWS = 200
MAX_TILE_BYTES = 8_000_000
QUERY_DEADLINE_S = 2.0
"""Deadline for the queries of one request: a file may define `tiles` as a view that never ends."""
INSTRUCTIONS_PER_CHECK = 10_000
"""Instructions of SQLite's virtual machine between two checks of the deadline: less than a millisecond."""
MAX_KNOWN_MAPS = 64
GZIP_WBITS = 31
_SQLITE_RECURSIVE = 33
"""Action code of a recursive query, which `sqlite3` does not name."""
_ALLOWED_ACTIONS = frozenset({sqlite3.SQLITE_SELECT, sqlite3.SQLITE_READ, sqlite3.SQLITE_FUNCTION})
NAME = re.compile(r"[^/\\\x00]{1,200}\.(pmtiles|mbtiles)")
IMAGE_TYPES = {"png": "image/png", "jpg": "image/jpeg", "jpeg": "image/jpeg", "webp": "image/webp"}
VECTOR_TYPE = "application/vnd.mapbox-vector-tile"


class MapError(GcsError):
    """A file in the maps folder cannot be used."""

    code = "map_file"


@dataclass(frozen=True, slots=True)
class MapInfo:
    """Metadata of a map file."""

    name: str
    format: Literal["pmtiles", "mbtiles"]
    tiles: Tiles
    content_type: str
    min_zoom: int
    max_zoom: int
    bounds_deg: Bounds | None
    """West, south, east, north."""
    attribution: str | None
    layers: tuple[str, ...]
    """Names of a vector map's layers."""
    bytes: int


def is_map_name(name: str) -> bool:
    """Whether a request may use this file name: a PMTiles or MBTiles file directly in the folder."""
    is_too_long = len(name.encode(errors="replace")) > MAX_FILE_NAME_BYTES
    is_shown = NAME.fullmatch(name) is not None and hidden_character(name) is None
    return is_shown and not name.startswith(".") and not is_too_long


def read_map(path: Path) -> MapInfo:
    """Reads the metadata of a map file; reads a file again only if it has changed.

    Raises:
        MapError: the file is not a valid map; the message contains the reason.
    """
    try:
        status = path.stat()
        found = _read_map(path, status.st_mtime_ns, status.st_size)
    except OSError as error:
        found = str(error)
    if isinstance(found, MapInfo):
        return found
    raise MapError(
        f"The map {path.name} cannot be read: {found}.",
        remedy="Copy a complete PMTiles (version 3) or MBTiles file into the maps folder.",
    )


@functools.lru_cache(MAX_KNOWN_MAPS)
def _read_map(path: Path, _changed_ns: int, _size: int) -> MapInfo | str:
    """The metadata of a file, or why it cannot be read."""
    try:
        return _pmtiles(path) if path.suffix == ".pmtiles" else _mbtiles(path)
    except (OSError, sqlite3.Error, struct.error, ValueError, zlib.error, RecursionError) as error:
        return str(error)


def read_tile(path: Path, zoom: int, x: int, y: int) -> bytes | None:
    """A tile of an MBTiles file, y counted from the north; None if the map does not have this tile.

    Raises:
        MapError: the file cannot be read.
    """
    try:
        with _opened(path) as database:
            row = database.execute(
                "SELECT tile_data FROM tiles WHERE zoom_level=? AND tile_column=? AND tile_row=?",
                (zoom, x, (1 << zoom) - 1 - y),
            ).fetchone()
    except sqlite3.Error as error:
        raise MapError(f"The map {path.name} cannot be read: {error}.") from error
    if row is not None and not isinstance(row[0], bytes):
        raise MapError(f"The map {path.name} cannot be read: a tile is not binary data.")
    return None if row is None else row[0]


@contextmanager
def _opened(path: Path) -> Generator[sqlite3.Connection]:
    """The file's database, which can only be read, and whose queries end at a deadline.

    `tiles` may be a view (Mapbox's own files join two tables), and a view may contain anything: it may not be
    recursive, and calls only the functions that SQLite considers harmless.
    """
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True)) as database:
        database.execute("PRAGMA trusted_schema=OFF")
        database.execute("PRAGMA query_only=ON")
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_TILE_BYTES)
        database.setlimit(sqlite3.SQLITE_LIMIT_ATTACHED, 0)
        database.set_authorizer(_authorized)
        end_s = time.monotonic() + QUERY_DEADLINE_S
        database.set_progress_handler(lambda: time.monotonic() > end_s, INSTRUCTIONS_PER_CHECK)
        yield database


def _authorized(action: int, *_: str | None) -> int:
    return sqlite3.SQLITE_OK if action in _ALLOWED_ACTIONS else sqlite3.SQLITE_DENY


def _mbtiles(path: Path) -> MapInfo:
    with _opened(path) as database:
        columns = "substr(name, 1, 100), substr(value, 1, ?)"
        rows = database.execute(
            f"SELECT {columns} FROM metadata LIMIT ?", (MAX_METADATA_BYTES, MAX_METADATA_ROWS)
        )
        metadata = {str(name): str(value) for name, value in rows}
        min_zoom, max_zoom = (
            _zooms(metadata)
            or database.execute(
                "SELECT (SELECT min(zoom_level) FROM tiles), (SELECT max(zoom_level) FROM tiles)"
            ).fetchone()
        )
    if min_zoom is None:
        raise ValueError("it has no tiles")
    tile_format = metadata.get("format", "png").lower()
    is_vector = tile_format == "pbf"
    if not is_vector and tile_format not in IMAGE_TYPES:
        raise ValueError(f"its tiles are of format {tile_format!r}; png, jpg, webp and pbf can be shown")
    corners = [float(part) for part in metadata["bounds"].split(",")] if "bounds" in metadata else []
    return MapInfo(
        name=path.name,
        format="mbtiles",
        tiles="vector" if is_vector else "raster",
        content_type=VECTOR_TYPE if is_vector else IMAGE_TYPES[tile_format],
        min_zoom=int(min_zoom),
        max_zoom=int(max_zoom),
        bounds_deg=bounds_of(corners),
        attribution=metadata.get("attribution"),
        layers=layers_of(json.loads(metadata["json"])) if is_vector and "json" in metadata else (),
        bytes=path.stat().st_size,
    )


def _zooms(metadata: dict[str, str]) -> tuple[int, int] | None:
    """The zooms that the metadata state; None: the tiles must be searched, which takes long without an
    index."""
    zooms = [metadata.get(name, "") for name in ("minzoom", "maxzoom")]
    if not all(re.fullmatch("[0-9]{1,2}", each) for each in zooms):
        return None
    return int(zooms[0]), int(zooms[1])


def _pmtiles(path: Path) -> MapInfo:
    with path.open("rb") as file:
        fields = PMTILES_HEADER.unpack(file.read(PMTILES_HEADER.size))
        magic, version, numbers, bytes_, corners = (
            fields[0],
            fields[1],
            fields[2:13],
            fields[13:19],
            fields[19:23],
        )
        if magic != b"PMTiles" or version != 3:
            raise ValueError("it is not a PMTiles file of version 3")
        metadata_offset, metadata_length = numbers[2], numbers[3]
        if metadata_length > MAX_METADATA_BYTES:
            raise ValueError("its metadata is too large")
        file.seek(metadata_offset)
        raw = file.read(metadata_length)
    _, compression, _, tile_type, min_zoom, max_zoom = bytes_
    metadata: dict[str, Any] = {}
    if compression in (NO_COMPRESSION, GZIP) and raw:
        metadata = json.loads(_unpacked(raw) if compression == GZIP else raw)
    if not isinstance(metadata, dict):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ValueError("its metadata is not a JSON object")
    attribution = metadata.get("attribution")
    return MapInfo(
        name=path.name,
        format="pmtiles",
        tiles="vector" if tile_type == VECTOR else "raster",
        content_type="application/octet-stream",
        min_zoom=min_zoom,
        max_zoom=max_zoom,
        bounds_deg=bounds_of([corner / 1e7 for corner in corners]),
        attribution=attribution if isinstance(attribution, str) else None,
        layers=layers_of(metadata),
        bytes=path.stat().st_size,
    )


def _unpacked(packed: bytes) -> bytes:
    """The content of a gzip stream of bounded size."""
    content = zlib.decompressobj(GZIP_WBITS).decompress(packed, MAX_METADATA_BYTES + 1)
    if len(content) > MAX_METADATA_BYTES:
        raise ValueError(f"its metadata is larger than {MAX_METADATA_BYTES:,} bytes")
    return content


def bounds_of(corners: list[float]) -> Bounds | None:
    """The bounds; None if they are invalid or empty."""
    if len(corners) != 4:
        return None
    west, south, east, north = corners
    is_valid = -180 <= west < east <= 180 and -90 <= south < north <= 90
    return (west, south, east, north) if is_valid else None


def layers_of(metadata: dict[str, Any]) -> tuple[str, ...]:
    """Names of the layers in the metadata of a vector map."""
    vector_layers = metadata.get("vector_layers")
    if not isinstance(vector_layers, list):
        return ()
    entries = cast(
        "list[dict[str, Any]]",
        [layer for layer in cast("list[Any]", vector_layers) if isinstance(layer, dict)],
    )
    return tuple(str(layer["id"]) for layer in entries if "id" in layer)
