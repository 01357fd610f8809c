"""Starts requests one at a time, each in a separate iteration of the event loop.

Without this queue, the loop would serve hundreds of simultaneous requests in one iteration and delay all
other work. Clients in control of a vehicle come first, then known clients, then new clients. A client that
keeps changing its name therefore does not delay other clients. Within a priority, the queue alternates
between addresses, and between the clients of an address.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager

from gcs_server.control.principal import Principal
from gcs_server.errors import ServerBusy
from gcs_server.operations.turns import CALLER, FairQueue, TurnLimits, Turns

KNOWN_AFTER_S = 2.0
"""Time after a client's first request at which the client counts as known."""
FORGOTTEN_AFTER_S = 60.0
MAX_KNOWN_CLIENTS = 500


class RequestQueue:
    """The waiting requests of one server.

    Args:
        in_control: returns whether the client with a key controls a vehicle.
    """

    def __init__(self, in_control: Callable[[str], bool]) -> None:
        self.in_control = in_control
        self._next_is_scheduled = False
        self._queues = (FairQueue(), FairQueue(), FairQueue())
        """Requests of clients in control, of known clients and of new clients."""
        self._seen: dict[str, tuple[float, float]] = {}
        """Time of the first and the last request, by client key."""

    async def wait(self, client: Principal) -> None:
        """Returns when the request may start; immediately if no other request waits."""
        loop = asyncio.get_running_loop()
        is_known = self._record_request(client.key, loop.time())
        if not self._next_is_scheduled:
            self._next_is_scheduled = True
            loop.call_soon(self._next)
            return
        future: asyncio.Future[None] = loop.create_future()
        queue = self._queues[0 if self.in_control(client.key) else 1 if is_known else 2]
        queue.push(client.address, client.key, future)
        await future

    def _record_request(self, key: str, now_s: float) -> bool:
        """Records a request; returns whether the client is known. New clients never displace known ones."""
        if key not in self._seen and len(self._seen) >= MAX_KNOWN_CLIENTS:
            self._seen = {k: s for k, s in self._seen.items() if now_s - s[1] < FORGOTTEN_AFTER_S}
            if len(self._seen) >= MAX_KNOWN_CLIENTS:
                return False
        first_s = self._seen.get(key, (now_s, now_s))[0]
        self._seen[key] = (first_s, now_s)
        return now_s - first_s > KNOWN_AFTER_S

    def _next(self) -> None:
        while True:
            future = next((f for queue in self._queues if (f := queue.pop()) is not None), None)
            if future is None:
                self._next_is_scheduled = False
                return
            if not future.done():  # otherwise the request was cancelled
                break
        future.set_result(None)
        # This request runs in the next iteration of the loop, and the following request one iteration later.
        asyncio.get_running_loop().call_soon(self._next)


LIMITS = TurnLimits(running=2, running_without_control=1, per_client=8, total=32)
PAUSE_S_PER_BYTE = 5e-7


class LargeSetpoints:
    """The order in which large setpoints are read: the event loop itself reads them, and a path of 5000
    points takes it a twentieth of a second.

    Those of clients that control no vehicle are read one at a time, with pauses several times as long as the
    reading, so that the loop is free most of the time.

    Args:
        in_control: returns whether the client with a key controls a vehicle.
    """

    def __init__(self, in_control: Callable[[str], bool]) -> None:
        self._in_control = in_control
        self._turns = Turns(in_control, LIMITS)
        self._reading = False
        """Whether a setpoint of a client without control is being read."""
        self._next_s = 0.0
        """Earliest time to read the next one."""

    @asynccontextmanager
    async def turn(self, size: int, *, wait: bool = True) -> AsyncGenerator[None]:
        """Waits for the turn of the calling client to read a setpoint of `size` bytes.

        Raises:
            ClientHasTooMany, ServerBusy: too many are waiting; without `wait`, another is read first.
        """
        loop = asyncio.get_running_loop()
        if self._in_control(CALLER.get().key):
            async with self._turns.turn():
                yield
            return
        if not wait and (self._reading or loop.time() < self._next_s):
            raise ServerBusy(
                "Another large setpoint of a client without control is read first.",
                remedy="Send it again, or take control of the vehicle first.",
            )
        async with self._turns.turn():
            self._reading = True
            try:
                if loop.time() < self._next_s:
                    await asyncio.sleep(self._next_s - loop.time())
                yield
            finally:
                self._reading, self._next_s = False, loop.time() + size * PAUSE_S_PER_BYTE
