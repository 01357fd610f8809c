"""The two halves every descriptor-based link needs: frugal reading, and writing from any thread."""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import Callable

from gcs_server.faults import FaultLog

WAKE_INTERVAL_S = 0.005
"""A busy link is read no more often, then all there is; what comes after a pause is read at once."""
PACES = ((2000.0, 0.020), (500.0, 0.010))
"""(pieces a second, s between two reads): a fleet's link is read less often, for each wake costs as much as
reading dozens of pieces, and no page draws sooner."""
OUTBOX_LIMIT_BYTES = 512_000


def pace(pieces_per_s: float) -> float:
    """How long to wait before a link is read again [s]."""
    return next((wait_s for busy, wait_s in PACES if pieces_per_s >= busy), WAKE_INTERVAL_S)


class ThrottledReader:
    """Calls `drain()` when there is something to read, at the link's `pace`.

    While bytes keep coming the descriptor is not watched at all: a timer is cheaper than being woken.

    Args:
        drain: reads all there is; says how many pieces. Should it raise, reading goes on all the same.
    """

    def __init__(
        self, loop: asyncio.AbstractEventLoop, fileno: int, drain: Callable[[], int], faults: FaultLog
    ) -> None:
        self._faults = faults
        self._loop = loop
        self._fileno = fileno
        self._drain = drain
        self._timer: asyncio.TimerHandle | None = None
        self._waited_s = WAKE_INTERVAL_S
        self._closed = False
        loop.add_reader(fileno, self._readable)

    def _readable(self) -> None:
        self._loop.remove_reader(self._fileno)
        self._read()

    def _read(self) -> None:
        self._timer = None
        came = 1  # should it fail: to be read again soon, not at once
        try:
            came = self._drain()
        except Exception as error:
            self._faults.add(error, "reading")
        finally:
            if not self._closed:  # by what came
                self._again(came)

    def _again(self, came: int) -> None:
        if came:
            self._waited_s = pace(came / self._waited_s)
            self._timer = self._loop.call_later(self._waited_s, self._read)
        else:
            self._waited_s = WAKE_INTERVAL_S
            self._loop.add_reader(self._fileno, self._readable)

    def close(self) -> None:
        """Stops watching; call before the descriptor is closed."""
        self._closed = True
        if self._timer is not None:
            self._timer.cancel()
        self._loop.remove_reader(self._fileno)


class Outbox:
    """Whole frames to one non-blocking descriptor, from any thread; bounded, drops the newest.

    Args:
        write: writes some of the bytes and says how many; raises BlockingIOError where it would wait.
        failed: called in the loop when the descriptor is broken.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        fileno: int,
        write: Callable[[bytes], int],
        failed: Callable[[OSError], None],
    ) -> None:
        self._loop = loop
        self._fileno = fileno
        self._write = write
        self._failed = failed
        self._lock = threading.Lock()
        self._waiting: deque[bytes] = deque()
        self._waiting_bytes = 0
        self._closed = False

    def send(self, data: bytes) -> bool:
        """Writes now or queues; False: dropped."""
        with self._lock:
            if self._closed:
                return False
            if self._waiting:
                return self._queue(data)
            try:
                written = self._write(data)
            except BlockingIOError:
                written = 0
            except OSError as error:
                self._loop.call_soon_threadsafe(self._failed, error)
                return False
            if written < len(data):
                self._queue(data[written:], always=True)
                self._loop.call_soon_threadsafe(self._watch)
            return True

    def _queue(self, data: bytes, *, always: bool = False) -> bool:
        if not always and self._waiting_bytes + len(data) > OUTBOX_LIMIT_BYTES:
            return False
        self._waiting.append(data)
        self._waiting_bytes += len(data)
        return True

    def _watch(self) -> None:
        if not self._closed:
            self._loop.add_writer(self._fileno, self._writable)

    def _writable(self) -> None:
        with self._lock:
            try:
                while self._waiting:
                    data = self._waiting[0]
                    written = self._write(data)
                    self._waiting_bytes -= written
                    if written < len(data):
                        self._waiting[0] = data[written:]
                        return
                    self._waiting.popleft()
            except BlockingIOError:
                return
            except OSError as error:
                self._loop.call_soon(self._failed, error)
            self._loop.remove_writer(self._fileno)

    def close(self) -> None:
        """Drops what waits; call before the descriptor is closed. Afterwards `send` writes nothing."""
        with self._lock:
            self._closed = True
            self._waiting.clear()
        self._loop.remove_writer(self._fileno)
