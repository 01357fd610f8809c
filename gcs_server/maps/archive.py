"""Reads a PMTiles archive (version 3) at an address, part by part: header, directories, tiles.

The archive comes from outside: every part is bounded before it is asked for, and before it is unpacked.
"""

from __future__ import annotations

import asyncio
import json
import zlib
from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_server.storage.maps import PMTILES_HEADER, Bounds, bounds_of, layers_of

FIRST_BYTES = 16_384
"""Header and root directory are within these."""
MAX_DIRECTORY_BYTES, MAX_UNPACKED_BYTES = 1_000_000, 4_000_000
MAX_ENTRIES = 100_000
MAX_DIRECTORIES = 16
"""Number of directories that are remembered."""
MAX_DEPTH = 4
MAX_METADATA_BYTES = 1_000_000
MAX_TILE_BYTES = 2_000_000
UNKNOWN, NO_COMPRESSION, GZIP = 0, 1, 2
VECTOR = 1
RASTER = (2, 3, 4)
"""PNG, JPEG, WebP."""
GZIP_WBITS = 31

ReadRange = Callable[[int, int], Awaitable[bytes]]
"""Reads from an offset a number of bytes, or fewer at the end of the archive."""


class ArchiveError(Exception):
    """The archive cannot be used; the text says why."""


@dataclass(frozen=True, slots=True)
class ArchiveInfo:
    """What an archive says about itself."""

    is_vector: bool
    min_zoom: int
    max_zoom: int
    bounds_deg: Bounds | None
    attribution: str | None
    layers: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Header:
    root: tuple[int, int]
    """Offset and length; so the others."""
    metadata: tuple[int, int]
    leaves: tuple[int, int]
    tiles: tuple[int, int]
    packed_directories: bool
    packed_tiles: bool
    info: ArchiveInfo


@dataclass(frozen=True, slots=True)
class _Directory:
    """Entries, ascending by their first tile."""

    first: list[int]
    runs: list[int]
    """Number of tiles that an entry is for; 0: the entry is a leaf directory."""
    lengths: list[int]
    offsets: list[int]


class Archive:
    """One archive.

    Args:
        read: reads a part of it.
    """

    def __init__(self, read: ReadRange) -> None:
        self._read = read
        self._header: _Header | None = None
        self._directories: OrderedDict[int, _Directory] = OrderedDict()
        """By offset; the root has its own."""
        self._one_at_a_time = asyncio.Lock()

    async def info(self) -> ArchiveInfo:
        """What it says about itself. Raises ArchiveError, and what `read` raises."""
        return (await self._opened()).info

    async def tile(self, zoom: int, x: int, y: int) -> bytes:
        """A tile, unpacked, y counted from the north; empty: it has none there. Raises as `info`."""
        header = await self._opened()
        if not header.info.min_zoom <= zoom <= header.info.max_zoom:
            return b""
        number = tile_id(zoom, x, y)
        place, limit = header.root, header.root
        for _ in range(MAX_DEPTH):
            directory = await self._directory(header, place, limit)
            index = bisect_right(directory.first, number) - 1
            if index < 0:
                return b""
            run, offset, length = directory.runs[index], directory.offsets[index], directory.lengths[index]
            if run == 0:
                place, limit = (header.leaves[0] + offset, length), header.leaves
                continue
            if number >= directory.first[index] + run:
                return b""
            if length > MAX_TILE_BYTES or offset + length > header.tiles[1]:
                raise ArchiveError(f"a tile of {length:,} bytes")
            packed = await self._part(header.tiles[0] + offset, length)
            return _unpacked(packed, MAX_TILE_BYTES) if header.packed_tiles else packed
        raise ArchiveError("its directories are nested too deeply")

    async def _opened(self) -> _Header:
        async with self._one_at_a_time:
            if self._header is None:
                begin = await self._read(0, FIRST_BYTES)
                header = _header_of(begin)
                root = begin[header.root[0] : sum(header.root)]
                if len(root) != header.root[1]:
                    raise ArchiveError("its root directory is not at its beginning")
                directory = await asyncio.to_thread(_directory_of, root, header.packed_directories)
                metadata = await self._part(*header.metadata) if header.metadata[1] else b"{}"
                info = await asyncio.to_thread(_with_metadata, header, metadata)
                self._directories[header.root[0]] = directory
                self._header = _Header(
                    header.root, header.metadata, header.leaves, header.tiles,
                    header.packed_directories, header.packed_tiles, info,
                )  # fmt: skip
            return self._header

    async def _directory(self, header: _Header, place: tuple[int, int], limit: tuple[int, int]) -> _Directory:
        offset, length = place
        known = self._directories.get(offset)
        if known is None:
            if length > MAX_DIRECTORY_BYTES or offset + length > sum(limit):
                raise ArchiveError(f"a directory of {length:,} bytes")
            packed = await self._part(offset, length)
            known = await asyncio.to_thread(_directory_of, packed, header.packed_directories)
            self._directories[offset] = known
        self._directories.move_to_end(offset)
        while len(self._directories) > MAX_DIRECTORIES:
            self._directories.popitem(last=False)
        return known

    async def _part(self, offset: int, length: int) -> bytes:
        part = await self._read(offset, length)
        if len(part) != length:
            raise ArchiveError("it ends too early")
        return part


def tile_id(zoom: int, x: int, y: int) -> int:
    """Number of a tile: those of smaller zooms first, then along a Hilbert curve."""
    number = ((1 << 2 * zoom) - 1) // 3
    side = 1 << zoom
    for bit in range(zoom - 1, -1, -1):
        right, down = x >> bit & 1, y >> bit & 1
        number += (3 * right ^ down) << 2 * bit
        if not down:
            if right:
                x, y = side - 1 - x, side - 1 - y
            x, y = y, x
    return number


def _header_of(begin: bytes) -> _Header:
    if begin[:7] != b"PMTiles":
        raise ArchiveError("no PMTiles archive")
    if len(begin) < PMTILES_HEADER.size or begin[7] != 3:
        raise ArchiveError("a PMTiles archive of another version than 3")
    fields = PMTILES_HEADER.unpack_from(begin)
    numbers, (_, directories, tiles, kind, min_zoom, max_zoom) = fields[2:13], fields[13:19]
    if kind != VECTOR and kind not in RASTER:
        raise ArchiveError("tiles that are neither PNG, JPEG, WebP nor vector tiles")
    if directories not in (NO_COMPRESSION, GZIP) or tiles not in (UNKNOWN, NO_COMPRESSION, GZIP):
        raise ArchiveError("another compression than gzip")
    if numbers[3] > MAX_METADATA_BYTES:
        raise ArchiveError(f"metadata of {numbers[3]:,} bytes")
    bounds = bounds_of([corner / 1e7 for corner in fields[19:23]])
    info = ArchiveInfo(kind == VECTOR, min_zoom, min(max_zoom, 24), bounds, None, ())
    parts = [(numbers[i], numbers[i + 1]) for i in (0, 2, 4, 6)]
    return _Header(parts[0], parts[1], parts[2], parts[3], directories == GZIP, tiles == GZIP, info)


def _with_metadata(header: _Header, packed: bytes) -> ArchiveInfo:
    is_packed = header.packed_directories and header.metadata[1] > 0
    text = _unpacked(packed, MAX_METADATA_BYTES) if is_packed else packed
    try:
        metadata: Any = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ArchiveError("metadata that are no JSON") from error
    if not isinstance(metadata, dict):
        raise ArchiveError("metadata that are no JSON object")
    attribution = metadata.get("attribution")
    shown = attribution if isinstance(attribution, str) else None
    i = header.info
    return ArchiveInfo(i.is_vector, i.min_zoom, i.max_zoom, i.bounds_deg, shown, layers_of(metadata))


def _unpacked(packed: bytes, max_bytes: int) -> bytes:
    try:
        content = zlib.decompressobj(GZIP_WBITS).decompress(packed, max_bytes + 1)
    except zlib.error as error:
        raise ArchiveError("a part that cannot be unpacked") from error
    if len(content) > max_bytes:
        raise ArchiveError(f"a part of more than {max_bytes:,} bytes")
    return content


def _directory_of(packed: bytes, is_packed: bool) -> _Directory:
    values = _varints(_unpacked(packed, MAX_UNPACKED_BYTES) if is_packed else packed)
    count = int(values[0]) if len(values) else 0
    if count > MAX_ENTRIES:
        raise ArchiveError(f"a directory of {count:,} entries")
    if len(values) != 1 + 4 * count or count == 0:
        raise ArchiveError("a damaged directory")
    steps, runs, lengths, places = values[1:].reshape(4, count)
    begins = np.concatenate([[0], np.cumsum(lengths)[:-1]])
    # An offset of 0 means: directly after the entry before.
    last_given = np.maximum.accumulate(np.where(places > 0, np.arange(count), 0))
    offsets = places[last_given] - 1 + begins - begins[last_given]
    if places[0] == 0 or (offsets < 0).any():
        raise ArchiveError("a damaged directory")
    return _Directory(np.cumsum(steps).tolist(), runs.tolist(), lengths.tolist(), offsets.tolist())


def _varints(content: bytes) -> NDArray[np.int64]:
    """All numbers of a directory; of at most seven bytes each, so that sums fit."""
    data = np.frombuffer(content, np.uint8)
    ends = np.flatnonzero(data < 128)
    if not len(ends) or ends[-1] != len(data) - 1:
        raise ArchiveError("a damaged directory")
    begins = np.concatenate([[0], ends[:-1] + 1])
    sizes = ends - begins + 1
    if sizes.max() > 7:
        raise ArchiveError("a damaged directory")
    shifts = 7 * (np.arange(len(data)) - np.repeat(begins, sizes))
    return np.add.reduceat((data & 127).astype(np.int64) << shifts, begins)
