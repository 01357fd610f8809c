"""The protocol of one WebSocket, with limits: input is parsed in small pieces, and only as fast as the
application reads it. uvicorn's protocol parses all input at once and stores each message; a quarter of a
megabyte of empty frames would stall the event loop for almost a second. This protocol parses each piece in a
separate iteration of the event loop, once the application has read the messages of the previous piece.
"""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Any, cast

from uvicorn.protocols.utils import ClientDisconnected
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import Frame
from websockets.http11 import Request

from gcs_server.api.connections import SCOPE_KEY
from gcs_server.api.refusals import UNREAD_DEADLINE_S
from gcs_server.http_server.context import ConnectionContext, StallDetector

PIECE_BYTES = 2048
MAX_FRAMES = 1024
"""Maximum number of frames of one message."""
MAX_FRAMES_PER_S = 5000
MAX_UNREAD_PONG_BYTES = 65_536
CLOSE_DEADLINE_S = 5.0
CLOSE_CODE_POLICY = 1008
CLOSE_CODE_TOO_LARGE = 1009
CLOSE_CODE_TOO_SLOW = 1013


class BoundedWebSocket(WebSocketsSansIOProtocol):
    """The protocol of one WebSocket."""

    def __init__(self, context: ConnectionContext) -> None:
        super().__init__(*context.uvicorn_arguments)
        self.connection = context.connection
        self._connections = context.connections
        self._clock = clock = context.clock
        self._stall = StallDetector(clock)
        self.read_paused = True  # uvicorn pauses at each message, which costs a setpoint two system calls
        self._unparsed: deque[bytes] = deque()
        self._parsing = False
        self._second_start_s, self._frames_in_second = clock.monotonic_s(), 0
        self._closing_since_s: float | None = None

    # --- input ----------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Called when the connection is continued as a WebSocket."""
        super().connection_made(transport)
        self.connection.socket = self
        self._connections.set_busy(self.connection, True)

    def connection_lost(self, exc: Exception | None) -> None:
        """The connection is closed."""
        self._unparsed.clear()
        super().connection_lost(exc)
        self._connections.remove(self.connection)

    def data_received(self, data: bytes) -> None:
        """Splits bytes of the client into pieces."""
        if not self.handshake_initiated:  # the request head, from this server's parser
            super().data_received(data)
            return
        if self.close_sent and not self._parsing:  # only the client's close frame matters
            data = data[-PIECE_BYTES:]
        self._unparsed.extend(data[i : i + PIECE_BYTES] for i in range(0, len(data), PIECE_BYTES))
        self._parse_piece()
        if self._unparsed:
            self.transport.pause_reading()

    def _parse_piece(self) -> None:
        """Parses one piece. The next piece is parsed in another iteration of the event loop, once the
        application has read the messages."""
        self._parsing = False
        if self.transport.is_closing() or self.disconnected:
            self._unparsed.clear()
            return
        if not self.handshake_complete:  # data must wait until the application accepts the WebSocket
            return
        if self._unparsed and (self.queue.empty() or self.close_sent):
            super().data_received(self._unparsed.popleft())
        if self._unparsed:
            if self.queue.empty() or self.close_sent:
                self._parsing = True
                self.loop.call_soon(self._parse_piece)
        elif self.queue.empty():
            self.transport.resume_reading()

    async def receive(self) -> Any:
        """The next message for the application."""
        message = await self.queue.get()
        if self.queue.empty() and not self._parsing:
            self._parse_piece()
        return message

    async def send(self, message: Any) -> None:
        """Sends to the client.

        Raises:
            ClientDisconnected: the client disconnected before the WebSocket was accepted.
        """
        accepting = not self.handshake_complete
        if accepting and self.transport.is_closing():
            raise ClientDisconnected
        await super().send(message)
        if accepting and self.handshake_complete:
            self._parse_piece()

    def handle_connect(self, event: Request) -> None:
        """The head is complete; the application starts in the next iteration of the event loop."""
        super().handle_connect(event)
        if self.response.status_code == 101:
            scope = cast("dict[str, Any]", self.scope)
            scope["extensions"] = {**scope["extensions"], SCOPE_KEY: self.connection}

    def handle_events(self) -> None:
        """Handles frames; too many per second end the WebSocket."""
        now_s = self._clock.monotonic_s()
        if now_s - self._second_start_s >= 1.0:
            self._second_start_s, self._frames_in_second = now_s, 0
        self._frames_in_second += len(self.conn.events)
        if self._frames_in_second > MAX_FRAMES_PER_S:
            self._fail(CLOSE_CODE_POLICY, f"more than {MAX_FRAMES_PER_S} frames in a second")
            return
        super().handle_events()

    def handle_cont(self, event: Frame) -> None:
        """A further part of a message."""
        if len(self.frames) >= MAX_FRAMES:
            self._fail(CLOSE_CODE_TOO_LARGE, f"a message of more than {MAX_FRAMES} frames")
            return
        super().handle_cont(event)

    def handle_ping(self) -> None:
        """Sends a pong, unless too many bytes still wait for the client."""
        if self.unread_bytes() < MAX_UNREAD_PONG_BYTES:
            super().handle_ping()
        else:
            self.conn.data_to_send()  # discards the pong

    # --- for `Connections` ----------------------------------------------------------------------

    def end(self) -> None:
        """Closes the connection immediately."""
        self.transport.abort()

    def unread_bytes(self) -> int:
        """Bytes for the client that still wait in this process."""
        return self.transport.get_write_buffer_size()

    def check(self, now_s: float) -> None:
        """Closes the connection if the client does not read, or does not answer the close frame."""
        if self.transport.is_closing() or self.close_sent:
            if self._closing_since_s is None:
                self._closing_since_s = now_s
            elif now_s - self._closing_since_s > CLOSE_DEADLINE_S:
                self.end()
        elif self._stall.is_stalled(self.unread_bytes()):
            self._fail(CLOSE_CODE_TOO_SLOW, f"nothing was read for {UNREAD_DEADLINE_S:g} s")

    def _fail(self, code: int, reason: str) -> None:
        """Sends a close frame with code and reason; `check` closes the connection if the client does not read
        it."""
        if self.close_sent or self.transport.is_closing():
            return
        self._connections.count_refusal()
        self._unparsed.clear()
        self.queue.put_nowait({"type": "websocket.disconnect", "code": code, "reason": reason})
        self.conn.fail(code, reason)
        self.transport.write(b"".join(self.conn.data_to_send()))
        self.close_sent = True
        self.disconnected = True
        self.writable.set()
        self.transport.close()
