"""Keeps other web sites' pages out: a browser says whose page asks, and only our own may.

A program (curl, the Python client) sends no Origin and passes. While the server listens on loopback, the
Host must be a loopback name as well, so that a foreign name that resolves to 127.0.0.1 (DNS rebinding)
gets nothing.
"""

from __future__ import annotations

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Receive, Scope, Send

from gcs_server.api.problems import problem

LOOPBACK = frozenset({"localhost", "127.0.0.1", "[::1]"})
SAFE = frozenset({"GET", "HEAD", "OPTIONS"})


def host_name(host: str) -> str:
    """A Host header without its port, in lower case."""
    host = host.lower()
    if host.startswith("["):
        return host.split("]")[0] + "]"
    return host.split(":")[0]


def same_origin(origin: str, host: str) -> bool:
    """Whether a page of `origin` was served under `host`."""
    scheme, mark, asking = origin.lower().partition("://")
    default = {"http": ":80", "https": ":443"}.get(scheme, "")
    return bool(mark) and asking.removesuffix(default) == host.lower().removesuffix(default)


class OriginGuard:
    """ASGI middleware.

    Args:
        loopback_only: the server is bound to loopback: other Host names are refused.
    """

    def __init__(self, app: ASGIApp, loopback_only: bool) -> None:
        self._app = app
        self._loopback_only = loopback_only

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] in ("http", "websocket"):
            refusal = self._refusal(scope)
            if refusal is not None:
                if scope["type"] == "websocket":
                    await receive()
                    await send({"type": "websocket.close", "code": 1008, "reason": "foreign origin"})
                else:
                    await problem(403, "Forbidden", "foreign_origin", refusal)(scope, receive, send)
                return
        await self._app(scope, receive, send)

    def _refusal(self, scope: Scope) -> str | None:
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if self._loopback_only and host_name(host) not in LOOPBACK:
            return (
                f"This server answers on this machine only, not as {host_name(host)!r}. Use http://localhost."
            )
        origin = headers.get("origin")
        acts = scope["type"] == "websocket" or scope["method"] not in SAFE
        if acts and origin is not None and not same_origin(origin, host):
            return f"A page of {origin} may not command vehicles here; only the server's own page may."
        return None
