"""Common code of TCP and serial links, which have one descriptor and a stream of bytes."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from gcs_server.faults import FaultLog
from gcs_server.links.channel import MAX_READ_S, LinkReader
from gcs_server.links.pacing import Pacer
from gcs_server.links.send_queue import SendCounts
from gcs_server.links.writer import LinkWriter

READ_BYTES = 8192
READS_PER_WAKE = 128
FRAME_BYTES = 50
"""About the size of a MAVLink frame, which arrives as a whole over a network."""


class StreamSession:
    """Reads and writes one open stream until it ends.

    Args:
        read: returns some bytes, or b"" at the end; raises BlockingIOError if there are none.
        write: writes some of the bytes and returns their number.
        pacer: decides when the next frame may be written.
        on_received: called with received bytes.
        on_end: called once at the end, with the reason.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        fileno: int,
        *,
        read: Callable[[int], bytes],
        write: Callable[[bytes], int],
        on_received: Callable[[bytes], None],
        on_end: Callable[[str], None],
        pacer: Pacer,
        counts: SendCounts,
        faults: FaultLog,
        piece_bytes: int = FRAME_BYTES,
    ) -> None:
        self._read = read
        self._piece_bytes = piece_bytes
        self._on_received = on_received
        self._on_end = on_end
        self._closed = False
        self.writer = LinkWriter(
            loop,
            lambda data, _peer: write(data),
            counts,
            faults,
            loop.time,
            pacer=pacer,
            on_failure=lambda error: self._end(f"{error.strerror or error}."),
        )
        self._now_s = loop.time
        self._reader = LinkReader(loop, fileno, self._read_available, faults)

    def close(self) -> None:
        """Stops reading and writing; the descriptor may be closed afterwards."""
        self._closed = True
        self._reader.close()
        self.writer.close()

    def _read_available(self) -> int:
        pieces, end_s = 0, self._now_s() + MAX_READ_S
        for _ in range(READS_PER_WAKE):
            if self._closed or self._now_s() > end_s:
                break
            try:
                data = self._read(READ_BYTES)
            except (BlockingIOError, InterruptedError):
                break
            except OSError as error:
                self._end(f"{error.strerror or error}.")
                break
            if not data:
                self._end("The other side closed the connection.")
                break
            pieces += max(1, len(data) // self._piece_bytes)
            self._on_received(data)
        return pieces

    def _end(self, why: str) -> None:
        if not self._closed:
            self.close()
            self._on_end(why)
