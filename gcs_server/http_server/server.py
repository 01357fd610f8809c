"""uvicorn's server with its own acceptor and connection limits."""

from __future__ import annotations

import gc
import socket
from collections.abc import Sequence
from typing import Any, cast

import uvicorn

from gcs_server.api.connections import Connection, Connections
from gcs_server.api.refusals import MAX_MESSAGE_BYTES
from gcs_server.clock import Clock, until_next_s
from gcs_server.http_server.acceptor import Acceptor
from gcs_server.http_server.context import ConnectionContext
from gcs_server.http_server.http_protocol import BoundedHttp

KEEP_ALIVE_S = 15
"""How long an idle connection stays open [s]: longer than clients reuse it (httpx: 5 s). Otherwise the server
may close it at the moment when a client sends a request, which then gets no response."""


TICK_S = 0.1
"""uvicorn's period [s]; every tenth tick sets the date of the answers."""
TICKS_PER_DAY = 864_000


class HttpServer(uvicorn.Server):
    """Serves an application on a listening socket, and prints the page's URLs, if any, once it is ready.

    Args:
        app: the application.
        connections: the server's connections and their limits.
        clock: the server's clock.
        page_urls: URLs of the page.
        trusted_proxies: proxies whose headers for the caller's address and scheme are trusted.
    """

    def __init__(
        self,
        app: Any,
        connections: Connections,
        clock: Clock,
        page_urls: Sequence[str],
        trusted_proxies: Sequence[str] = (),
    ) -> None:
        super().__init__(
            uvicorn.Config(
                app,
                log_config=None,
                log_level="warning",
                http="httptools",
                ws="websockets-sansio",
                ws_per_message_deflate=False,
                ws_max_size=MAX_MESSAGE_BYTES,
                access_log=False,
                timeout_keep_alive=KEEP_ALIVE_S,
                proxy_headers=bool(trusted_proxies),
                forwarded_allow_ips=list(trusted_proxies),
                timeout_graceful_shutdown=3,
                lifespan="on",
            )
        )
        self._connections = connections
        self._clock = clock
        self._page_urls = page_urls

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Starts the application, then accepts clients."""
        await super().startup([])
        for listener in sockets or []:
            acceptor = Acceptor(listener, self._create_protocol, self._connections, self._clock)
            acceptor.start()
            self.servers.append(cast(Any, acceptor))
        # Imported objects are never freed. Unless they are frozen, each full garbage collection scans them,
        # pauses the process, and costs as much as decoding a fleet's telemetry. `cli.py` has disabled it.
        gc.freeze()
        gc.enable()
        if self.started and self._page_urls:
            print("Ready: " + "\n       ".join(self._page_urls), flush=True)

    async def main_loop(self) -> None:
        """Does uvicorn's periodic work, as uvicorn does, but together with what else repeats."""
        tick = 0
        while not await self.on_tick(tick):
            tick = (tick + 1) % TICKS_PER_DAY
            await self._clock.sleep(until_next_s(self._clock, TICK_S))

    def _create_protocol(self, connection: Connection) -> BoundedHttp:
        return BoundedHttp(
            ConnectionContext(
                self.config,
                self.server_state,
                self.lifespan.state,
                connection,
                self._connections,
                self._clock,
            )
        )
