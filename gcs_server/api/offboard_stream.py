"""Setpoints over a WebSocket at up to 100 Hz; each is answered with the applied setpoint.

Only the newest waiting setpoint is sent; older ones are answered `superseded`. If a client does not read its
answers, the oldest are dropped. Closing the socket does not stop the stream: it continues until the setpoint
expires.
"""

from __future__ import annotations

import asyncio
import json
from collections import deque
from typing import Any, Protocol, cast

from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, ValidationError

from gcs_server.api.authorized import authorized_command
from gcs_server.api.bodies import json_fault
from gcs_server.api.problems import validation_errors
from gcs_server.api.setpoint_request import SetpointRequest
from gcs_server.api.station import Station
from gcs_server.clock import Clock
from gcs_server.control.principal import Principal
from gcs_server.errors import GcsError
from gcs_server.streamer.offboard.status import OffboardStatus
from gcs_server.telemetry.wire import encode

MAX_HZ = 100.0
ANSWERS_KEPT = 200
ANSWERS_BYTES = 131_072
"""Total size of answers that wait to be read."""
UNPARSED_BYTES = 2 << 20
"""Total size of messages that wait to be parsed."""
LARGE_MESSAGE = 4096
"""A message with more characters is parsed in a separate iteration of the event loop."""
MAX_BACKLOG = 200
"""Maximum number of messages that wait to be parsed; older ones are superseded."""
FLOOD_PER_S = 2000
CLOSE_FLOOD = 1008

Answer = dict[str, object]


class Socket(Protocol):
    """The part of a WebSocket that is used."""

    async def send_text(self, data: str) -> None: ...
    async def receive_text(self) -> str: ...
    async def close(self, code: int = 1000, reason: str | None = None) -> None: ...


class SetpointSocket:
    """One client's setpoints for one vehicle.

    Args:
        clock: the server's clock.
        station: the parts of the server.
        principal: the caller.
        vehicle_id: the vehicle.
        socket: an accepted WebSocket.
    """

    def __init__(
        self, clock: Clock, station: Station, principal: Principal, vehicle_id: str, socket: Socket
    ) -> None:
        self._clock = clock
        self._station = station
        self._principal = principal
        self._vehicle_id = vehicle_id
        self._socket = socket
        self._backlog: deque[str] = deque()
        self._backlog_size = 0
        self._answers: deque[bytes] = deque()
        self._answers_size = 0
        self._received = asyncio.Event()
        self._answered = asyncio.Event()

    async def serve(self) -> None:
        """Serves the socket until it is closed."""
        async with asyncio.TaskGroup() as group:
            parts = [group.create_task(work()) for work in (self._receive, self._apply, self._send)]
            await asyncio.wait(parts, return_when=asyncio.FIRST_COMPLETED)
            for part in parts:
                part.cancel()

    async def _receive(self) -> None:
        window_s, count = self._clock.monotonic_s(), 0
        while True:
            text = await self._socket.receive_text()
            now_s = self._clock.monotonic_s()
            if now_s - window_s >= 1.0:
                window_s, count = now_s, 0
            count += 1
            if count > FLOOD_PER_S:
                await self._socket.close(CLOSE_FLOOD, f"more than {FLOOD_PER_S} setpoints in a second")
                return
            self._backlog.append(text)
            self._backlog_size += len(text)
            while len(self._backlog) > MAX_BACKLOG or self._backlog_size > UNPARSED_BYTES:
                overtaken = self._backlog.popleft()
                self._backlog_size -= len(overtaken)
                self._answer(_superseded(overtaken))
            self._received.set()

    async def _apply(self) -> None:
        next_s = 0.0
        while True:
            await self._received.wait()
            await self._clock.sleep(next_s - self._clock.monotonic_s())
            self._received.clear()
            applied = False
            while self._backlog:  # newest first; an invalid setpoint must not replace a valid one
                text = self._backlog.pop()
                self._backlog_size -= len(text)
                if applied:
                    self._answer(_superseded(text))
                else:
                    if len(text) > LARGE_MESSAGE:
                        await self._station.request_queue.wait(self._principal)
                    answer = await self._apply_message(text)
                    applied = "error" not in answer
                    self._answer(answer)
            period_s = 1.0 / MAX_HZ
            next_s = (
                max(next_s, self._clock.monotonic_s() - period_s) + period_s
            )  # one setpoint may be sent before its period has passed

    async def _send(self) -> None:
        while True:
            await self._answered.wait()
            self._answered.clear()
            while self._answers:
                encoded = self._answers.popleft()
                self._answers_size -= len(encoded)
                await self._socket.send_text(encoded.decode())

    def _answer(self, answer: Answer) -> None:
        encoded = encode(answer)
        self._answers.append(encoded)
        self._answers_size += len(encoded)
        while len(self._answers) > ANSWERS_KEPT or self._answers_size > ANSWERS_BYTES:
            self._answers_size -= len(self._answers.popleft())
        self._answered.set()

    async def _apply_message(self, text: str) -> Answer:
        try:
            seq, data = _parsed(text)
        except ValueError as error:
            return {"error": {"code": "invalid_request", "detail": str(error), "field": "body"}}
        head: Answer = {} if seq is None else {"seq": seq}
        try:
            body = SetpointRequest.model_validate(data)
        except ValidationError as error:
            faults = validation_errors(RequestValidationError(error.errors(include_url=False)))
            detail = "; ".join(f"{fault['field']}: {fault['message']}" for fault in faults)
            wrong = {
                "code": "invalid_request",
                "detail": detail,
                "field": faults[0]["field"],
                "errors": faults,
            }
            return {**head, "error": wrong}
        try:
            status = await apply(self._station, self._principal, self._vehicle_id, body)
        except GcsError as error:
            refused = {"code": error.code, "detail": error.message, "remedy": error.remedy, **error.details()}
            return {**head, "error": {name: value for name, value in refused.items() if value is not None}}
        return {**head, "applied": status.setpoint, "limited": status.limited}


async def apply(
    station: Station, principal: Principal, vehicle_id: str, body: SetpointRequest
) -> OffboardStatus:
    """Applies one setpoint, from HTTP or WebSocket."""
    with authorized_command(station, principal, "offboard/setpoint", vehicle_id, arguments_of(body)):
        return await station.offboard(vehicle_id).setpoint(body.to_stream_request(principal))


def arguments_of(body: BaseModel) -> dict[str, object]:
    """Arguments for the journal; a path is replaced by its number of points."""
    arguments: dict[str, Any] = body.model_dump(exclude_none=True)
    setpoint = arguments["setpoint"]
    if "points" in setpoint:
        setpoint["points"] = f"{len(setpoint['points'])} points"
    return arguments


def _parsed(text: str) -> tuple[int | None, dict[str, Any]]:
    fault = json_fault(text.encode())
    if fault is not None:
        raise ValueError(f"not read: {fault}")
    try:
        data = json.loads(text)
    except json.JSONDecodeError as error:
        raise ValueError(f"not JSON: {error.msg} at {error.pos}") from error
    if not isinstance(data, dict):
        raise ValueError("A message is a JSON object with a setpoint.")
    fields = cast(dict[str, Any], data)
    seq = fields.pop("seq", None)
    if seq is not None and (not isinstance(seq, int) or isinstance(seq, bool)):
        raise ValueError("seq must be a whole number.")
    return seq, fields


def _superseded(text: str) -> Answer:
    try:
        seq, _ = _parsed(text)
    except ValueError:
        seq = None
    return {"superseded": True} if seq is None else {"seq": seq, "superseded": True}
