"""Reads the body of each request before the request is handled. Limits its size, time, depth and values.

A body that is nested deeper, or has more keys, than any valid body is refused before it is parsed, because
each unknown key would produce a validation error.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import re
from typing import Any

from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gcs_server.api import refusals
from gcs_server.api.admission import refusal_response
from gcs_server.api.principals import principal_of
from gcs_server.api.problems import problem
from gcs_server.api.request_queue import RequestQueue

MAX_DEPTH = 32
MAX_VALUES = 100_000
"""Maximum number of commas and opening brackets; a path of 5000 points has 35,000."""
MAX_KEYS = 100
"""Maximum number of keys in one object; the largest valid object has 20."""
_LONG_NUMBER = re.compile(rb"[0-9]{400}")
_JSON_STRING = re.compile(rb'"(?:[^"\\]|\\.)*+"?', re.DOTALL)
_NOT_BRACKETS = bytes(set(range(256)) - set(b"[]{}"))


def json_fault(text: bytes) -> str | None:
    """Why this JSON text is refused; None if it may be parsed. Invalid JSON is reported by the parser."""
    try:
        text.decode()
    except UnicodeDecodeError:
        return "it is not UTF-8 text"
    if _LONG_NUMBER.search(text) and _LONG_NUMBER.search(_JSON_STRING.sub(b"", text)):
        return "it has a number of 400 digits or more"
    opening = text.count(b"{") + text.count(b"[")
    if opening + text.count(b",") > MAX_VALUES:
        return f"it has more than {MAX_VALUES:,} values"
    if opening > MAX_DEPTH and _deeper_than(text, MAX_DEPTH):
        return f"it is nested deeper than {MAX_DEPTH} levels"
    if text.count(b":") > MAX_KEYS and _most_keys(text) > MAX_KEYS:
        return f"one of its objects has more than {MAX_KEYS} keys"
    return None


def _deeper_than(text: bytes, max_depth: int) -> bool:
    depth = 0
    for bracket in _JSON_STRING.sub(b"", text).translate(None, _NOT_BRACKETS):
        depth += 1 if bracket in b"[{" else -1
        if depth > max_depth:
            return True
    return False


def _most_keys(text: bytes) -> int:
    largest = 0

    def count(pairs: list[tuple[str, Any]]) -> None:
        nonlocal largest
        largest = max(largest, len(pairs))

    with contextlib.suppress(ValueError):
        json.loads(text, object_pairs_hook=count)
    return largest


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
        if body is None:
            await refusal_response(refusals.BODY_TOO_LARGE)(scope, receive, send)
            return
        await self._request_queue.wait(client)
        fault = json_fault(body) if b"json" in _header(scope, b"content-type") else None
        if fault is not None:
            response = problem(
                422,
                "Invalid request",
                "invalid_request",
                f"The request body was refused: {fault}.",
                field="body",
                remedy="Send only what the API description allows, and less data at once.",
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
