"""Reads links with a file descriptor, when data arrive or in batches (writing: `writer.py`). TCP and serial
links, which have a stream of bytes, share `StreamSession`."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from gcs_server.faults import FaultLog
from gcs_server.links.pacing import Pacer
from gcs_server.links.send_queue import SendCounts
from gcs_server.links.writer import LinkWriter

MAX_READ_S = 0.02
"""Maximum time spent on one link per iteration of the event loop [s]. The remaining data wait in the system's
buffer; if it overflows, bytes are lost on this link only."""
READ_PERIODS = ((0.0, 0.0), (950.0, 0.010), (2000.0, 0.020))
"""(minimum pieces per second, seconds between two reads; 0: read when data arrive). A piece is about what
arrives at a time: a datagram, or some bytes of a stream. Each wake of the event loop costs as much as reading
dozens of pieces, so a busy link is read in batches. One PX4 sends some 400 datagrams a second to a ground
station, several at a time, and may answer as many requests."""
LEAVE_BELOW = 0.6
"""A link is read more often again once its rate is below this share of the rate at which it was slowed."""
WINDOW_S = 0.25
"""Time over which the rate is measured [s]."""
RETRY_S = 0.005
"""Time until a link is read again after an error [s]."""


class ReadPace:
    """Decides from the measured rate when a link is read: as soon as data arrive, or in batches. It slows
    down at once, before the window ends, when as many pieces arrive as a whole window may have.
    """

    def __init__(self) -> None:
        self._level = 0
        self._pieces = 0
        self._window_start_s = float("-inf")

    def period_s(self, pieces: int, now_s: float) -> float:
        """Records a reading; returns the time until the next one [s]; 0: when data arrive."""
        self._pieces += pieces
        elapsed_s = now_s - self._window_start_s
        rate_hz = self._pieces / max(elapsed_s, WINDOW_S)
        while self._level + 1 < len(READ_PERIODS) and rate_hz >= READ_PERIODS[self._level + 1][0]:
            self._level += 1
        if elapsed_s >= WINDOW_S:
            while rate_hz < LEAVE_BELOW * READ_PERIODS[self._level][0]:
                self._level -= 1
            self._window_start_s, self._pieces = now_s, 0
        return READ_PERIODS[self._level][1]


class LinkReader:
    """Calls `read_available()` when data can be read, or at the periods of `ReadPace`.

    A timer, and not the descriptor, starts the readings of a busy link, because a timer costs less.

    Args:
        read_available: reads everything that has arrived, and returns the number of pieces. If it raises,
            reading continues after `RETRY_S`.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        fileno: int,
        read_available: Callable[[], int],
        faults: FaultLog,
    ) -> None:
        self._faults = faults
        self._loop = loop
        self._fileno = fileno
        self._read_available = read_available
        self._pace = ReadPace()
        self._timer: asyncio.TimerHandle | None = None
        self._closed = False
        loop.add_reader(fileno, self._read)

    def _read(self) -> None:
        period_s = RETRY_S
        try:
            period_s = self._pace.period_s(self._read_available(), self._loop.time())
        except Exception as error:
            self._faults.add(error, "reading")
        if self._closed:
            return
        watched, self._timer = self._timer is None, None
        if period_s:
            if watched:
                self._loop.remove_reader(self._fileno)
            self._timer = self._loop.call_later(period_s, self._read)
        elif not watched:
            self._loop.add_reader(self._fileno, self._read)

    def close(self) -> None:
        """Stops reading; call before the descriptor is closed."""
        self._closed = True
        if self._timer is not None:
            self._timer.cancel()
        self._loop.remove_reader(self._fileno)


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
