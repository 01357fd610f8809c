"""Security headers of every response: the browser may run and load only content of this server.

The 3D view has its own policy (`scene/page.py`); headers that a route has set are kept.
"""

from __future__ import annotations

import re

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

_HOST = re.compile(r"[A-Za-z0-9.-]+(:[0-9]+)?|\[[0-9A-Fa-f:.]+\](:[0-9]+)?")

FIXED_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "SAMEORIGIN",
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    # The page may follow this device; no frame of anybody else may locate it.
    "Permissions-Policy": "geolocation=(self)",
}


def content_policy(host: str, *, secure: bool) -> str:
    """Content security policy: scripts, styles and connections from this server only; images also from
    `data:` and `blob:` URLs."""
    # Not every browser includes the WebSockets of this server in 'self'.
    websocket_source = f" {'wss' if secure else 'ws'}://{host}" if _HOST.fullmatch(host) else ""
    return (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
        f"font-src 'self'; manifest-src 'self'; connect-src 'self'{websocket_source}; frame-src 'self'; "
        "worker-src 'self'; frame-ancestors 'self'; base-uri 'none'; form-action 'self'"
    )


def security_headers(scope: Scope) -> dict[str, str]:
    """The security headers for the response to a request."""
    host = Headers(scope=scope).get("host", "")
    return {
        **FIXED_HEADERS,
        "Content-Security-Policy": content_policy(host, secure=scope.get("scheme") in ("https", "wss")),
    }


class SecurityHeaders:
    """ASGI middleware: adds the security headers that a response does not have yet."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in security_headers(scope).items():
                    headers.setdefault(name, value)
            await send(message)

        await self._app(scope, receive, send_with_headers)
