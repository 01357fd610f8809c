"""Tiles of a source: asked for once, kept on disk, and shown again when the source does not answer."""

from __future__ import annotations

import asyncio
import logging
import sqlite3
import struct
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar
from urllib.parse import urlsplit

from gcs_server.clock import Clock
from gcs_server.errors import GcsError, ServerBusy
from gcs_server.maps.archive import Archive, ArchiveError, ArchiveInfo
from gcs_server.maps.downloads import Downloads, NoAnswer, body
from gcs_server.maps.sources import MapSource

log = logging.getLogger(__name__)
T = TypeVar("T")

FRESH_S = 14 * 86_400.0
"""Age up to which a kept tile is shown without asking again [s]; OpenStreetMap asks for seven days."""
MAX_TILE_BYTES = 2_000_000
MAX_DESCRIPTION_BYTES = 8_000_000
"""The largest public descriptions of WMTS services have about 6 MB."""
OUT_OF_RANGE = b"TileOutOfRange"
"""How a WMTS service answers (status 400) outside the area of a layer."""
MAX_STORE_BYTES = 1_000_000_000
"""Maximum size of the kept tiles of a source; the oldest tenth is dropped."""
CONCURRENT = 6
"""Maximum number of requests at a time, as a browser makes them."""
MAX_WAITING = 500
PAUSE_S = 5.0
"""Pause after a request without an answer, so that a dead source is not asked for each tile [s]."""
SIZE_CHECK_EVERY = 200
REMEDY = "Check its address and this computer's connection, or choose another source."
ELEVATION_SIDES_PX = ((256, 256), (512, 512))
_PNG_HEAD = struct.Struct("!12s4sIIBB")
"""Magic and length of the first block, its name, width, height, bits of a colour, kind of colours."""
_RGB_COLOURS = (2, 6)
"""Kinds of colours of a PNG: RGB, and RGB with opacity."""
_IMAGES = ((b"\x89PNG\r\n\x1a\n", "image/png"), (b"\xff\xd8\xff", "image/jpeg"), (b"RIFF", "image/webp"))


class MapSourceFailed(GcsError):
    """A map source did not answer, or with something other than a tile."""

    code = "map_source_failed"


class ArchiveChanged(Exception):
    """An archive has changed since its directories were read."""


def content_type(tile: bytes) -> str | None:
    """The type of an image; None: it is no image that the page shows."""
    found = next((kind for magic, kind in _IMAGES if tile.startswith(magic)), None)
    return None if found == "image/webp" and tile[8:12] != b"WEBP" else found


def image_fault(tile: bytes) -> str | None:
    """Why an answer is no tile of a map; None: it is one."""
    return "no PNG, JPEG or WebP image" if content_type(tile) is None else None


def elevation_fault(tile: bytes) -> str | None:
    """Why an answer is no tile of heights (Terrarium), as far as its first bytes show; None: nothing is
    wrong."""
    if content_type(tile) != "image/png" or len(tile) < _PNG_HEAD.size:
        return "no PNG image"
    _, name, width, height, depth, colours = _PNG_HEAD.unpack_from(tile)
    if name != b"IHDR" or (width, height) not in ELEVATION_SIDES_PX:
        return f"an image of {width} by {height} pixels, not 256 or 512"
    return None if depth == 8 and colours in _RGB_COLOURS else "an image without heights (8-bit RGB)"


@dataclass(frozen=True, slots=True)
class KeptTile:
    """A tile on disk; empty: the source has no such tile."""

    content: bytes
    fetched_unix_s: float


class TileStore:
    """The kept tiles of one source: an SQLite file, which may be deleted at any time. All methods block."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._database: sqlite3.Connection | None = None
        self._written = 0

    def get(self, zoom: int, x: int, y: int) -> KeptTile | None:
        """A tile; None: not kept."""
        return self._tried(lambda database: self._get(database, zoom, x, y))

    def put(self, zoom: int, x: int, y: int, tile: KeptTile) -> None:
        """Keeps a tile; a full disk is only logged."""

        def write(database: sqlite3.Connection) -> None:
            row = (zoom, x, y, tile.content, tile.fetched_unix_s)
            with database:
                database.execute("INSERT OR REPLACE INTO kept VALUES (?, ?, ?, ?, ?)", row)
            self._written += 1
            if self._written % SIZE_CHECK_EVERY == 0 and _size(database) > MAX_STORE_BYTES:
                with database:
                    count = database.execute("SELECT count(*) FROM kept").fetchone()[0] // 10
                    oldest = "SELECT rowid FROM kept ORDER BY fetched_unix_s LIMIT ?"
                    database.execute(f"DELETE FROM kept WHERE rowid IN ({oldest})", (count,))

        self._tried(write)

    def size_bytes(self) -> int:
        """Size of the kept tiles."""
        return (self._tried(_size) or 0) if self._path.exists() else 0

    def mean_tile_bytes(self) -> float | None:
        """Mean size of the kept tiles; None: there are none."""
        sample = "SELECT content FROM kept WHERE length(content) > 0 LIMIT 500"
        query = f"SELECT avg(length(content)) FROM ({sample})"
        return self._tried(lambda database: database.execute(query).fetchone()[0])

    def close(self) -> None:
        """Closes the file."""
        if self._database is not None:
            self._database.close()
            self._database = None

    @staticmethod
    def _get(database: sqlite3.Connection, zoom: int, x: int, y: int) -> KeptTile | None:
        query = "SELECT content, fetched_unix_s FROM kept WHERE zoom=? AND x=? AND y=?"
        row = database.execute(query, (zoom, x, y)).fetchone()
        return None if row is None else KeptTile(bytes(row[0]), float(row[1]))

    def _tried(self, work: Callable[[sqlite3.Connection], T]) -> T | None:
        """The result of the work; None: the file cannot be used, which is logged. A damaged file is
        replaced."""
        try:
            return work(self._opened())
        except (sqlite3.Error, OSError, TypeError) as error:
            log.warning("the kept map tiles in %s: %s", self._path, error)
            if isinstance(error, sqlite3.DatabaseError) and not isinstance(error, sqlite3.OperationalError):
                self.close()
                self._path.unlink(missing_ok=True)
            return None

    def _opened(self) -> sqlite3.Connection:
        if self._database is None:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            database = sqlite3.connect(self._path, check_same_thread=False)
            database.execute("PRAGMA journal_mode=WAL")
            database.execute("PRAGMA synchronous=NORMAL")
            columns = "zoom INTEGER, x INTEGER, y INTEGER, content BLOB, fetched_unix_s REAL"
            database.execute(f"CREATE TABLE IF NOT EXISTS kept ({columns}, PRIMARY KEY (zoom, x, y))")
            self._database = database
        return self._database


def _size(database: sqlite3.Connection) -> int:
    pages = database.execute("PRAGMA page_count").fetchone()[0]
    free = database.execute("PRAGMA freelist_count").fetchone()[0]
    return (pages - free) * database.execute("PRAGMA page_size").fetchone()[0]


class Tiles:
    """Answers with tiles of sources: kept ones, or asks the source.

    Args:
        clock: the server's clock.
        folder: folder of the kept tiles; created when the first tile is kept.
        what: what the sources are sources of, for texts.
        fault: says why an answer is no tile; None: it is one.
    """

    def __init__(
        self,
        clock: Clock,
        folder: Path,
        what: str = "map source",
        fault: Callable[[bytes], str | None] = image_fault,
    ) -> None:
        self._clock = clock
        self._folder = folder
        self._what, self._fault = what, fault
        self._stores: dict[str, TileStore] = {}
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="map-tiles")
        self._downloads = Downloads()
        self._places = asyncio.Semaphore(CONCURRENT)
        self._waiting = 0
        self._archives: dict[str, Archive] = {}
        self._etags: dict[str, str] = {}
        """By source: which version of its archive is being read."""
        self._failures: dict[str, tuple[float, str]] = {}
        """By source: time of the last failure [s, monotonic] and its text; removed by the next answer."""

    async def tile(self, source: MapSource, zoom: int, x: int, y: int) -> bytes:
        """A tile, y counted from the north; empty: the source has none there.

        Raises:
            MapSourceFailed: the source does not answer with a tile, and none is kept.
            ServerBusy: too many requests wait.
        """
        kept = await self._in_thread(source, lambda store: store.get(zoom, x, y))
        if kept is not None and self._clock.unix_s() - kept.fetched_unix_s < FRESH_S:
            return kept.content
        if self._waiting >= MAX_WAITING:
            raise ServerBusy(f"{MAX_WAITING} tiles are being requested.", remedy="Wait a moment.")
        self._waiting += 1
        try:
            content = await self._ask(source, lambda: self._content(source, zoom, x, y))
        except MapSourceFailed:
            if kept is None:
                raise
            return kept.content  # an old map is better than none
        finally:
            self._waiting -= 1
        tile = KeptTile(content, self._clock.unix_s())
        await self._in_thread(source, lambda store: store.put(zoom, x, y, tile))
        return content

    async def pause(self) -> None:
        """Waits until a source that has failed is asked again."""
        await self._clock.sleep(PAUSE_S)

    def failure(self, source: MapSource) -> str | None:
        """Why the source last failed; None: it answered since."""
        failed = self._failures.get(source.id)
        return None if failed is None else failed[1]

    async def kept_bytes(self, source: MapSource) -> int:
        """Size of the kept tiles of a source."""
        return await self._in_thread(source, TileStore.size_bytes)

    async def mean_tile_bytes(self, source: MapSource) -> float | None:
        """Mean size of the kept tiles of a source; None: there are none."""
        return await self._in_thread(source, TileStore.mean_tile_bytes)

    async def forget(self, source: MapSource) -> None:
        """Deletes the kept tiles of a source."""
        await self._in_thread(source, TileStore.close)
        self._stores.pop(source.id, None)
        self._failures.pop(source.id, None)
        self._forget_archive(source)
        for path in self._folder.glob(f"{source.id}.sqlite*"):
            path.unlink(missing_ok=True)

    async def close(self) -> None:
        """Ends all requests and closes the files."""
        await self._downloads.close()
        for store in self._stores.values():
            await asyncio.get_running_loop().run_in_executor(self._thread, store.close)
        self._thread.shutdown()

    async def description(self, url: str) -> bytes:
        """The description of a service of tiles, as it is. Raises MapSourceFailed."""
        try:
            return await self._downloads.document(url, MAX_DESCRIPTION_BYTES)
        except NoAnswer as error:
            text = f"The service at {urlsplit(url).hostname} does not describe its tiles: {error}."
            raise MapSourceFailed(text, remedy=REMEDY) from error

    async def _in_thread(self, source: MapSource, work: Callable[[TileStore], T]) -> T:
        store = self._stores.get(source.id)
        if store is None:
            store = self._stores[source.id] = TileStore(self._folder / f"{source.id}.sqlite")
        return await asyncio.get_running_loop().run_in_executor(self._thread, work, store)

    async def archive_info(self, source: MapSource) -> ArchiveInfo:
        """What the archive of a source says about itself. Raises MapSourceFailed."""

        async def info() -> ArchiveInfo:
            return await self._archive_of(source).info()

        return await self._ask(source, lambda: self._from_archive(source, info))

    def _archive_of(self, source: MapSource) -> Archive:
        archive = self._archives.get(source.id)
        if archive is None:
            archive = Archive(lambda offset, length: self._range(source, offset, length))
            self._archives[source.id] = archive
        return archive

    async def _from_archive(self, source: MapSource, work: Callable[[], Awaitable[T]]) -> T:
        """The result of the work on an archive, again from its beginning if it has changed meanwhile."""
        try:
            try:
                return await work()
            except ArchiveChanged:
                self._forget_archive(source)
                return await work()
        except (ArchiveError, ArchiveChanged) as error:
            raise NoAnswer(f"it answers with {error}") from error

    def _forget_archive(self, source: MapSource) -> None:
        self._archives.pop(source.id, None)
        self._etags.pop(source.id, None)

    async def _content(self, source: MapSource, zoom: int, x: int, y: int) -> bytes:
        if not source.is_archive:
            return await self._download(source.tile_url(zoom, x, y))

        async def content() -> bytes:
            archive = self._archive_of(source)
            tile = await archive.tile(zoom, x, y)
            fault = self._fault(tile) if tile and not (await archive.info()).is_vector else None
            if fault is not None:
                raise ArchiveError(fault)
            return tile

        return await self._from_archive(source, content)

    async def _ask(self, source: MapSource, work: Callable[[], Awaitable[T]]) -> T:
        async with self._places:
            failed = self._failures.get(source.id)
            if failed is not None and self._clock.monotonic_s() - failed[0] < PAUSE_S:
                raise MapSourceFailed(failed[1], remedy=REMEDY)
            try:
                content = await work()
            except NoAnswer as error:
                text = f"The {self._what} {source.name} ({source.host}) gives no tiles: {error}."
                self._failures[source.id] = (self._clock.monotonic_s(), text)
                raise MapSourceFailed(text, remedy=REMEDY) from error
            self._failures.pop(source.id, None)
            return content

    async def _download(self, url: str) -> bytes:
        async with self._downloads.answer(url) as answer:
            if answer.status_code in (204, 404):
                return b""
            tile = await body(answer, MAX_TILE_BYTES, f"its tiles have more than {MAX_TILE_BYTES / 1e6:g} MB")
        if answer.status_code == 400 and OUT_OF_RANGE in tile:
            return b""
        if answer.status_code != 200:
            raise NoAnswer(f"it answers with status {answer.status_code}")
        fault = self._fault(tile)
        if fault is not None:
            kind = answer.headers.get("content-type", "unknown type")[:60]
            raise NoAnswer(f"it answers with {fault} ({kind})")
        return tile

    async def _range(self, source: MapSource, offset: int, length: int) -> bytes:
        """A part of a source's archive. Raises NoAnswer and ArchiveChanged."""
        headers = {"Range": f"bytes={offset}-{offset + length - 1}", "Accept-Encoding": "identity"}
        async with self._downloads.answer(source.url, headers) as answer:
            if answer.status_code == 200:
                raise NoAnswer("it ignores which part of the archive it is asked for")
            if answer.status_code != 206:
                raise NoAnswer(f"it answers with status {answer.status_code}")
            etag = answer.headers.get("etag", "")
            if self._etags.setdefault(source.id, etag) != etag:
                raise ArchiveChanged("an archive that changes")
            return await body(answer, length, f"its tiles have more than {length:,} bytes")
