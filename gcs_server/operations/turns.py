"""A fair order for the work of several clients, so that the work of one client waits behind that of
others."""

from __future__ import annotations

import asyncio
from collections import Counter, OrderedDict, deque
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from contextvars import ContextVar
from dataclasses import dataclass

from gcs_server.errors import ClientHasTooMany, ServerBusy

_Futures = deque[asyncio.Future[None]]


@dataclass(frozen=True, slots=True)
class Caller:
    """The client that work is done for."""

    key: str
    """Identifies the client; empty: the server itself."""
    address: str = ""


CALLER: ContextVar[Caller] = ContextVar("caller", default=Caller(""))  # noqa: B039 the default is frozen
"""The client of the request that is being answered."""


class FairQueue:
    """Waiting futures. `pop` alternates between addresses, and between the clients of an address."""

    def __init__(self) -> None:
        self._addresses: OrderedDict[str, OrderedDict[str, _Futures]] = OrderedDict()

    def push(self, address: str, key: str, future: asyncio.Future[None]) -> None:
        """Adds a future of a client."""
        clients = self._addresses.setdefault(address, OrderedDict())
        clients.setdefault(key, deque()).append(future)

    def pop(self) -> asyncio.Future[None] | None:
        """Removes the next future; None: the queue is empty."""
        if not self._addresses:
            return None
        address, clients = self._addresses.popitem(last=False)
        key, waiting = clients.popitem(last=False)
        future = waiting.popleft()
        if waiting:
            clients[key] = waiting
        if clients:
            self._addresses[address] = clients
        return future


@dataclass(frozen=True, slots=True)
class TurnLimits:
    """Maximum numbers of tasks. A client in control of a vehicle is only limited by `per_client`."""

    running: int = 3
    """Tasks that run at a time."""
    running_without_control: int = 2
    """Of these, tasks of clients that control no vehicle; a small computer has two cores."""
    per_client: int = 8
    """Running and waiting tasks of one client."""
    total: int = 32
    """Running and waiting tasks of all clients."""


class Turns:
    """Lets tasks run in a fair order: first those of clients in control of a vehicle.

    Args:
        in_control: returns whether the client with a key controls a vehicle; the server itself does.
        limits: maximum numbers of tasks.
    """

    def __init__(self, in_control: Callable[[str], bool], limits: TurnLimits) -> None:
        self._in_control = in_control
        self._limits = limits
        self._pending: Counter[str] = Counter()
        """Running and waiting tasks by client."""
        self._running = 0
        self._running_without_control = 0
        self._queues = (FairQueue(), FairQueue())
        """Tasks of clients in control, and of others."""

    @asynccontextmanager
    async def turn(self) -> AsyncGenerator[None]:
        """Waits for a turn of the calling client, which ends with the block.

        Raises:
            ClientHasTooMany: too many tasks of this client are running or waiting.
            ServerBusy: too many tasks are waiting.
        """
        caller = CALLER.get()
        controls = not caller.key or self._in_control(caller.key)
        self._require_room(caller.key, controls)
        self._pending[caller.key] += 1
        try:
            await self._wait(caller, controls)
            try:
                yield
            finally:
                self._end_turn(controls)
        finally:
            self._pending[caller.key] -= 1
            if not self._pending[caller.key]:
                del self._pending[caller.key]

    def _require_room(self, key: str, controls: bool) -> None:
        if key and self._pending[key] >= self._limits.per_client:
            raise ClientHasTooMany(
                f"{self._limits.per_client} tasks of this client are still running or waiting.",
                remedy="Wait for their responses, then try again.",
            )
        if not controls and self._pending.total() >= self._limits.total:
            raise ServerBusy(
                f"{self._limits.total} tasks of other clients are still running or waiting.",
                remedy="Try again in a moment. A client in control of a vehicle is served.",
            )

    async def _wait(self, caller: Caller, controls: bool) -> None:
        if self._is_free(controls):
            self._begin_turn(controls)
            return
        future: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._queues[0 if controls else 1].push(caller.address, caller.key, future)
        try:
            await future
        except asyncio.CancelledError:
            if future.done() and not future.cancelled():
                self._end_turn(controls)  # the turn had begun
            raise

    def _is_free(self, controls: bool) -> bool:
        if self._running >= self._limits.running:
            return False
        return controls or self._running_without_control < self._limits.running_without_control

    def _begin_turn(self, controls: bool) -> None:
        self._running += 1
        self._running_without_control += not controls

    def _end_turn(self, controls: bool) -> None:
        self._running -= 1
        self._running_without_control -= not controls
        for queue, with_control in zip(self._queues, (True, False), strict=True):
            while self._is_free(with_control) and (future := queue.pop()) is not None:
                if not future.done():  # otherwise its caller was cancelled
                    self._begin_turn(with_control)
                    future.set_result(None)
