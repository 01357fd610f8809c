"""Telemetry logs: reading their records, and a link that plays one."""

from __future__ import annotations

import asyncio
import gzip
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, cast

from gcs_server.links.base import Link, Peer

STX_V1, STX_V2 = 0xFE, 0xFD
TICK_S = 0.02
RECORDS_A_TICK = 2000
PLAUSIBLE_US = (10**14, 10**16)
"""1973 to 2286: what a record's time must be, so that damage is noticed."""

_time = struct.Struct(">Q")


def read_tlog(path: Path) -> Iterator[tuple[int, bytes]]:
    """(time in microseconds since 1970, raw frame) of each record; reads `.gz` too.

    A damaged stretch is skipped up to the next plausible record; a torn last record is left out.

    Raises:
        OSError: the file cannot be read.
    """
    with cast(BinaryIO, gzip.open(path, "rb") if path.suffix == ".gz" else path.open("rb")) as file:
        yield from _records(file)


def _records(file: BinaryIO) -> Iterator[tuple[int, bytes]]:
    buffer = b""
    while True:
        try:
            more = file.read(1 << 16)
        except EOFError:  # a gzip file that was cut off
            more = b""
        buffer += more
        position = 0
        while len(buffer) - position >= 8 + 12:
            length = _frame_length(buffer, position + 8)
            time_us = _time.unpack_from(buffer, position)[0]
            if not length or not PLAUSIBLE_US[0] < time_us < PLAUSIBLE_US[1]:
                position += 1
                continue
            if len(buffer) - position < 8 + length:
                break
            yield time_us, buffer[position + 8 : position + 8 + length]
            position += 8 + length
        buffer = buffer[position:]
        if not more:
            last = _frame_length(buffer, 8) if len(buffer) >= 8 + 8 else 0
            if last and len(buffer) >= 8 + last:  # a MAVLink 1 frame shorter than the smallest MAVLink 2 one
                yield _time.unpack_from(buffer)[0], buffer[8 : 8 + last]
            return


def _frame_length(buffer: bytes, at: int) -> int:
    if buffer[at] == STX_V2:
        return 12 + buffer[at + 1] + (13 if buffer[at + 2] & 1 else 0)
    return 8 + buffer[at + 1] if buffer[at] == STX_V1 else 0


class TlogLink(Link):
    """Plays a recording at its own pace, or `speed` times that; 0 is as fast as it goes."""

    replay = True

    def __init__(self, name: str, url: str, path: Path, speed: float = 1.0) -> None:
        super().__init__(name, url)
        self._path = path
        self._speed = speed
        self._peer = Peer(path.name)
        self._records: Iterator[tuple[int, bytes]] | None = None
        self._next: tuple[int, bytes] | None = None
        self._began_s = 0.0
        self._began_us = 0
        self._timer: asyncio.Handle | None = None

    def _open(self) -> None:
        self._records = read_tlog(self._path)
        self._next = next(self._records, None)
        if self._next is None:
            self._wanted = False
            self._set_state("ended", f"{self._path.name} holds no MAVLink records.")
            return
        self._began_us, self._began_s = self._next[0], self._loop.time()
        self._peers[self._peer.name] = self._peer
        self._opened()
        self._timer = self._loop.call_soon(self._play)

    def _explain(self, error: OSError) -> str:
        return f"{self._path}: {error.strerror or error}"

    def _play(self) -> None:
        due_us = self._began_us + (self._loop.time() - self._began_s) * 1e6 * self._speed
        for _ in range(RECORDS_A_TICK):
            if self._next is None or self._records is None:
                self._timer = None
                self._set_state("ended", "The recording has come to its end.")
                return
            time_us, raw = self._next
            if self._speed > 0 and time_us > due_us:
                break
            self._received(raw, self._peer)
            if not self._wanted:  # closed by who received it
                return
            try:
                self._next = next(self._records, None)
            except OSError as error:
                self._wanted = False
                self._set_state("ended", self._explain(error))
                return
        self._timer = self._loop.call_later(TICK_S if self._speed > 0 else 0.0, self._play)

    def _write(self, data: bytes, peer: Peer) -> bool:
        return False

    def _close(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._records = None
