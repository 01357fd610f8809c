"""Large setpoints, which the event loop itself reads: a path of 5000 points takes it a twentieth of a second.

Those of clients that control no vehicle are read one at a time, with pauses several times as long as the
reading, so that the loop is free most of the time.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager

from gcs_server.errors import ServerBusy
from gcs_server.operations.turns import CALLER, TurnLimits, Turns

LIMITS = TurnLimits(running=2, running_without_control=1, per_client=8, total=32)
PAUSE_S_PER_BYTE = 5e-7


class LargeSetpoints:
    """The order in which large setpoints are read.

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
