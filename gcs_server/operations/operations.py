"""Operations: long-running work that is started by a request. All clients can follow it, and clients with the
permission can cancel it. An operation is an asyncio task with a status. It does not depend on a connection,
so that a reloaded page or a reconnected client finds it again. It ends when:

- its work returns (`succeeded`, with a small result) or raises an exception (`failed`, with the error);
- a client cancels it (`cancelled`, once the work has cleaned up);
- it is a command to a vehicle, and its ticket is cancelled (`cancelled`, with the reason as its error);
- its work needs the vehicle, and the vehicle is lost or removed (`failed`, with the work's own error, or with
`disconnected` after `LINK_GRACE_S`);
- the server stops (`cancelled`). Operations are lost in a restart.

At most `MAX_RUNNING` operations run at a time, and not all of one client; commands do not count. The newest
`MAX_ENDED` ended operations are kept, and as many ended commands.
"""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Callable, Coroutine
from dataclasses import dataclass, replace
from typing import Any, Literal

from gcs_server.clock import Clock
from gcs_server.errors import (
    ClientHasTooMany,
    Disconnected,
    GcsError,
    Interrupted,
    Refused,
    UnknownOperation,
)
from gcs_server.supervise import Supervisor

log = logging.getLogger(__name__)

MAX_RUNNING = 20
MAX_RUNNING_PER_CLIENT = 16
LINK_GRACE_S = 1.0
"""Time after a vehicle was lost until its work is stopped [s]. Until then, the work can fail with its own
error."""
MAX_RESULT_LENGTH = 16_384
"""Maximum size of a result as JSON [characters]."""
MAX_ENDED = 50
MAX_TEXT_LENGTH = 300
PROGRESS_PERIOD_S = 0.2
"""Minimum time between two progress events of an operation [s]; the end is reported immediately."""

State = Literal["running", "succeeded", "failed", "cancelled"]
ReportProgress = Callable[[str, float | None], None]
"""Reports progress: (a sentence about the current work; the fraction done, 0 to 1, None: unknown)."""
Work = Callable[[ReportProgress], Coroutine[Any, Any, dict[str, object] | None]]
"""The work of an operation. It returns a small result; a large result has its own route."""


@dataclass(frozen=True, slots=True)
class Operation:
    """The state of one operation."""

    id: str
    """Id, unique until the server restarts."""
    kind: str
    """Kind of work: `parameters/read`, `recording/index`."""
    vehicle: str | None
    """The vehicle's id; null: no vehicle."""
    subject: str | None
    """The object of the work besides the vehicle, such as a recording's name."""
    client: str
    """Name of the client that started the operation."""
    client_key: str
    """Distinguishes clients with the same name."""
    state: State
    progress: float | None
    """Progress, 0 to 1; null: not known."""
    text: str
    """The current work, or how the operation ended."""
    started_unix_s: float
    """Start time [s since 1970 UTC]."""
    ended_unix_s: float | None
    """End time [s since 1970 UTC]; null while the operation runs."""
    result: dict[str, object] | None
    """The result; null unless the operation succeeded."""
    error: GcsError | None
    """Why the operation failed."""


@dataclass(slots=True)
class _RunningOperation:
    task: asyncio.Task[Any]
    ended: asyncio.Event
    needs_vehicle: bool
    reported_s: float
    """Time of the last progress event [s, monotonic]."""
    stop_error: GcsError | None = None
    """Error with which the operation is being stopped; None: the operation is cancelled or still running."""


class Operations:
    """All operations of one server.

    Args:
        clock: the server's clock.
        supervisor: owns the tasks.
        on_change: called with each change of an operation.
    """

    def __init__(self, clock: Clock, supervisor: Supervisor, on_change: Callable[[Operation], None]) -> None:
        self._clock = clock
        self._supervisor = supervisor
        self._on_change = on_change
        self._count = 0
        self._known: dict[str, Operation] = {}
        """Ended operations in the order of their ends, and running operations in the order of their
        starts."""
        self._running: dict[str, _RunningOperation] = {}
        self._commands: set[str] = set()
        """Ids of the operations that are commands to a vehicle."""
        self._closed = False

    def all(self) -> list[Operation]:
        """Running operations, and operations that ended recently; oldest first."""
        return list(self._known.values())

    def get(self, operation_id: str) -> Operation:
        """One operation.

        Raises:
            UnknownOperation: there is no such operation, or it was dropped.
        """
        operation = self._known.get(operation_id)
        if operation is None:
            raise UnknownOperation(
                f"There is no operation {operation_id!r}.",
                remedy=f"GET /operations lists them; the last {MAX_ENDED} that ended are kept.",
            )
        return operation

    def start(
        self,
        kind: str,
        work: Work,
        *,
        text: str,
        vehicle: str | None = None,
        subject: str | None = None,
        by: tuple[str, str] = ("server", ""),
        needs_vehicle: bool = False,
        command: bool = False,
    ) -> Operation:
        """Starts work in the background. If an operation with the same kind, vehicle and subject is running,
        returns that operation, unless the new one is a command.

        Args:
            kind: kind of the work.
            work: called with a function to report progress; cancelled by `asyncio.CancelledError`.
            text: text until the first progress report.
            vehicle: id of the vehicle, if there is one.
            subject: the object of the work besides the vehicle.
            by: name and key of the client.
            needs_vehicle: whether the operation fails when the vehicle's link is lost.
            command: whether the work is a command to a vehicle, which is never refused or merged with
                another.

        Raises:
            ClientHasTooMany: too many operations of this client are running.
            Refused: the limit of running operations is reached, or the server is shutting down.
        """
        for operation_id in () if command else self._running:
            existing = self._known[operation_id]
            if (existing.kind, existing.vehicle, existing.subject) == (kind, vehicle, subject):
                return existing
        if self._closed:
            raise Refused("The server is shutting down; it starts no more operations.")
        counted = [self._known[each] for each in self._running if each not in self._commands]
        if not command and sum(each.client_key == by[1] != "" for each in counted) >= MAX_RUNNING_PER_CLIENT:
            raise ClientHasTooMany(
                f"{MAX_RUNNING_PER_CLIENT} operations of this client are running.",
                remedy="Wait until one has ended, or cancel one (DELETE /operations/{id}).",
            )
        if not command and len(counted) >= MAX_RUNNING:
            raise Refused(
                f"{MAX_RUNNING} operations are running, which is the limit.",
                remedy="Wait until one has ended, or cancel one (DELETE /operations/{id}).",
            )
        self._count += 1
        operation_id = str(self._count)
        unix_s = self._clock.unix_s()
        name, key = by
        operation = Operation(
            operation_id, kind, vehicle, subject, name, key, "running", None, text, unix_s, None, None, None
        )
        self._known[operation_id] = operation
        if command:
            self._commands.add(operation_id)
        task = self._supervisor.spawn(f"operation {operation_id}: {kind}", self._run(operation_id, work))
        self._running[operation_id] = _RunningOperation(
            task, asyncio.Event(), needs_vehicle, self._clock.monotonic_s()
        )
        task.add_done_callback(lambda _: self._end_not_started(operation_id))
        self._on_change(operation)
        return operation

    async def wait(self, operation_id: str) -> Operation:
        """Waits for the end of an operation; cancelling the wait does not end the operation.

        Raises:
            UnknownOperation: there is no such operation.
            GcsError: the error of the operation.
        """
        operation = self.get(operation_id)
        running = self._running.get(operation_id)
        if running is not None:
            await running.ended.wait()
            operation = self._known.get(operation_id, operation)
        if operation.error is not None:
            raise operation.error
        return operation

    async def cancel(self, operation_id: str) -> Operation:
        """Cancels an operation, and returns once its work has cleaned up; does nothing if it has ended.

        Raises:
            UnknownOperation: there is no such operation.
        """
        operation = self.get(operation_id)
        running = self._running.get(operation_id)
        if running is None:
            return operation
        running.task.cancel()
        await running.ended.wait()
        return self._known.get(operation_id, operation)

    def interrupt(self, operation_id: str, error: Interrupted) -> None:
        """Cancels an operation whose command must not act any more; its waiting caller gets the error. Does
        nothing if it has ended."""
        running = self._running.get(operation_id)
        if running is not None:
            running.stop_error = error
            running.task.cancel()

    def vehicle_lost(self, vehicle_id: str, reason: str) -> None:
        """Called when the vehicle's link is lost or the vehicle is removed; operations that need the vehicle
        fail."""
        affected = [
            running
            for operation_id, running in self._running.items()
            if running.needs_vehicle and self._known[operation_id].vehicle == vehicle_id
        ]
        if affected:
            self._supervisor.spawn("operations of a lost vehicle", self._fail(affected, vehicle_id, reason))

    async def close(self) -> None:
        """Cancels all operations, waits for them, and refuses new ones."""
        self._closed = True
        running = list(self._running.values())
        for entry in running:
            entry.task.cancel()
        for entry in running:
            await entry.ended.wait()

    # --- internal -------------------------------------------------------------------------------------

    async def _fail(self, affected: list[_RunningOperation], vehicle_id: str, reason: str) -> None:
        await self._clock.sleep(LINK_GRACE_S)
        for running in affected:
            if not running.ended.is_set():
                running.stop_error = Disconnected(f"Vehicle {vehicle_id} was lost: {reason}")
                running.task.cancel()

    async def _run(self, operation_id: str, work: Work) -> None:
        try:
            result = await work(lambda text, progress: self._report(operation_id, text, progress))
            if len(json.dumps(result)) > MAX_RESULT_LENGTH:
                raise ValueError("the result is too large")
        except asyncio.CancelledError:
            error = self._running[operation_id].stop_error
            if error is not None:
                self._end(operation_id, _state_of(error), str(error), error=error)
            else:
                reason = "The server stopped." if self._closed else "Cancelled."
                self._end(operation_id, "cancelled", reason)
            raise
        except GcsError as error:
            self._end(operation_id, _state_of(error), str(error), error=error)
        except Exception as error:
            log.exception("operation %s failed", operation_id)
            text = f"The server failed: {type(error).__name__}."
            self._end(operation_id, "failed", text, error=GcsError(text, remedy="See the server's log."))
        else:
            self._end(operation_id, "succeeded", "Done.", result=result)

    def _end_not_started(self, operation_id: str) -> None:
        """Ends an operation whose task was cancelled before `_run` began; otherwise `_run` has ended it."""
        if operation_id in self._running:
            error = self._running[operation_id].stop_error
            state: State = "cancelled" if error is None else _state_of(error)
            self._end(operation_id, state, "Cancelled." if error is None else str(error), error=error)

    def _report(self, operation_id: str, text: str, progress: float | None) -> None:
        running = self._running.get(operation_id)
        if running is None:
            return
        fraction = None if progress is None else min(1.0, max(0.0, progress))
        operation = replace(self._known[operation_id], text=text[:MAX_TEXT_LENGTH], progress=fraction)
        self._known[operation_id] = operation
        now_s = self._clock.monotonic_s()
        if now_s - running.reported_s >= PROGRESS_PERIOD_S:
            running.reported_s = now_s
            self._on_change(operation)

    def _end(
        self,
        operation_id: str,
        state: State,
        text: str,
        *,
        result: dict[str, object] | None = None,
        error: GcsError | None = None,
    ) -> None:
        running = self._running.pop(operation_id)
        ended = replace(
            self._known.pop(operation_id),
            state=state,
            text=text[:MAX_TEXT_LENGTH],
            ended_unix_s=self._clock.unix_s(),
            result=result,
            error=error,
        )
        if state == "succeeded":
            ended = replace(ended, progress=1.0)
        # Added at the end, because operations are dropped in the order in which they ended.
        self._known[operation_id] = ended
        is_command = operation_id in self._commands
        ended_ids = [
            key for key in self._known if key not in self._running and (key in self._commands) == is_command
        ]
        for key in ended_ids[: max(0, len(ended_ids) - MAX_ENDED)]:
            del self._known[key]
            self._commands.discard(key)
        running.ended.set()
        self._on_change(ended)


def _state_of(error: GcsError) -> State:
    return "cancelled" if isinstance(error, Interrupted) else "failed"
