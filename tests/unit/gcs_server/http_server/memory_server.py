"""A fake HTTP server for tests: connections without sockets, on simulated time."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

from uvicorn import Config
from uvicorn.server import ServerState

from gcs_server.api.connections import Connections
from gcs_server.clock import LoopClock
from gcs_server.http_server.context import ConnectionContext
from gcs_server.http_server.http_protocol import BoundedHttp
from gcs_server.scenarios.simulated_time import run_on_simulated_time


class Transport(asyncio.Transport):
    """The server's end of a connection; while `client_reads` is false, written bytes stay in `unread`."""

    def __init__(self) -> None:
        super().__init__()
        self.written, self.unread = b"", b""
        self.closed = self.eof_written = self.reading_paused = self.aborted = False
        self.client_reads = True
        self.protocol: Any = None

    def write(self, data: Any) -> None:
        if self.client_reads:
            self.written += data
        else:
            self.unread += data
            self.protocol.pause_writing()

    def get_write_buffer_size(self) -> int:
        return len(self.unread)

    def close(self) -> None:
        if not self.closed:
            self.closed = True
            if not self.unread:
                self._report_closed()

    def abort(self) -> None:
        self.closed = self.aborted = True
        self._report_closed()

    def _report_closed(self) -> None:
        asyncio.get_running_loop().call_soon(self.protocol.connection_lost, None)

    def is_closing(self) -> bool:
        return self.closed

    def can_write_eof(self) -> bool:
        return True

    def write_eof(self) -> None:
        self.eof_written = True

    def pause_reading(self) -> None:
        self.reading_paused = True

    def resume_reading(self) -> None:
        self.reading_paused = False

    def set_protocol(self, protocol: Any) -> None:
        self.protocol = protocol

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        return {"peername": ("10.0.0.1", 5), "sockname": ("127.0.0.1", 80)}.get(name, default)


class TestedServer:
    """A server for one application, with its connections."""

    def __init__(self, app: Any) -> None:
        self.clock = LoopClock(asyncio.get_running_loop())
        self.connections = Connections(self.clock)
        self._config = Config(app, ws="websockets-sansio", log_config=None, ws_max_size=1 << 20)
        self._config.load()
        self._state = ServerState()

    def connect(self) -> Transport:
        """A new connection."""
        connection = self.connections.open("10.0.0.1")
        assert connection is not None
        protocol = BoundedHttp(
            ConnectionContext(self._config, self._state, {}, connection, self.connections, self.clock)
        )
        transport = Transport()
        transport.protocol = protocol
        protocol.connection_made(transport)
        return transport

    async def wait(self, seconds: float) -> None:
        """Waits; the server checks its deadlines every half second."""
        end_s = self.clock.monotonic_s() + seconds
        while self.clock.monotonic_s() < end_s:
            await asyncio.sleep(0.5)
            self.connections.check()

    async def send(self, transport: Transport, data: bytes, piece_bytes: int = 262_144) -> int:
        """Sends until the server stops reading; returns the number of bytes that the server has received."""
        for start in range(0, len(data), piece_bytes):
            for _ in range(2000):  # the application needs many iterations of the loop to read
                if not transport.reading_paused:
                    break
                await asyncio.sleep(0)
            if transport.closed or transport.reading_paused:
                return start
            transport.protocol.data_received(data[start : start + piece_bytes])
        for _ in range(50):  # the application needs some iterations to respond
            await asyncio.sleep(0)
        return len(data)


async def respond_with_size(scope: Any, receive: Any, send: Any) -> None:
    """An application that responds with the size of the body, and reads a WebSocket until it closes."""
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.accept"})
        while (await receive())["type"] == "websocket.receive":
            pass
        return
    size, more_body = 0, True
    while more_body:
        message = await receive()
        if message["type"] == "http.disconnect":
            return
        size += len(message["body"])
        more_body = message["more_body"]
    body = b"%d bytes" % size
    headers = [(b"content-length", str(len(body)).encode())]
    await send({"type": "http.response.start", "status": 200, "headers": headers})
    await send({"type": "http.response.body", "body": body})


def run_with_server(
    scenario: Callable[[TestedServer], Coroutine[Any, Any, None]], app: Any = respond_with_size
) -> None:
    """Runs a scenario with a server."""

    async def run() -> None:
        await scenario(TestedServer(app))

    run_on_simulated_time(run)
