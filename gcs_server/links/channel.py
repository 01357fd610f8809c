"""Efficient reading for links with a file descriptor (writing: `writer.py`)."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from gcs_server.faults import FaultLog

WAKE_INTERVAL_S = 0.005
"""Minimum time between two reads of a busy link; bytes after a pause are read immediately [s]."""
MAX_READ_S = 0.02
"""Maximum time spent on one link per iteration of the event loop [s]. The remaining data wait in the system's
buffer; if it overflows, bytes are lost on this link only."""
READ_INTERVALS = ((2000.0, 0.020), (500.0, 0.010))
"""(minimum pieces per second, seconds between two reads). A piece is a datagram, or the bytes of one read. A
busy link is read less often, because each wake-up costs as much as reading dozens of pieces."""


def read_interval_s(pieces_per_s: float) -> float:
    """Time to wait before a link is read again [s]."""
    for min_rate, wait_s in READ_INTERVALS:
        if pieces_per_s >= min_rate:
            return wait_s
    return WAKE_INTERVAL_S


class ThrottledReader:
    """Calls `read_available()` when data can be read, at intervals of `read_interval_s`.

    While bytes keep arriving, a timer is used instead of watching the descriptor, because a timer costs less.

    Args:
        read_available: reads everything that has arrived, and returns the number of pieces. If it raises,
            reading continues.
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
        self._timer: asyncio.TimerHandle | None = None
        self._waited_s = WAKE_INTERVAL_S
        self._closed = False
        loop.add_reader(fileno, self._readable)

    def _readable(self) -> None:
        self._loop.remove_reader(self._fileno)
        self._read()

    def _read(self) -> None:
        self._timer = None
        pieces = 1  # if reading fails, read again after a short time
        try:
            pieces = self._read_available()
        except Exception as error:
            self._faults.add(error, "reading")
        finally:
            if not self._closed:
                self._schedule_read(pieces)

    def _schedule_read(self, pieces: int) -> None:
        if pieces:
            self._waited_s = read_interval_s(pieces / self._waited_s)
            self._timer = self._loop.call_later(self._waited_s, self._read)
        else:
            self._waited_s = WAKE_INTERVAL_S
            self._loop.add_reader(self._fileno, self._readable)

    def close(self) -> None:
        """Stops reading; call before the descriptor is closed."""
        self._closed = True
        if self._timer is not None:
            self._timer.cancel()
        self._loop.remove_reader(self._fileno)
