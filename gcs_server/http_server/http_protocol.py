"""The HTTP protocol of one connection, with limits of size, time and number. It extends uvicorn's protocol:
input is counted before it is stored, and input above a limit is refused with a reason. After a refusal the
server closes only its own side and drops further input, so that the client receives the response.
"""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Any, cast

import httptools
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol, RequestResponseCycle

from gcs_server.api import refusals as r
from gcs_server.api.connections import SCOPE_KEY
from gcs_server.http_server.context import ConnectionContext, StallDetector
from gcs_server.http_server.websocket_protocol import BoundedWebSocket

OVERHEAD_BYTES = 131_072
"""Largest overhead of a chunked body [bytes]."""
MAX_CHUNKS = 4096
LINGER_S = 2.0
"""Maximum time from a refusal to the end of the connection [s]."""
LINGER_BYTES = 4 << 20
"""Maximum number of bytes that are dropped after a refusal."""

_HEADERS = (
    b"content-type: application/problem+json\r\ncache-control: no-store\r\n"
    b"x-content-type-options: nosniff\r\ncontent-security-policy: default-src 'none'\r\nconnection: close\r\n"
)


def raw_response(refusal: r.LimitRefusal) -> bytes:
    """The complete HTTP response for a refusal."""
    body = refusal.body()
    return b"HTTP/1.1 %d %s\r\n%scontent-length: %d\r\n\r\n%s" % (
        refusal.status,
        refusal.title.encode(),
        _HEADERS,
        len(body),
        body,
    )


class _StopParsing(Exception):
    """Raised to stop parsing received bytes."""


class BoundedHttp(HttpToolsProtocol):
    """The HTTP protocol of one connection."""

    def __init__(self, context: ConnectionContext) -> None:
        super().__init__(*context.uvicorn_arguments)
        self._context = context
        self.connection = context.connection
        self._connections = context.connections
        self._clock = clock = context.clock
        self._stall = StallDetector(clock)
        self._since_s = clock.monotonic_s()
        """Start of the time that the deadline for the head or the body limits."""
        self._in_head = False
        self._in_body = False
        self._head_bytes = 0
        self._url_bytes = 0
        self._body_bytes = 0
        self._chunks = 0
        self._fed_bytes = 0
        """Raw bytes of the message, without the bytes that were received together with its start."""
        self._message_began = False
        """Whether a message starts in the bytes that are being parsed."""
        self._open_cycles: deque[RequestResponseCycle] = deque()
        self._incoming: RequestResponseCycle | None = None
        """The request whose body is being received; None until its head is complete."""
        self._refused = False
        self._lingers_until_s: float | None = None
        self._dropped_bytes = 0

    # --- called by asyncio ----------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The connection is open."""
        super().connection_made(cast(asyncio.Transport, transport))
        self.connection.socket = self
        if self.connection.closed:  # the connection was closed in favour of another one
            self.end()

    def connection_lost(self, exc: Exception | None) -> None:
        """The connection is closed."""
        super().connection_lost(exc)
        self._connections.remove(self.connection)
        for cycle in self._open_cycles:
            cycle.body = bytearray()

    def data_received(self, data: bytes) -> None:
        """Handles bytes from the client."""
        if self._refused:
            self._dropped_bytes += len(data)
            if self._dropped_bytes > LINGER_BYTES:
                self.end()
            return
        self._unset_keepalive_if_required()
        self._message_began = False
        try:
            cast(httptools.HttpRequestParser, self.parser).feed_data(data)
        except httptools.HttpParserUpgrade:
            if self._should_upgrade():
                self.handle_websocket_upgrade()
            return  # a request for another protocol (h2c) is served as HTTP/1.1
        except httptools.HttpParserError:
            self._refuse(r.MALFORMED)
            return
        if not self._message_began:
            self._fed_bytes += len(data)
        # No callback counts incomplete headers, chunk extensions and trailers.
        if self._in_head and self._fed_bytes > r.MAX_HEAD_BYTES:
            self._refuse(r.HEAD_TOO_LARGE)
        elif self._in_body and self._fed_bytes > r.MAX_BODY_BYTES + OVERHEAD_BYTES:
            self._refuse(r.BODY_TOO_LARGE)

    # --- called by the parser -------------------------------------------------------------------

    def on_message_begin(self) -> None:
        """A request starts."""
        if len(self.pipeline) >= r.MAX_PIPELINED:
            self._refuse_and_stop(r.TOO_MANY)
        super().on_message_begin()
        self._in_head = self._message_began = True
        self._since_s = self._clock.monotonic_s()
        self._incoming = None
        self._chunks = self._fed_bytes = self._head_bytes = self._url_bytes = self._body_bytes = 0

    def on_url(self, url: bytes) -> None:
        """A piece of the address."""
        self._head_bytes += len(url)
        self._url_bytes += len(url)
        if self._url_bytes > r.MAX_URL_BYTES:
            self._refuse_and_stop(r.URL_TOO_LONG)
        super().on_url(url)

    def on_header(self, name: bytes, value: bytes) -> None:
        """A header, or a trailer after the body."""
        self._head_bytes += len(name) + len(value) + 4
        if self._head_bytes > r.MAX_HEAD_BYTES or len(self.headers) >= r.MAX_HEADERS:
            self._refuse_and_stop(r.HEAD_TOO_LARGE)
        if self._in_head:  # trailers are ignored
            super().on_header(name, value)

    def on_headers_complete(self) -> None:
        """The head is complete: the application starts."""
        self._in_head, self._in_body = False, True
        self._since_s = self._clock.monotonic_s()
        declared = next((value for name, value in self.headers if name == b"content-length"), b"0")
        if len(declared) > 15 or int(declared) > r.MAX_BODY_BYTES:
            self._refuse_and_stop(r.BODY_TOO_LARGE)
        super().on_headers_complete()
        if not self._should_upgrade():
            self._incoming = self.cycle
            self._open_cycles.append(self.cycle)
            cast("dict[str, Any]", self.scope)["extensions"] = {SCOPE_KEY: self.connection}
            self._connections.set_busy(self.connection, True)
            self._connections.limit_unread_bytes()

    def on_chunk_header(self) -> None:
        """A piece of a chunked body starts."""
        self._chunks += 1
        if self._chunks > MAX_CHUNKS:
            self._refuse_and_stop(r.BODY_TOO_LARGE)

    def on_body(self, body: bytes) -> None:
        """A piece of the body."""
        self._body_bytes += len(body)
        if self._body_bytes > r.MAX_BODY_BYTES:
            self._refuse_and_stop(r.BODY_TOO_LARGE)
        if not self.cycle.response_complete and not self._connections.take_body(self.connection, len(body)):
            self._refuse_and_stop(r.SERVER_FULL)
        super().on_body(body)

    def on_message_complete(self) -> None:
        """The request is complete."""
        self._in_body = False
        super().on_message_complete()

    def on_response_complete(self) -> None:
        """A response is complete."""
        # Protocol and request refer to each other, so that a body nobody read (the request was refused) would
        # stay until the next collection of garbage: hundreds of them had 60 MB.
        self._open_cycles.popleft().body = bytearray()
        if not self._open_cycles:
            self._connections.release_body(self.connection)
            self._connections.set_busy(self.connection, False)
        if not (self._in_body or self._in_head):
            self._since_s = self._clock.monotonic_s()
        super().on_response_complete()

    def handle_websocket_upgrade(self) -> None:
        """Continues the connection as a WebSocket."""
        if self._open_cycles:
            self._refuse(r.MALFORMED)
            return
        self.server_state.connections.discard(self)
        lines = [self.scope["method"].encode() + b" " + self.url + b" HTTP/1.1\r\n"]
        lines += [name + b": " + value + b"\r\n" for name, value in self.scope["headers"]]
        protocol = BoundedWebSocket(self._context)
        protocol.connection_made(self.transport)
        self.transport.set_protocol(protocol)
        protocol.data_received(b"".join([*lines, b"\r\n"]))

    # --- for `Connections` ----------------------------------------------------------------------

    def end(self) -> None:
        """Closes the connection immediately."""
        if self.transport is not None:  # type: ignore[redundant-expr]
            self.transport.abort()

    def unread_bytes(self) -> int:
        """Bytes for the client that still wait in this process."""
        return self.transport.get_write_buffer_size()

    def check(self, now_s: float) -> None:
        """Closes the connection if a deadline has passed."""
        if self._lingers_until_s is not None:
            if now_s > self._lingers_until_s:
                self.end()
        elif self._stall.is_stalled(self.unread_bytes()):
            self.end()
        elif self._in_body:
            if now_s - self._since_s > r.BODY_DEADLINE_S:
                self._refuse(r.TOO_SLOW)
        elif not self.connection.busy and now_s - self._since_s > r.HEAD_DEADLINE_S:
            if self._in_head:
                self._refuse(r.TOO_SLOW)
            else:
                self.transport.close()

    # --- refusing -------------------------------------------------------------------------------

    def _refuse_and_stop(self, refusal: r.LimitRefusal) -> None:
        self._refuse(refusal)
        raise _StopParsing

    def _refuse(self, refusal: r.LimitRefusal) -> None:
        """Sends the reason, unless another response has started, and closes the connection."""
        if self._refused:
            return
        self._refused = True
        self._connections.count_refusal()
        self.pipeline.clear()
        self._unset_keepalive_if_required()
        incoming = self._incoming
        has_earlier_requests = any(cycle is not incoming for cycle in self._open_cycles)
        response_started = incoming is not None and incoming.response_started
        for cycle in self._open_cycles:
            cycle.disconnected, cycle.waiting_for_100_continue = True, False
            cycle.message_event.set()
        if self.transport.is_closing():
            return
        if not (has_earlier_requests or response_started):
            self.transport.write(raw_response(refusal))
        self._lingers_until_s = self._clock.monotonic_s() + LINGER_S
        self.flow.resume_writing()
        self.flow.resume_reading()
        if self.transport.can_write_eof():
            self.transport.write_eof()
