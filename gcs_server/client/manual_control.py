"""Flying by stick from a program: stick positions 25 times a second while a block runs."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager, suppress
from typing import Any, Protocol

from websockets.asyncio.client import ClientConnection
from websockets.exceptions import ConnectionClosed

from gcs_server.client.errors import Unreachable, raise_problem
from gcs_server.client.setpoints import Body

PERIOD_S = 0.04
MIDDLE = 500.0
ON_CHANGE_S = 5.0


class VehicleApi(Protocol):
    """The part of a vehicle that this module uses."""

    async def socket(self, path: str) -> ClientConnection: ...


class Sticks:
    """The sticks of a vehicle; centred but for the time of a call of `fly`."""

    def __init__(self, socket: ClientConnection, phase: str) -> None:
        self._socket = socket
        self._message: Body = {}
        self._phase = phase
        self._reason: str | None = None
        self._changed = asyncio.Event()
        self.centre()
        self._running = asyncio.ensure_future(self._run())

    def state(self) -> dict[str, str | None]:
        """`phase` (`centre`, `flying`, `interrupted`, `off`), and the `reason` of the last two."""
        return {"phase": self._phase, "reason": self._reason}

    def centre(self) -> None:
        """Centres the sticks, with the throttle in its middle."""
        self._message = {"type": "sticks", "pitch": 0.0, "roll": 0.0, "throttle": MIDDLE, "yaw": 0.0}

    async def fly(
        self,
        *,
        for_s: float,
        pitch: float = 0.0,
        roll: float = 0.0,
        throttle: float = MIDDLE,
        yaw: float = 0.0,
    ) -> None:
        """Deflects the sticks for a time, then centres them.

        Args:
            for_s: the time [s].
            pitch: forward is positive, -1000 to 1000.
            roll: right is positive, -1000 to 1000.
            throttle: 0 to 1000; 500 is the middle.
            yaw: clockwise is positive, -1000 to 1000.

        Raises:
            Refused: another command has interrupted the sticks, or they have ended.
        """
        deflected: Body = {"type": "sticks", "pitch": pitch, "roll": roll, "throttle": throttle, "yaw": yaw}
        self._message = deflected
        try:
            end_s = asyncio.get_running_loop().time() + for_s
            while (left_s := end_s - asyncio.get_running_loop().time()) > 0:
                self._require_flying()
                await asyncio.sleep(min(PERIOD_S, left_s))
        finally:
            if self._message is deflected:
                self.centre()

    async def resume(self) -> None:
        """Goes on after a command has interrupted the sticks."""
        await self._socket.send(json.dumps({"type": "resume"}))
        await self.until_flying()

    async def until_flying(self) -> None:
        """Waits until the sticks act. Raises Refused: they have ended."""
        async with asyncio.timeout(ON_CHANGE_S):
            while self._phase != "flying":
                self._changed.clear()
                if self._phase == "off":
                    self._require_flying()
                await self._changed.wait()

    async def end(self) -> None:
        """Sends neutral sticks once, and no more."""
        self._running.cancel()
        self._phase = "off"
        with suppress(ConnectionClosed):
            await self._socket.send(json.dumps({"type": "end"}))

    def _require_flying(self) -> None:
        if self._phase in ("interrupted", "off"):
            raise_problem({"code": "refused", "detail": self._reason or "The sticks have ended."})

    async def _run(self) -> None:
        """Sends the positions until the socket closes."""
        async with asyncio.TaskGroup() as group:
            receiving = group.create_task(self._receive())
            while not receiving.done():
                try:
                    await self._socket.send(json.dumps(self._message))
                except ConnectionClosed:
                    break
                await asyncio.sleep(PERIOD_S)
        self._phase = "off"
        self._changed.set()

    async def _receive(self) -> None:
        try:
            async for text in self._socket:
                answer: dict[str, Any] = json.loads(text)
                if "phase" in answer:
                    self._phase, self._reason = answer["phase"], answer["reason"]
                    self._changed.set()
                elif "error" in answer:
                    self._reason = answer["error"]["detail"]
        except ConnectionClosed:
            return


@asynccontextmanager
async def sticks_of(vehicle: VehicleApi) -> AsyncGenerator[Sticks]:
    """See `Vehicle.manual_control`."""
    socket: ClientConnection = await vehicle.socket("/manual_control/stream")
    async with socket:
        try:
            first = json.loads(await socket.recv())
        except ConnectionClosed as error:
            raise Unreachable(f"The server closed the stream of stick positions: {error}.") from error
        if "error" in first:
            raise_problem(first["error"])
        sticks = Sticks(socket, first["phase"])
        try:
            await sticks.until_flying()
            yield sticks
        finally:
            await sticks.end()
