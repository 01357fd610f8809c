"""Reads the body of each request before the request is handled. Limits its size, time, depth and values."""

from __future__ import annotations

import asyncio
import re

from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gcs_server.api import refusals
from gcs_server.api.admission import refusal_response
from gcs_server.api.json_limits import REFUSED_REMEDY, json_fault
from gcs_server.api.principals import principal_of
from gcs_server.api.problems import problem
from gcs_server.api.request_queue import LargeSetpoints, RequestQueue
from gcs_server.control.principal import Principal
from gcs_server.errors import ClientHasTooMany, ServerBusy
from gcs_server.operations.turns import CALLER, Caller, TurnLimits, Turns

MAX_SMALL_BODY_BYTES = 65_536
"""Maximum size of a body that contains neither a document nor a file nor setpoints."""
_PLANS = r"plans(/\w+)?|dry_runs|offboard_missions/start"
_OF_VEHICLE = r"vehicles/[^/]+/(mission/(upload|compare)|offboard_mission/start|mission_modes/register)"
DOCUMENT_PATHS = re.compile(rf"/api/v1/({_PLANS}|{_OF_VEHICLE}|flights/uploads/[^/]+)")
"""Routes whose body contains a document (`documents.py`), or a file or a part of one."""
SETPOINT_PATHS = re.compile(r"/api/v1/(vehicles/[^/]+/offboard/(start|setpoint)|groups(/.+)?)")
"""Routes whose body contains setpoints; a path of 5000 points has 700 kB."""
FILE_PATHS = re.compile(r"/api/v1/vehicles/[^/]+/files/put")
"""Routes whose body contains a file as text."""
LARGE_BODIES = TurnLimits(running=64, running_without_control=32, per_client=8, total=32)
"""Maximum numbers of large bodies that are received or handled at a time."""


class _ClientDisconnected(Exception):
    """The client disconnected."""


class BodyReader:
    """ASGI middleware that reads and checks the body of each request.

    Args:
        request_queue: starts requests in a fair order.
        large_setpoints: lets large setpoints be read in turn.
    """

    def __init__(self, app: ASGIApp, request_queue: RequestQueue, large_setpoints: LargeSetpoints) -> None:
        self._app = app
        self._request_queue = request_queue
        self._large_bodies = Turns(request_queue.in_control, LARGE_BODIES)
        self._large_setpoints = large_setpoints

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        client = principal_of(HTTPConnection(scope))
        CALLER.set(Caller(client.key, client.address))
        if scope["type"] == "websocket" or scope["method"] in ("GET", "HEAD", "OPTIONS"):
            await self._request_queue.wait(client)
            await self._app(scope, receive, send)
            return
        has_setpoints = SETPOINT_PATHS.fullmatch(scope["path"]) is not None
        may_be_large = has_setpoints or any(
            paths.fullmatch(scope["path"]) is not None for paths in (DOCUMENT_PATHS, FILE_PATHS)
        )
        if not may_be_large or _declared_size(scope) <= MAX_SMALL_BODY_BYTES:
            await self._handle(client, scope, receive, send, MAX_SMALL_BODY_BYTES)
            return
        try:
            async with self._large_bodies.turn():
                if not has_setpoints:
                    await self._handle(client, scope, receive, send, refusals.MAX_BODY_BYTES)
                    return
                async with self._large_setpoints.turn(_declared_size(scope)):
                    await self._handle(client, scope, receive, send, refusals.MAX_BODY_BYTES)
        except (ClientHasTooMany, ServerBusy) as error:
            is_clients = isinstance(error, ClientHasTooMany)
            refusal = refusals.TOO_MANY_LARGE if is_clients else refusals.SERVER_FULL
            await refusal_response(refusal)(scope, receive, send)

    async def _handle(
        self, client: Principal, scope: Scope, receive: Receive, send: Send, max_bytes: int
    ) -> None:
        """Reads and checks the body, and passes the request on."""
        try:
            async with asyncio.timeout(refusals.BODY_DEADLINE_S):
                body = await _read(scope, receive, max_bytes)
        except _ClientDisconnected:
            return
        except TimeoutError:
            await refusal_response(refusals.TOO_SLOW)(scope, receive, send)
            return
        if body is None:
            await refusal_response(refusals.BODY_TOO_LARGE)(scope, receive, send)
            return
        await self._request_queue.wait(client)
        fault = json_fault(body) if _is_checked(scope, body) else None
        if fault is not None:
            response = problem(
                422,
                "Invalid request",
                "invalid_request",
                f"The request body was refused: {fault}.",
                field="body",
                remedy=REFUSED_REMEDY,
            )
            await response(scope, receive, send)
            return
        is_delivered = False

        async def receive_body() -> Message:
            nonlocal is_delivered
            if is_delivered:
                return await receive()
            is_delivered = True
            return {"type": "http.request", "body": body, "more_body": False}

        await self._app(scope, receive_body, send)


def _is_checked(scope: Scope, body: bytes) -> bool:
    """Whether the limits of JSON apply to a body: not to files, and not to large documents, which plan work
    checks."""
    if b"json" not in _header(scope, b"content-type"):
        return False
    return len(body) <= MAX_SMALL_BODY_BYTES or DOCUMENT_PATHS.fullmatch(scope["path"]) is None


def _header(scope: Scope, name: bytes) -> bytes:
    return next((value.lower() for key, value in scope["headers"] if key == name), b"")


def _declared_size(scope: Scope) -> int:
    """Size of the body; of a body in chunks the maximum."""
    declared = _header(scope, b"content-length")
    if declared.isdigit():
        return int(declared[:15])
    return refusals.MAX_BODY_BYTES if _header(scope, b"transfer-encoding") else 0


async def _read(scope: Scope, receive: Receive, max_bytes: int) -> bytes | None:
    """The request's body; None: it is too large."""
    declared = _header(scope, b"content-length")
    if declared.isdigit() and int(declared[:15]) > max_bytes:
        return None
    body = bytearray()
    is_incomplete = True
    while is_incomplete:
        message = await receive()
        if message["type"] == "http.disconnect":
            raise _ClientDisconnected
        body += message.get("body", b"")
        is_incomplete = message.get("more_body", False)
        if len(body) > max_bytes:
            return None
    return bytes(body)
