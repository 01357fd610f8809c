"""Time as a dependency, so that tests can simulate it."""

from __future__ import annotations

import asyncio
import math
import time
from typing import Protocol


class TimeSource(Protocol):
    """The current time, for code that does not wait."""

    def monotonic_s(self) -> float:
        """Monotonic time of the event loop [s]."""
        ...

    def unix_s(self) -> float:
        """Seconds since 1970 UTC, for display and files; this time may jump."""
        ...


class Clock(TimeSource, Protocol):
    """The clock of all code that waits, expires or repeats."""

    async def sleep(self, seconds: float) -> None:
        """Waits for `seconds`."""
        ...


def until_next_s(clock: TimeSource, period_s: float) -> float:
    """Time until the next multiple of a period [s]. What repeats waits for it, so that all of it wakes the
    event loop together: a wake costs more than most of what is done then."""
    now_s = clock.monotonic_s()
    # A timer may be early by the resolution of the clock, and must not run twice.
    return (math.floor(now_s / period_s + 0.01) + 1) * period_s - now_s


class SystemClock:
    """The system's time."""

    def monotonic_s(self) -> float:
        return time.monotonic()

    def unix_s(self) -> float:
        return time.time_ns() / 1e9

    async def sleep(self, seconds: float) -> None:
        await asyncio.sleep(seconds)


class LoopClock:
    """A clock that follows the time of an event loop, which may be simulated.

    Args:
        loop: the event loop; its `time()` is the monotonic time.
        unix_at_zero_s: value of `unix_s()` when the loop's time is 0.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, unix_at_zero_s: float = 1_700_000_000.0) -> None:
        self._loop = loop
        self._unix_at_zero_s = unix_at_zero_s

    def monotonic_s(self) -> float:
        return self._loop.time()

    def unix_s(self) -> float:
        return self._unix_at_zero_s + self._loop.time()

    async def sleep(self, seconds: float) -> None:
        await asyncio.sleep(seconds)
