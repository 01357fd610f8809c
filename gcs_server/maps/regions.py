"""Saves the tiles of a region as an MBTiles file in the maps folder, for the field."""

from __future__ import annotations

import asyncio
import glob
import math
import sqlite3
from collections.abc import Awaitable, Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from gcs_server.errors import InvalidRequest, Refused
from gcs_server.maps.sources import MapSource
from gcs_server.maps.tiles import MapSourceFailed, Tiles, content_type
from gcs_server.operations.operations import ReportProgress
from gcs_server.storage.maps import MapError, is_map_name

MAX_TILES = 50_000
USUAL_TILE_BYTES = 20_000.0
"""Size of a tile of a source of which none is kept, for the estimate."""
BATCH = 6
ATTEMPTS = 3
MAX_LATITUDE_DEG = 85.0511
"""The web's Mercator projection ends here."""
_FORMATS = {"image/png": "png", "image/jpeg": "jpg", "image/webp": "webp"}

Place = tuple[int, int, int]
"""Zoom, x, y from the north."""


@dataclass(frozen=True, slots=True)
class Region:
    """An area and the zooms in which its tiles are saved."""

    bounds_deg: tuple[float, float, float, float]
    """West, south, east, north."""
    min_zoom: int
    max_zoom: int

    def check(self, source: MapSource) -> None:
        """Raises InvalidRequest or Refused if the source's tiles of this region cannot be saved."""
        west, south, east, north = self.bounds_deg
        if not (west < east and south < north):
            raise InvalidRequest("bounds_deg", "West must be less than east, and south less than north.")
        if not source.min_zoom <= self.min_zoom <= self.max_zoom <= source.max_zoom:
            raise InvalidRequest(
                "max_zoom",
                f"The zooms {self.min_zoom} to {self.max_zoom} are not within {source.min_zoom} to "
                f"{source.max_zoom}, which {source.name} has.",
            )
        if not source.may_save:
            raise Refused(
                f"The terms of {source.name} do not allow saving a region.",
                remedy="Add a source whose terms allow it, or copy a map file into the maps folder.",
            )
        if self.count() > MAX_TILES:
            raise Refused(
                f"The region has {self.count():,} tiles; at most {MAX_TILES:,} are saved at a time.",
                remedy="Choose a smaller area, or a lower greatest zoom.",
            )

    def count(self) -> int:
        """Number of tiles."""
        return sum((x1 - x0 + 1) * (y1 - y0 + 1) for _, x0, x1, y0, y1 in self._ranges())

    def places(self) -> Iterator[Place]:
        """All tiles, from the smallest zoom."""
        for zoom, x0, x1, y0, y1 in self._ranges():
            for x in range(x0, x1 + 1):
                for y in range(y0, y1 + 1):
                    yield zoom, x, y

    def _ranges(self) -> Iterator[tuple[int, int, int, int, int]]:
        west, south, east, north = self.bounds_deg
        for zoom in range(self.min_zoom, self.max_zoom + 1):
            yield (zoom, _column(west, zoom), _column(east, zoom), _row(north, zoom), _row(south, zoom))


def _column(lon_deg: float, zoom: int) -> int:
    return min((1 << zoom) - 1, int((lon_deg + 180.0) / 360.0 * (1 << zoom)))


def _row(lat_deg: float, zoom: int) -> int:
    lat_rad = math.radians(max(-MAX_LATITUDE_DEG, min(MAX_LATITUDE_DEG, lat_deg)))
    share = (1.0 - math.asinh(math.tan(lat_rad)) / math.pi) / 2.0
    return max(0, min((1 << zoom) - 1, int(share * (1 << zoom))))


def region_path(folder: Path, name: str, suffix: str = ".mbtiles") -> Path:
    """Path of a new map file, or elevation file, of this name.

    Raises:
        InvalidRequest: the name cannot be used, or the file exists.
    """
    path = folder / f"{name}{suffix}"
    if not is_map_name(f"{name}.mbtiles"):
        raise InvalidRequest("name", f"{name!r} cannot be the name of a file.", remedy="Use letters.")
    if path.exists():
        raise InvalidRequest("name", f"There is a file {path.name} already.", remedy="Choose another name.")
    return path


async def save(
    tiles: Tiles,
    source: MapSource,
    region: Region,
    path: Path,
    report: ReportProgress,
    finish: Callable[[Path], Awaitable[None]] | None = None,
) -> int:
    """Saves the tiles of a region; tiles that are kept are not asked for again. Returns the number of tiles.

    Args:
        tiles: asks the source, and keeps its tiles.
        source: the source.
        region: the area and the zooms.
        path: the file.
        report: told of the progress.
        finish: makes the file from the MBTiles file with all tiles; None: that file is the result.

    Raises:
        MapSourceFailed: the source stopped answering.
        MapError: the file cannot be written, or the source has no tile in the region.
    """
    part = path.with_name(f".{path.name}.part")
    total, done, saved = region.count(), 0, 0
    format_name = ""
    try:
        await _to_its_end(_begin, part)
        batch: list[Place] = []
        for place in region.places():
            batch.append(place)
            done += 1
            if len(batch) < BATCH and done < total:
                continue
            contents = await asyncio.gather(*(_one(tiles, source, each) for each in batch))
            rows = [(*each, content) for each, content in zip(batch, contents, strict=True) if content]
            for row in rows[:1]:
                format_name = format_name or _FORMATS[content_type(row[3]) or "image/png"]
            await _to_its_end(_write, part, rows)
            saved, batch = saved + len(rows), []
            report(f"{done:,} of {total:,} tiles of {source.name}.", done / total)
        if not saved:
            raise MapError(f"{source.name} has no tiles in this region.", remedy="Choose another region.")
        await _to_its_end(_finish, part, source, region, format_name)
        if finish is not None:
            await finish(part)
        else:
            part.rename(path)
    except (sqlite3.Error, OSError) as error:
        raise MapError(
            f"The file {path.name} cannot be written: {error}.",
            remedy="Make room on the server's disk. Nothing was saved.",
        ) from error
    finally:
        for each in (part, *part.parent.glob(f"{glob.escape(part.name)}-*")):  # SQLite's own beside it
            each.unlink(missing_ok=True)
    return saved


async def _to_its_end(work: Callable[..., None], *arguments: object) -> None:
    """Runs in a thread. A cancellation waits for its end: else the file would appear after its removal."""
    running = asyncio.ensure_future(asyncio.to_thread(work, *arguments))
    try:
        await asyncio.shield(running)
    except asyncio.CancelledError:
        await asyncio.wait([running])
        raise


async def _one(tiles: Tiles, source: MapSource, place: Place) -> bytes:
    for attempt in range(ATTEMPTS):
        try:
            return await tiles.tile(source, *place)
        except MapSourceFailed:
            if attempt == ATTEMPTS - 1:
                raise
            await tiles.pause()
    raise AssertionError("unreachable")


def _begin(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("CREATE TABLE metadata (name TEXT, value TEXT)")
        columns = "zoom_level INTEGER, tile_column INTEGER, tile_row INTEGER, tile_data BLOB"
        database.execute(f"CREATE TABLE tiles ({columns}, PRIMARY KEY (zoom_level, tile_column, tile_row))")


def _write(path: Path, rows: list[tuple[int, int, int, bytes]]) -> None:
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("PRAGMA synchronous=OFF")
        database.executemany(
            "INSERT INTO tiles VALUES (?, ?, ?, ?)",  # MBTiles counts rows from the south
            [(zoom, x, (1 << zoom) - 1 - y, content) for zoom, x, y, content in rows],
        )


def _finish(part: Path, source: MapSource, region: Region, format_name: str) -> None:
    metadata = {
        "name": part.name[1:].removesuffix(".mbtiles.part"),
        "type": "baselayer",
        "format": format_name,
        "attribution": source.attribution,
        "bounds": ",".join(f"{each:.6f}" for each in region.bounds_deg),
        "minzoom": str(region.min_zoom),
        "maxzoom": str(region.max_zoom),
    }
    with closing(sqlite3.connect(part)) as database, database:
        database.executemany("INSERT INTO metadata VALUES (?, ?)", metadata.items())
