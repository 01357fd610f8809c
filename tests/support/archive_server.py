"""PMTiles archives, and a server on this computer that sends parts of one."""

from __future__ import annotations

import contextlib
import gzip
import json
import re
import struct
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

PNG_TILES, VECTOR_TILES = 2, 1


def directory(entries: list[tuple[int, int, int, int]]) -> bytes:
    """A packed directory of entries: first tile, run, length, offset."""
    numbers = [len(entries)]
    first = [each[0] for each in entries]
    numbers += [b - a for a, b in zip([0, *first], first, strict=False)]
    numbers += [each[1] for each in entries] + [each[2] for each in entries]
    end = None
    for _, _, length, offset in entries:
        numbers.append(0 if offset == end else offset + 1)
        end = offset + length
    return gzip.compress(b"".join(map(varint, numbers)))


def varint(value: int) -> bytes:
    """A number in groups of seven bits, the lowest first."""
    content = bytearray()
    while value >= 0x80:
        content.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*content, value])


def archive(
    tiles: dict[int, bytes], *, kind: int = PNG_TILES, zooms: tuple[int, int] = (0, 3), packed: bool = False,
    metadata: dict[str, Any] | None = None, root: bytes | None = None,
) -> bytes:  # fmt: skip
    """An archive with tiles by their number; every two of them have a leaf directory of their own.

    Args:
        tiles: the tiles.
        kind: kind of the tiles.
        zooms: smallest and largest zoom.
        packed: whether the tiles are packed.
        metadata: the metadata.
        root: another root directory, for hostile archives.
    """
    contents = {number: gzip.compress(each) if packed else each for number, each in sorted(tiles.items())}
    data, offsets = b"".join(contents.values()), {}
    for number, each in contents.items():
        offsets[number] = sum(len(contents[n]) for n in contents if n < number), len(each)
    numbers, leaves, entries = list(contents), b"", []
    for begin in range(0, len(numbers), 2):
        leaf = directory([(n, 1, offsets[n][1], offsets[n][0]) for n in numbers[begin : begin + 2]])
        entries.append((numbers[begin], 0, len(leaf), len(leaves)))
        leaves += leaf
    root = directory(entries) if root is None else root
    info = gzip.compress(json.dumps({"attribution": "© Us"} if metadata is None else metadata).encode())
    places, at = [], 127
    for part in (root, info, leaves, data):
        places += [at, len(part)]
        at += len(part)
    header = b"PMTiles\x03" + struct.pack("<11Q", *places, len(tiles), len(tiles), len(tiles))
    header += bytes([1, 2, 2 if packed else 1, kind, *zooms])
    header += struct.pack("<4i", -1_800_000_000, -850_000_000, 1_800_000_000, 850_000_000)
    return header + bytes([0]) + struct.pack("<2i", 0, 0) + root + info + leaves + data


class ArchiveServer:
    """Sends parts of a file; notes which parts it was asked for.

    Args:
        content: the file.
    """

    def __init__(self, content: bytes) -> None:
        self.content, self.asked = content, []
        self.status, self.etag = 206, '"1"'
        server = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                found = re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers.get("Range", ""))
                server.asked.append(found and (int(found[1]), int(found[2])))
                body = server.content
                if server.status == 206 and found:
                    body = body[int(found[1]) : int(found[2]) + 1]
                self.send_response(server.status)
                self.send_header("Content-Length", str(len(body)))
                self.send_header("ETag", server.etag)
                self.end_headers()
                with contextlib.suppress(OSError):  # the server stops reading
                    self.wfile.write(body)

            def log_message(self, *_: object) -> None:
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        self.url = f"http://127.0.0.1:{self._server.server_address[1]}/world.pmtiles?key=1"

    def close(self) -> None:
        """Ends the server."""
        self._server.shutdown()
        self._server.server_close()
