"""Frugal reading, for every link that has a descriptor; writing is `writer.py`."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from gcs_server.faults import FaultLog

WAKE_INTERVAL_S = 0.005
"""A busy link is read no more often, then all there is; what comes after a pause is read at once."""
READ_AT_MOST_S = 0.02
"""A link is read no longer than this in one turn of the loop, whatever it takes to handle what comes. What is
left waits in the system's buffer, and what that cannot hold is lost on this link, not on the others."""
PACES = ((2000.0, 0.020), (500.0, 0.010))
"""(pieces a second, s between two reads): a fleet's link is read less often, for each wake costs as much as
reading dozens of pieces, and no page draws sooner."""


def pace(pieces_per_s: float) -> float:
    """Time to wait before a link is read again [s]."""
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
