"""Starts and monitors all background tasks; only this module catches all exceptions of a task.

A task that fails unexpectedly is logged and restarted with increasing delay. Only this module may start
tasks, so no task can fail unnoticed.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Coroutine
from typing import Any

from gcs_server.clock import Clock, until_next_s

log = logging.getLogger(__name__)

FIRST_BACK_OFF_S = 0.2
MAX_BACK_OFF_S = 5.0
HEALTHY_AFTER_S = 10.0
"""A task that ran for longer than this is restarted with the first delay again [s]."""
EQUAL_ERRORS_LOGGED = 5


class Supervisor:
    """All background tasks of the server.

    Args:
        clock: clock for the delays between restarts.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._tasks: dict[asyncio.Task[Any], str] = {}

    def start(self, name: str, work: Callable[[], Awaitable[None]]) -> asyncio.Task[None]:
        """Runs `work()` for the lifetime of the server; after a failure it is restarted with increasing
        delay. Work that returns is not run again. Cancel the returned task to stop it.
        """
        return self._create_task(self._supervised(name, work), name)

    def repeat(self, name: str, update: Callable[[], None], period_s: float) -> asyncio.Task[None]:
        """Calls `update()` at once, and at each multiple of a period [s]; a failure is handled as by
        `start`."""

        async def run() -> None:
            while True:
                update()
                await self._clock.sleep(until_next_s(self._clock, period_s))

        return self.start(name, run)

    def spawn(self, name: str, work: Coroutine[Any, Any, Any]) -> asyncio.Task[Any]:
        """Runs `work` once; a failure is logged, not raised."""
        task = self._create_task(self._run_once(name, work), name)
        task.add_done_callback(lambda _: work.close())  # if the task was cancelled before its start
        return task

    async def close(self) -> None:
        """Cancels all tasks and waits until they have ended."""
        current = asyncio.current_task()
        tasks = [task for task in self._tasks if task is not current]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def names(self) -> list[str]:
        """The names of the running tasks."""
        return sorted(self._tasks.values())

    def _create_task(self, work: Coroutine[Any, Any, Any], name: str) -> asyncio.Task[Any]:
        task: asyncio.Task[Any] = asyncio.create_task(work, name=name)  # noqa: TID251 only here
        self._tasks[task] = name
        task.add_done_callback(lambda done: self._tasks.pop(done, None))
        return task

    async def _run_once(self, name: str, work: Coroutine[Any, Any, Any]) -> None:
        try:
            await work
        except Exception:
            log.exception("%s failed", name)

    async def _supervised(self, name: str, work: Callable[[], Awaitable[None]]) -> None:
        back_off_s = FIRST_BACK_OFF_S
        last_error, equal_count = "", 0
        while True:
            started_s = self._clock.monotonic_s()
            try:
                await work()
                return
            except Exception as error:
                text = f"{type(error).__name__}: {error}"
                equal_count = equal_count + 1 if text == last_error else 1
                last_error = text
                if equal_count == 1:
                    log.exception("%s failed, starting it again", name)
                elif equal_count <= EQUAL_ERRORS_LOGGED:
                    log.warning("%s failed again (%d): %s", name, equal_count, text)
                    if equal_count == EQUAL_ERRORS_LOGGED:
                        log.warning("%s: further equal errors are not logged", name)
            if self._clock.monotonic_s() - started_s > HEALTHY_AFTER_S:
                back_off_s = FIRST_BACK_OFF_S
            await self._clock.sleep(back_off_s)
            back_off_s = min(back_off_s * 2, MAX_BACK_OFF_S)
