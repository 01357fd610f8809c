"""The server's messages to the process that flies the streams, and the answers that come back.

Whoever posts goes on at once; whoever asks awaits a future. The process is started when it is wanted, ended
when it takes nothing any more, and started again.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from gcs_server.clock import Clock
from gcs_server.streamer.process.handle import WORKER_GONE, Relay, WorkerHandle
from gcs_server.streamer.process.messages import Answer, Hello, Post, Request, Update

log = logging.getLogger(__name__)
T = TypeVar("T")

ANSWERS_WITHIN_S = 2.0
"""A process that takes nothing for so long counts as gone: the vehicles fail safe rather than fly on
unseen."""
LOOP_STALLED_S = 0.5
"""A loop that itself stood still for so long between two beats has not seen the process stand still."""
STARTED_AGAIN_AFTER_S = 1.0
"""No sooner after its last start is the process started again."""


class WorkerDied(Exception):
    """The process has gone, or does not answer."""


@dataclass(frozen=True, slots=True)
class _Asked:
    """A request that is not answered yet."""

    future: asyncio.Future[Any]
    then: Callable[[Any], None] | None
    """Called with the answer, even where nobody awaits it any more."""


class WorkerCalls:
    """All runs of the process, one after the other.

    Args:
        clock: the machine's.
        own_ids: system and component id of what is sent.
        silent_limit_s: the loop's silence after which sending stops.
        on_update: gets what the process says of the streams.
        on_gone: called when the process has ended or does not answer; what was asked of it fails afterwards.
        relay: sends what the process cannot; called in a thread.
    """

    def __init__(
        self,
        clock: Clock,
        own_ids: tuple[int, int],
        silent_limit_s: float,
        on_update: Callable[[Update], None],
        on_gone: Callable[[], None],
        relay: Relay,
    ) -> None:
        self._clock = clock
        self._own_ids = own_ids
        self._silent_limit_s = silent_limit_s
        self._on_update, self._on_gone, self._relay = on_update, on_gone, relay
        self._asked: dict[int, _Asked] = {}
        self._started_s = self._beat_s = self._silent_since_s = float("-inf")
        self.worker: WorkerHandle | None = None
        """The run that there is now."""

    def spawn(self) -> None:
        """Starts the process where there is none; not again and again without a pause."""
        now_s = self._clock.monotonic_s()
        if self.worker is not None or now_s - self._started_s < STARTED_AGAIN_AFTER_S:
            return
        self._started_s = now_s
        try:
            self.worker = WorkerHandle(
                self._own_ids, self._silent_limit_s, self._heard, self._gone, self._relay
            )
        except OSError:  # no descriptor left: tried again with a later beat
            log.exception("the process that flies setpoint streams could not be started")

    def close(self) -> None:
        """Ends it; what was asked of it fails."""
        worker, self.worker = self.worker, None
        if worker is not None:
            worker.end()
        self._fail_all()

    def judge(self) -> None:
        """With each beat: ends a process that takes nothing, unless it was the loop that stood still."""
        now_s = self._clock.monotonic_s()
        stalled, self._beat_s = now_s - self._beat_s > LOOP_STALLED_S, now_s
        worker = self.worker
        if worker is None or not worker.up or not worker.owes:
            return
        if stalled:
            self._silent_since_s = now_s
        worker.read()
        if self.worker is worker and worker.owes and now_s - self._silent_since_s >= ANSWERS_WITHIN_S:
            self._gone()

    def post(self, message: Post | Request[Any]) -> int:
        """Sends without waiting; the message's number, 0 where there is no process."""
        worker = self.worker
        if worker is None:
            return 0
        if not worker.owes:
            self._silent_since_s = self._clock.monotonic_s()
        try:
            return worker.send(message)
        except WORKER_GONE:
            self._gone()
            return 0

    def request(self, message: Request[T], then: Callable[[T], None] | None = None) -> asyncio.Future[T]:
        """Sends at once; the future gets the answer, or WorkerDied.

        Args:
            message: what is asked.
            then: called with the answer as it comes, even where the future was cancelled.
        """
        future: asyncio.Future[T] = asyncio.get_running_loop().create_future()
        number = self.post(message)
        if number:
            self._asked[number] = _Asked(future, then)
        else:
            future.set_exception(WorkerDied())
        return future

    async def answer(self, future: asyncio.Future[T]) -> T:
        """Waits for it; a process that does not give one in time is ended.

        Raises:
            WorkerDied: there is none.
            ValueError: what was asked for cannot be.
            RuntimeError: it failed otherwise; the process has logged how.
        """
        try:
            await asyncio.wait({future}, timeout=ANSWERS_WITHIN_S)
        except asyncio.CancelledError:
            future.cancel()
            raise
        if not future.done():
            self._gone()
        return await future

    def _heard(self, value: object) -> None:
        if isinstance(value, Update):
            if self.worker is not None and self.worker.handled(value.handled):
                self._silent_since_s = self._clock.monotonic_s()
            self._on_update(value)
        elif isinstance(value, Answer):
            self._answered(value)
        elif isinstance(value, Hello) and self.worker is not None:
            self.worker.up = True
            if not value.real_time:
                log.info("setpoint streams have no real-time priority: see docs/performance.md")

    def _answered(self, answer: Answer) -> None:
        asked = self._asked.pop(answer.number, None)
        if asked is None:
            return
        if answer.error is None and asked.then is not None:
            asked.then(answer.result)
        if asked.future.done():
            return
        if answer.error is None:
            asked.future.set_result(answer.result)
        else:
            name, text = answer.error
            asked.future.set_exception(ValueError(text) if name == "ValueError" else RuntimeError(text))

    def _gone(self) -> None:
        worker, self.worker = self.worker, None
        if worker is None:
            return
        log.error("the process that flies setpoint streams (%s) ended", worker.pid)
        worker.kill()
        self._on_gone()
        self._fail_all()

    def _fail_all(self) -> None:
        asked, self._asked = self._asked, {}
        for each in asked.values():
            if not each.future.done():
                each.future.set_exception(WorkerDied())
