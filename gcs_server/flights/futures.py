"""Futures of a command that is about to be sent: its flights in simulation, from the vehicle's present state.

Nothing is sent to a vehicle, and no command waits for this. One process at a time flies futures, at a low
priority; a newer request of a client replaces its older one.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable

from gcs_server.errors import GcsError, Refused
from gcs_server.flights.futures_task import PROBLEM, SOLVED, FuturesTask
from gcs_server.operations.fork_server import ForkServer
from gcs_server.operations.process import WorkerFailed
from gcs_server.operations.turns import TurnLimits, Turns
from gcs_server.plans import typed_values

COMMAND = (sys.executable, "-m", "gcs_server.flights.futures_worker")
MAX_RESULT_BYTES = 1024 * 1024
LIMITS = TurnLimits(running=1, running_without_control=1, per_client=2, total=8)
"""One flies, and one of each client may wait."""


class FuturesWork:
    """The futures of one server.

    Args:
        in_control: returns whether the client with a key controls a vehicle; its futures come first.
    """

    def __init__(self, in_control: Callable[[str], bool] = lambda _: False) -> None:
        self._processes = ForkServer(COMMAND, MAX_RESULT_BYTES)
        self._turns = Turns(in_control, LIMITS)
        self._newest: dict[str, asyncio.Task[None]] = {}
        """Running or waiting futures by client."""

    async def fly(self, task: FuturesTask, client_key: str) -> bytes:
        """Flies futures; the result as JSON. If the caller is cancelled, the process ends.

        Args:
            task: what is flown.
            client_key: identifies the client.

        Raises:
            Refused: the vehicle's parameters describe no aircraft, a newer request of this client replaced
                this one, or the process failed.
            ServerBusy: too many clients are waiting.
        """
        older = self._newest.pop(client_key, None)
        if older is not None:
            older.cancel()
        answers, errors = list[bytes](), list[GcsError]()

        async def run() -> None:
            try:
                answers.append(await self._run(task))
            except GcsError as problem:
                errors.append(problem)

        async with asyncio.TaskGroup() as tasks:
            work = self._newest[client_key] = tasks.create_task(run())
            try:
                await asyncio.wait({work})
            finally:
                if self._newest.get(client_key) is work:
                    del self._newest[client_key]
        if errors:
            raise errors[0]
        if not answers:
            raise Refused(
                "A newer request of this client has replaced this one.", remedy="Use the answer of the newer."
            )
        return answers[0]

    async def _run(self, task: FuturesTask) -> bytes:
        request = await asyncio.to_thread(typed_values.to_bytes, task)
        async with self._turns.turn():
            try:
                answer = await self._processes.run(request)
            except WorkerFailed as error:
                raise Refused(
                    f"The futures could not be flown: {error}",
                    remedy="Try again; ask for fewer flights or a shorter time if this happens again.",
                ) from error
        text = answer[1:]
        if answer[:1] == PROBLEM:
            raise Refused(
                f"The futures could not be flown: {text.decode()}",
                remedy="Correct the parameters or the setpoint that the error names.",
            )
        assert answer[:1] == SOLVED
        return text

    def close(self) -> None:
        """Ends the processes."""
        self._processes.close()
