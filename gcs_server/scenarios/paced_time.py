"""Time of an event loop that runs faster or slower than real time, for programs of other processes."""

from __future__ import annotations

import asyncio
import selectors
import time
from typing import Any


class PacedTimeLoop(asyncio.SelectorEventLoop):
    """An event loop whose clock runs at a multiple of real time.

    Args:
        speed: seconds of the loop in a real second.
    """

    def __init__(self, speed: float) -> None:
        selector = selectors.DefaultSelector()
        real_select = selector.select
        self._speed, self._began_s = speed, time.monotonic()

        def select(timeout: float | None = None) -> Any:
            return real_select(None if timeout is None else timeout / speed)

        selector.select = select  # type: ignore[method-assign]
        super().__init__(selector)

    def time(self) -> float:
        return self._began_s + (time.monotonic() - self._began_s) * self._speed
