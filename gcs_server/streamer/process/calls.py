"""Calls methods in the stream process. `post` returns immediately; `request` returns a future. The server
starts the process when it is needed, and kills and restarts it if it stops reading.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Concatenate, ParamSpec, TypeVar

from gcs_server.clock import Clock
from gcs_server.streamer.process.handle import SEND_ERRORS, OnRelay, WorkerHandle
from gcs_server.streamer.process.messages import Answer, Update, WorkerStarted

log = logging.getLogger(__name__)
T = TypeVar("T")
P = ParamSpec("P")

ANSWER_TIMEOUT_S = 2.0
"""Time after which a process that does not read is killed [s]; the vehicles' failsafes then take over."""
LOOP_STALLED_S = 0.5
"""If the event loop itself stalled for this long, the process is not checked [s]."""
RESTART_PERIOD_S = 1.0
"""Minimum time between two starts of the process [s]."""


class WorkerDied(Exception):
    """The process has died, or does not answer."""


@dataclass(frozen=True, slots=True)
class _PendingRequest:
    """A call that has no answer yet."""

    future: asyncio.Future[Any]
    on_answer: Callable[[Any], None] | None
    """Called with the answer, even if the future was cancelled."""


class WorkerCalls:
    """Starts the process, restarts it, and calls its methods.

    Args:
        clock: the system's monotonic clock.
        own_ids: system and component id of the sent messages.
        server_silent_limit_s: time without a message from the event loop after which sending stops.
        on_update: called with each update from the process.
        on_end: called when the process has ended or does not answer; pending requests fail afterwards.
        relay: sends setpoints that the process cannot send; called in a thread.
    """

    def __init__(
        self,
        clock: Clock,
        own_ids: tuple[int, int],
        server_silent_limit_s: float,
        on_update: Callable[[Update], None],
        on_end: Callable[[], None],
        relay: OnRelay,
    ) -> None:
        self._clock = clock
        self._own_ids = own_ids
        self._server_silent_limit_s = server_silent_limit_s
        self._on_update, self._on_end, self._relay = on_update, on_end, relay
        self._pending: dict[int, _PendingRequest] = {}
        self._started_s = self._checked_s = self._last_progress_s = float("-inf")
        """Times of the last start, of the last check, and of the last sign that the process executes calls
        [s, monotonic]."""
        self.worker: WorkerHandle | None = None
        """The running process; None if there is no process."""

    def spawn(self) -> None:
        """Starts the process if there is none, at most once per `RESTART_PERIOD_S`."""
        now_s = self._clock.monotonic_s()
        if self.worker is not None or now_s - self._started_s < RESTART_PERIOD_S:
            return
        self._started_s = now_s
        try:
            self.worker = WorkerHandle(
                self._own_ids, self._server_silent_limit_s, self._handle_value, self._drop_worker, self._relay
            )
        except OSError:  # no free file descriptor; the next update tries again
            log.exception("the setpoint streams' process could not be started")

    def close(self) -> None:
        """Ends the process; pending requests fail."""
        worker, self.worker = self.worker, None
        if worker is not None:
            worker.end()
        self._fail_all()

    def check_alive(self) -> None:
        """Kills a process that has stopped reading, unless the event loop itself stalled; called
        periodically."""
        now_s = self._clock.monotonic_s()
        loop_stalled, self._checked_s = now_s - self._checked_s > LOOP_STALLED_S, now_s
        worker = self.worker
        if worker is None or not worker.started or not worker.has_unhandled_calls:
            return
        if loop_stalled:
            self._last_progress_s = now_s
        worker.read()
        if (
            self.worker is worker
            and worker.has_unhandled_calls
            and now_s - self._last_progress_s >= ANSWER_TIMEOUT_S
        ):
            self._drop_worker()

    def post(
        self, method: Callable[Concatenate[Any, P], object], *arguments: P.args, **named: P.kwargs
    ) -> int:
        """Calls a method without waiting; returns the call's number; 0: there is no process."""
        return self._send(method, None, arguments, named)

    def request(
        self,
        method: Callable[Concatenate[Any, P], T],
        states_of: tuple[str, ...],
        on_answer: Callable[[T], None] | None,
        *arguments: P.args,
        **named: P.kwargs,
    ) -> asyncio.Future[T]:
        """Calls a method immediately; the future receives its result, or WorkerDied.

        Args:
            method: the method, of its class.
            states_of: vehicles whose state is updated before the answer.
            on_answer: called with the result when it arrives, even if the future was cancelled.
            arguments: the method's arguments.
            named: the method's named arguments.
        """
        future: asyncio.Future[T] = asyncio.get_running_loop().create_future()
        number = self._send(method, states_of, arguments, named)
        if number:
            self._pending[number] = _PendingRequest(future, on_answer)
        else:
            future.set_exception(WorkerDied())
        return future

    def _send(
        self,
        method: Callable[..., object],
        states_of: tuple[str, ...] | None,
        arguments: tuple[object, ...],
        named: dict[str, object],
    ) -> int:
        worker = self.worker
        if worker is None:
            return 0
        if not worker.has_unhandled_calls:
            self._last_progress_s = self._clock.monotonic_s()
        try:
            return worker.send(method.__qualname__, arguments, named, states_of)
        except SEND_ERRORS:
            self._drop_worker()
            return 0

    async def wait_for_answer(self, future: asyncio.Future[T]) -> T:
        """Waits for the answer to a request; a process that does not answer in time is killed.

        Raises:
            WorkerDied: there is no process.
            ValueError: the process cannot execute the request.
            RuntimeError: another failure, which the process has logged.
        """
        try:
            await asyncio.wait({future}, timeout=ANSWER_TIMEOUT_S)
        except asyncio.CancelledError:
            future.cancel()
            raise
        if not future.done():
            self._drop_worker()
        return await future

    async def result_or_false(self, future: asyncio.Future[bool]) -> bool:
        """Like `wait_for_answer`; False if there is no process."""
        try:
            return await self.wait_for_answer(future)
        except WorkerDied:
            return False

    def _handle_value(self, value: object) -> None:
        if isinstance(value, Update):
            if self.worker is not None and self.worker.record_handled(value.last_handled):
                self._last_progress_s = self._clock.monotonic_s()
            self._on_update(value)
        elif isinstance(value, Answer):
            self._handle_answer(value)
        elif isinstance(value, WorkerStarted) and self.worker is not None:
            self.worker.started = True
            if not value.real_time:
                log.info("setpoint streams run without real-time priority: see docs/performance.md")

    def _handle_answer(self, answer: Answer) -> None:
        pending = self._pending.pop(answer.number, None)
        if pending is None:
            return
        if answer.error is None and pending.on_answer is not None:
            pending.on_answer(answer.result)
        if pending.future.done():
            return
        if answer.error is None:
            pending.future.set_result(answer.result)
        else:
            name, text = answer.error
            pending.future.set_exception(ValueError(text) if name == "ValueError" else RuntimeError(text))

    def _drop_worker(self) -> None:
        worker, self.worker = self.worker, None
        if worker is None:
            return
        log.error("the setpoint streams' process (%s) ended", worker.pid)
        worker.kill()
        self._on_end()
        self._fail_all()

    def _fail_all(self) -> None:
        pending, self._pending = self._pending, {}
        for each in pending.values():
            if not each.future.done():
                each.future.set_exception(WorkerDied())
