"""Writes small map files of one colour, like those that an operator puts into the data folder."""

from __future__ import annotations

import gzip
import json
import sqlite3
import struct
import zlib
from contextlib import closing
from pathlib import Path

from tests.support.archive_server import varint


def png(colour: tuple[int, int, int], side: int = 256) -> bytes:
    """A square PNG of one colour."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    rows = (b"\0" + bytes(colour) * side) * side
    header_data = struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header_data)
        + chunk(b"IDAT", zlib.compress(rows))
        + chunk(b"IEND", b"")
    )


def write_pmtiles(path: Path, picture: bytes) -> None:
    """Writes a map of the whole world: one tile of zoom 0."""
    metadata = gzip.compress(json.dumps({"attribution": "© Red Survey"}).encode())
    # The directory has one entry: tile 0, run length 1, size in bytes as a varint, and offset plus one.
    root_directory = gzip.compress(bytes([1, 0, 1]) + varint(len(picture)) + bytes([1]))
    offsets = [127, 127 + len(root_directory), 127 + len(root_directory) + len(metadata)]
    header_numbers = [
        offsets[0],
        len(root_directory),
        offsets[1],
        len(metadata),
        offsets[2],
        0,
        offsets[2],
        len(picture),
        1,
        1,
        1,
    ]
    header = b"PMTiles" + bytes([3]) + struct.pack("<11Q", *header_numbers) + bytes([1, 2, 1, 2, 0, 0])
    header += struct.pack("<4i", -1_800_000_000, -850_000_000, 1_800_000_000, 850_000_000)
    path.write_bytes(header + bytes([0]) + struct.pack("<2i", 0, 0) + root_directory + metadata + picture)


def write_mbtiles(path: Path, picture: bytes) -> None:
    """Writes a map of the whole world: the four tiles of zoom 1."""
    with closing(sqlite3.connect(path)) as database:
        database.execute("CREATE TABLE metadata (name text, value text)")
        database.execute("CREATE TABLE tiles (zoom_level int, tile_column int, tile_row int, tile_data blob)")
        database.executemany(
            "INSERT INTO metadata VALUES (?, ?)", [("format", "png"), ("attribution", "Green Maps")]
        )
        database.executemany(
            "INSERT INTO tiles VALUES (1, ?, ?, ?)", [(x, y, picture) for x in (0, 1) for y in (0, 1)]
        )
        database.commit()


def vector_tile(layer: str) -> bytes:
    """A vector tile (Mapbox Vector Tile 2.1) whose one layer has one area, which is the whole tile."""

    def field(number: int, content: bytes | int) -> bytes:
        if isinstance(content, int):
            return varint(number << 3) + varint(content)
        return varint(number << 3 | 2) + varint(len(content)) + content

    move_to, line_to_3, close = 9, 26, 15
    there, back = 2 * 4096, 2 * 4096 - 1  # zigzag of 4096 and -4096
    steps = (move_to, 0, 0, line_to_3, there, 0, 0, there, back, 0, close)
    area = field(3, 3) + field(4, b"".join(map(varint, steps)))
    return field(3, field(15, 2) + field(1, layer.encode()) + field(2, area) + field(5, 4096))
