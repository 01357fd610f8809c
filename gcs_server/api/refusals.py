"""Responses to clients that exceed a limit: one table for the server and the API description."""

from __future__ import annotations

from dataclasses import dataclass
from http import HTTPStatus

from gcs_server.telemetry.wire import encode

MAX_HEAD_BYTES = 32_768
"""Maximum size of request line and headers together."""
MAX_URL_BYTES = 8_192
MAX_HEADERS = 100
MAX_BODY_BYTES = 1 << 20
"""A path of 5000 points needs about 700 kB; other bodies have a few kilobytes."""
MAX_MESSAGE_BYTES = 1 << 20
"""Maximum size of a client's WebSocket message."""
HEAD_DEADLINE_S = 10.0
"""Deadline for the headers, from the start of the connection or the first byte of a later request."""
BODY_DEADLINE_S = 20.0
UNREAD_DEADLINE_S = 20.0
"""Deadline for a client to read some of the written data."""
MAX_PIPELINED = 8
"""Maximum number of requests that wait on one connection while an earlier request is being served."""


@dataclass(frozen=True, slots=True)
class LimitRefusal:
    """The response to a request that exceeds a limit."""

    status: int
    code: str
    detail: str
    remedy: str

    @property
    def title(self) -> str:
        """Standard text of the HTTP status."""
        return HTTPStatus(self.status).phrase

    def body(self) -> bytes:
        """The refusal as problem+json."""
        return encode(
            {
                "type": f"/problems/{self.code}",
                "title": self.title,
                "status": self.status,
                "code": self.code,
                "detail": self.detail,
                "remedy": self.remedy,
            }
        )


MALFORMED = LimitRefusal(400, "malformed_http", "The request is not valid HTTP/1.1.", "Send HTTP/1.1.")
TOO_SLOW = LimitRefusal(
    408,
    "too_slow",
    f"The request was not complete in time: its headers must arrive within {HEAD_DEADLINE_S:g} s, its body "
    f"within {BODY_DEADLINE_S:g} s.",
    "Send it again; the request was not executed.",
)
BODY_TOO_LARGE = LimitRefusal(
    413,
    "body_too_large",
    f"The request's body is larger than {MAX_BODY_BYTES:,} bytes.",
    "Send less at once: a path of fewer points, fewer vehicles in a call.",
)
URL_TOO_LONG = LimitRefusal(
    414, "url_too_long", f"The URL is longer than {MAX_URL_BYTES:,} bytes.", "Send a shorter URL."
)
HEAD_TOO_LARGE = LimitRefusal(
    431,
    "headers_too_large",
    f"The request line and the headers are longer than {MAX_HEAD_BYTES:,} bytes, or more than "
    f"{MAX_HEADERS} headers.",
    "Send fewer and shorter headers.",
)
TOO_MANY = LimitRefusal(
    429,
    "too_many_requests",
    "This client, or its address, has too many connections, requests or WebSockets open.",
    "Close some, wait for the responses, then try again. A client in control of a vehicle is served.",
)
TOO_MANY_LARGE = LimitRefusal(
    429,
    "too_many_requests",
    "This client has too many requests with large bodies open.",
    "Wait for their responses, then try again.",
)
SERVER_FULL = LimitRefusal(
    503,
    "server_full",
    "The server has reached its limit of connections and requests.",
    "Try again later. A client in control of a vehicle is served.",
)
ALL = (MALFORMED, TOO_SLOW, BODY_TOO_LARGE, URL_TOO_LONG, HEAD_TOO_LARGE, TOO_MANY, SERVER_FULL)
BY_STATUS = {refusal.status: refusal for refusal in ALL}
