"""Setpoints over a WebSocket at up to 100 Hz; the server responds to each setpoint with the applied setpoint.

The server sends only the newest waiting setpoint to the vehicle; the response to older ones is `superseded`.
If a client does not read its responses, the server drops the oldest ones. Closing the socket does not stop
the setpoint stream, which continues until the setpoint expires.
"""

from __future__ import annotations

import asyncio
import json
from collections import deque
from typing import Any, Protocol, cast

import msgspec
from fastapi import WebSocket, WebSocketDisconnect
from fastapi.exceptions import RequestValidationError
from pydantic import ValidationError

from gcs_server.api.json_limits import json_fault
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import validation_errors
from gcs_server.api.routes import Routes
from gcs_server.api.setpoints import SetpointRequest, apply_setpoint
from gcs_server.api.station import Station, StationDep
from gcs_server.clock import Clock
from gcs_server.control.principal import Principal
from gcs_server.errors import ClientHasTooMany, GcsError, ServerBusy
from gcs_server.telemetry.wire import encode

MAX_HZ = 100.0
MAX_RESPONSES = 200
MAX_RESPONSES_BYTES = 131_072
"""Maximum total size of responses that the client has not read."""
MAX_UNPARSED_CHARACTERS = 2 << 20
"""Maximum total length of messages that wait to be parsed."""
LARGE_MESSAGE = 4096
"""A message with more characters is parsed in a separate iteration of the event loop."""
MAX_BACKLOG = 200
"""Maximum number of messages that wait to be parsed; older messages are superseded."""
FLOOD_PER_S = 2000
"""Maximum number of messages per second; the server closes the socket of a client that sends more."""
CLOSE_FLOOD = 1008

router = Routes(prefix="/vehicles/{v}/offboard", tags=["offboard"])

JsonObject = dict[str, object]


class Socket(Protocol):
    """The part of a WebSocket that this module uses."""

    async def send_text(self, data: str) -> None: ...
    async def receive_text(self) -> str: ...
    async def close(self, code: int = 1000, reason: str | None = None) -> None: ...


class SetpointSocket:
    """One client's setpoints for one vehicle.

    Args:
        clock: the server's clock.
        station: the running server.
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
        self._backlog_characters = 0
        self._responses: deque[bytes] = deque()
        self._responses_bytes = 0
        self._received = asyncio.Event()
        self._response_added = asyncio.Event()

    async def serve(self) -> None:
        """Serves the socket until it is closed."""
        async with asyncio.TaskGroup() as group:
            tasks = [group.create_task(work()) for work in (self._receive, self._apply, self._send)]
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in tasks:
                task.cancel()

    async def _receive(self) -> None:
        window_start_s, count = self._clock.monotonic_s(), 0
        while True:
            text = await self._socket.receive_text()
            now_s = self._clock.monotonic_s()
            if now_s - window_start_s >= 1.0:
                window_start_s, count = now_s, 0
            count += 1
            if count > FLOOD_PER_S:
                await self._socket.close(CLOSE_FLOOD, f"more than {FLOOD_PER_S} setpoints in a second")
                return
            self._backlog.append(text)
            self._backlog_characters += len(text)
            while len(self._backlog) > MAX_BACKLOG or self._backlog_characters > MAX_UNPARSED_CHARACTERS:
                superseded = self._backlog.popleft()
                self._backlog_characters -= len(superseded)
                self._respond(_superseded_response(superseded))
            self._received.set()

    async def _apply(self) -> None:
        next_s = 0.0
        while True:
            await self._received.wait()
            wait_s = next_s - self._clock.monotonic_s()
            if wait_s > 0.0:
                await self._clock.sleep(wait_s)
            self._received.clear()
            applied = False
            while self._backlog:  # newest first; an invalid setpoint must not replace a valid one
                text = self._backlog.pop()
                self._backlog_characters -= len(text)
                if applied:
                    self._respond(_superseded_response(text))
                else:
                    response = await self._apply_in_turn(text)
                    applied = "error" not in response
                    self._respond(response)
            # After a delay, the next setpoint is applied up to one period earlier, to keep the average rate.
            period_s = 1.0 / MAX_HZ
            next_s = max(next_s, self._clock.monotonic_s() - period_s) + period_s

    async def _send(self) -> None:
        while True:
            await self._response_added.wait()
            self._response_added.clear()
            while self._responses:
                encoded = self._responses.popleft()
                self._responses_bytes -= len(encoded)
                await self._socket.send_text(encoded.decode())

    def _respond(self, response: JsonObject) -> None:
        encoded = encode(response)
        self._responses.append(encoded)
        self._responses_bytes += len(encoded)
        while len(self._responses) > MAX_RESPONSES or self._responses_bytes > MAX_RESPONSES_BYTES:
            self._responses_bytes -= len(self._responses.popleft())
        self._response_added.set()

    async def _apply_in_turn(self, text: str) -> JsonObject:
        if len(text) <= LARGE_MESSAGE:
            return await self._apply_message(text)
        try:
            async with self._station.large_setpoints.turn(len(text), wait=False):
                await self._station.request_queue.wait(self._principal)
                return await self._apply_message(text)
        except (ClientHasTooMany, ServerBusy) as error:
            return {**_seq_field(text), "error": _error_fields(error)}

    async def _apply_message(self, text: str) -> JsonObject:
        try:
            seq, data = _parse(text)
        except ValueError as error:
            return {"error": {"code": "invalid_request", "detail": str(error), "field": "body"}}
        seq_field: JsonObject = {} if seq is None else {"seq": seq}
        try:
            body = SetpointRequest.model_validate(data)
        except ValidationError as error:
            faults = validation_errors(RequestValidationError(error.errors(include_url=False)))
            detail = "; ".join(f"{fault['field']}: {fault['message']}" for fault in faults)
            error_fields = {
                "code": "invalid_request",
                "detail": detail,
                "field": faults[0]["field"],
                "errors": faults,
            }
            return {**seq_field, "error": error_fields}
        try:
            status = await apply_setpoint(self._station, self._principal, self._vehicle_id, body)
        except GcsError as error:
            return {**seq_field, "error": _error_fields(error)}
        return {**seq_field, "applied": status.setpoint, "limited": status.limited}


def _parse(text: str) -> tuple[int | None, dict[str, Any]]:
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


class _Numbered(msgspec.Struct):
    seq: int | None = None


def _seq_field(text: str) -> JsonObject:
    """The number of a message that is not applied; its other fields are skipped, not read."""
    try:
        seq = msgspec.json.decode(text, type=_Numbered).seq
    except (msgspec.DecodeError, RecursionError, UnicodeEncodeError):
        seq = None
    return {} if seq is None else {"seq": seq}


def _superseded_response(text: str) -> JsonObject:
    return {**_seq_field(text), "superseded": True}


def _error_fields(error: GcsError) -> JsonObject:
    fields = {"code": error.code, "detail": error.message, "remedy": error.remedy, **error.details()}
    return {name: value for name, value in fields.items() if value is not None}


@router.websocket("/stream")
async def stream(socket: WebSocket, v: str, station: StationDep, principal: PrincipalDep) -> None:
    """Receives setpoints on a WebSocket and responds to each with the applied setpoint; see "Offboard stream"
    in docs/api.md."""
    await socket.accept()
    try:
        with station.authority.connected(principal):
            await SetpointSocket(station.clock, station, principal, v, socket).serve()
    except* (WebSocketDisconnect, RuntimeError):
        pass  # the client disconnected; sending to a closed socket raises RuntimeError
