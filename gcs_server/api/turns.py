"""Requests begin one after the other, each in a turn of the event loop of its own.

Two hundred requests that come in at once would otherwise be answered in one turn, and whatever else the loop
does would wait for all of them. Who waits is taken address by address, then client by client; clients in
control of a vehicle go first.
"""

from __future__ import annotations

import asyncio
from collections import OrderedDict, deque
from collections.abc import Callable

from gcs_server.control.client import Client

Waiting = deque[asyncio.Future[None]]


class Turns:
    """Of one server.

    Args:
        in_control: whether the client of this key controls a vehicle.
    """

    def __init__(self, in_control: Callable[[str], bool]) -> None:
        self._in_control = in_control
        self._taken = False
        self._first: Waiting = deque()
        self._addresses: OrderedDict[str, OrderedDict[str, Waiting]] = OrderedDict()

    async def wait(self, client: Client) -> None:
        """Returns when it is this client's turn: at once where nobody else had the present one."""
        if not self._taken:
            self._taken = True
            asyncio.get_running_loop().call_soon(self._next)
            return
        future: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        if self._in_control(client.key):
            self._first.append(future)
        else:
            clients = self._addresses.setdefault(client.address, OrderedDict())
            clients.setdefault(client.key, deque()).append(future)
        await future

    def _next(self) -> None:
        while True:
            future = self._pop()
            if future is None:
                self._taken = False
                return
            if not future.done():  # else its request was given up
                break
        future.set_result(None)
        # It runs in the next round of the loop, and whoever comes after it in the round after that.
        asyncio.get_running_loop().call_soon(self._next)

    def _pop(self) -> asyncio.Future[None] | None:
        if self._first:
            return self._first.popleft()
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
