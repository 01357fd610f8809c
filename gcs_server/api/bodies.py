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
from gcs_server.api.request_queue import RequestQueue
from gcs_server.operations.turns import CALLER, Caller

MAX_SMALL_BODY_BYTES = 65_536
"""Maximum size of a body that contains neither a document nor a file nor setpoints."""
_PLANS = r"plans(/\w+)?|dry_runs|offboard_missions/start"
_OF_VEHICLE = r"vehicles/[^/]+/(mission/(upload|compare)|offboard_mission/start|mission_modes/register)"
DOCUMENT_PATHS = re.compile(rf"/api/v1/({_PLANS}|{_OF_VEHICLE})")
"""Routes whose body contains a document or a file (`documents.py`)."""
SETPOINT_PATHS = re.compile(r"/api/v1/(vehicles/[^/]+/offboard/(start|setpoint)|groups(/.+)?)")
"""Routes whose body contains setpoints; a path of 5000 points has 700 kB."""


def _may_be_large(scope: Scope) -> bool:
    return any(paths.fullmatch(scope["path"]) for paths in (DOCUMENT_PATHS, SETPOINT_PATHS))


class _ClientDisconnected(Exception):
    """The client disconnected."""


class BodyReader:
    """ASGI middleware that reads and checks the body of each request.

    Args:
        request_queue: starts requests in a fair order.
    """

    def __init__(self, app: ASGIApp, request_queue: RequestQueue) -> None:
        self._app = app
        self._request_queue = request_queue

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
        try:
            async with asyncio.timeout(refusals.BODY_DEADLINE_S):
                body = await _read(scope, receive)
        except _ClientDisconnected:
            return
        except TimeoutError:
            await refusal_response(refusals.TOO_SLOW)(scope, receive, send)
            return
        if body is None or (len(body) > MAX_SMALL_BODY_BYTES and not _may_be_large(scope)):
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


async def _read(scope: Scope, receive: Receive) -> bytes | None:
    """The request's body; None: it is too large."""
    declared = _header(scope, b"content-length")
    if declared.isdigit() and int(declared[:15]) > refusals.MAX_BODY_BYTES:
        return None
    body = bytearray()
    is_incomplete = True
    while is_incomplete:
        message = await receive()
        if message["type"] == "http.disconnect":
            raise _ClientDisconnected
        body += message.get("body", b"")
        is_incomplete = message.get("more_body", False)
        if len(body) > refusals.MAX_BODY_BYTES:
            return None
    return bytes(body)
