"""Limits the number of open requests and WebSockets per client, per address and in total.

Only the limit per client applies to a client in control of a vehicle.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal

from starlette.requests import HTTPConnection
from starlette.responses import Response
from starlette.types import ASGIApp, Receive, Scope, Send

from gcs_server.api import refusals
from gcs_server.api.connections import SCOPE_KEY, Connection, Connections
from gcs_server.api.principals import principal_of
from gcs_server.api.refusals import LimitRefusal

ConnectionKind = Literal["http", "websocket"]
CLOSE_TRY_AGAIN = 1013


@dataclass(frozen=True, slots=True)
class OpenLimits:
    """Maximum numbers of open requests, or of open WebSockets."""

    total: int
    per_address: int
    per_client: int


LIMITS: dict[ConnectionKind, OpenLimits] = {
    "http": OpenLimits(total=256, per_address=128, per_client=64),
    "websocket": OpenLimits(total=256, per_address=128, per_client=64),
}


class OpenCounts:
    """Counts the open requests, or the open WebSockets."""

    def __init__(self, limits: OpenLimits, in_control: Callable[[str], bool]) -> None:
        self._limits = limits
        self._in_control = in_control
        self._total = 0
        self._counts: Counter[str] = Counter()
        """Numbers by `client …` and `address …`."""

    def refusal(self, client_key: str, address: str) -> LimitRefusal | None:
        """Why one more request or WebSocket of the client is refused; None: it is allowed."""
        if self._counts[f"client {client_key}"] >= self._limits.per_client:
            return refusals.TOO_MANY
        address_is_full = self._counts[f"address {address}"] >= self._limits.per_address
        if (address_is_full or self._total >= self._limits.total) and not self._in_control(client_key):
            return refusals.TOO_MANY if address_is_full else refusals.SERVER_FULL
        return None

    @contextmanager
    def counted(self, client_key: str, address: str) -> Generator[None]:
        """Counts one request or WebSocket while the block runs."""
        names = (f"client {client_key}", f"address {address}")
        self._total += 1
        self._counts.update(names)
        try:
            yield
        finally:
            self._total -= 1
            self._counts.subtract(names)
            for name in names:
                if not self._counts[name]:
                    del self._counts[name]


class Admission:
    """ASGI middleware that runs after the guard (`guard.py`).

    Args:
        connections: the server's connections.
        in_control: returns whether the client with a key controls a vehicle.
    """

    def __init__(self, app: ASGIApp, connections: Connections, in_control: Callable[[str], bool]) -> None:
        self._app = app
        self._connections = connections
        self._counts_by_kind = {kind: OpenCounts(limits, in_control) for kind, limits in LIMITS.items()}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        kind = scope["type"]
        if kind not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        key = principal_of(HTTPConnection(scope)).key
        address = scope["client"][0] if scope.get("client") else ""
        connection: Connection | None = (scope.get("extensions") or {}).get(SCOPE_KEY)
        refusal_status = self._connections.admit(connection, key) if connection is not None else 0
        counts = self._counts_by_kind[kind]
        refusal = refusals.BY_STATUS[refusal_status] if refusal_status else counts.refusal(key, address)
        if refusal is None:
            with counts.counted(key, address):
                await self._app(scope, receive, send)
            return
        self._connections.count_refusal()
        if kind == "websocket":
            await receive()
            if "websocket.http.response" not in (scope.get("extensions") or {}):
                await send({"type": "websocket.close", "code": CLOSE_TRY_AGAIN, "reason": refusal.code})
                return
        await refusal_response(refusal)(scope, receive, send)


def refusal_response(refusal: LimitRefusal) -> Response:
    """The response to a refused request; its header `Connection` closes the connection."""
    headers = {"Connection": "close", "Cache-Control": "no-store", "Retry-After": "2"}
    return Response(refusal.body(), refusal.status, headers, media_type="application/problem+json")
