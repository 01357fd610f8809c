"""Accepts connections: a few per iteration of the event loop, and only within the limits of `Connections`.

asyncio's own acceptor accepts all waiting connections at once, and without free file descriptors it logs a
traceback for each of them every second.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import logging
import resource
import socket
from collections.abc import Callable

from gcs_server.api.connections import Connection, Connections
from gcs_server.api.refusals import SERVER_FULL
from gcs_server.clock import Clock
from gcs_server.http_server.http_protocol import raw_response
from gcs_server.supervise import Supervisor

log = logging.getLogger(__name__)

ACCEPTED_PER_YIELD = 4
CHECK_PERIOD_S = 0.5
NO_RESOURCES = frozenset({errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM})
"""Errors without a free file descriptor or memory."""
NO_RESOURCES_PAUSE_S = 0.2
WANTED_LIMIT = 4096
"""Limit of open files that is sufficient for all clients."""
RESERVED = 256
"""Descriptors reserved for MAVLink links, recordings, the stream process, the journal and the page's
files."""


class Acceptor:
    """Accepts the connections of one listening socket.

    Args:
        listener: bound, listening, not blocking.
        protocol_factory: creates the protocol of a new connection.
        connections: decides whether a connection is served.
        clock: the server's clock.
    """

    def __init__(
        self,
        listener: socket.socket,
        protocol_factory: Callable[[Connection], asyncio.Protocol],
        connections: Connections,
        clock: Clock,
    ) -> None:
        self._listener = listener
        self._protocol_factory = protocol_factory
        self._connections = connections
        self._clock = clock
        self._supervisor = Supervisor(clock)
        self._accepting: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Starts accepting connections."""
        self._accepting = self._supervisor.start("acceptor", self._accept_loop)
        self._supervisor.repeat("deadlines of connections", self._connections.check, CHECK_PERIOD_S)

    def close(self) -> None:
        """Stops accepting; deadlines stay in force until the event loop ends."""
        if self._accepting is not None:
            self._accepting.cancel()

    async def wait_closed(self) -> None:
        """Does nothing; uvicorn calls this method."""

    async def _accept_loop(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            for _ in range(ACCEPTED_PER_YIELD):
                try:
                    accepted, address = await loop.sock_accept(self._listener)
                except OSError as error:
                    await self._handle_failure(error)
                    break
                self._register(accepted, str(address[0]))
            await asyncio.sleep(0)

    def _register(self, accepted: socket.socket, address: str) -> None:
        connection = self._connections.open(address)
        if connection is None:
            _refuse(accepted)
            return
        self._supervisor.spawn("connection", self._connect(accepted, connection))

    async def _connect(self, accepted: socket.socket, connection: Connection) -> None:
        loop = asyncio.get_running_loop()
        try:
            await loop.connect_accepted_socket(lambda: self._protocol_factory(connection), accepted)
        except OSError:  # the connection is already closed
            self._connections.remove(connection)
            accepted.close()

    async def _handle_failure(self, error: OSError) -> None:
        """Handles a failure to accept. Without a free file descriptor, clients wait in the socket's queue."""
        if error.errno not in NO_RESOURCES:
            return  # the client disconnected before it was accepted
        log.warning("no connection can be accepted: %s", error.strerror)
        self._connections.count_refusal()
        await self._clock.sleep(NO_RESOURCES_PAUSE_S)


def _refuse(accepted: socket.socket) -> None:
    """Sends the refusal without waiting, and closes the connection."""
    with accepted, contextlib.suppress(OSError):
        accepted.setblocking(False)
        accepted.send(raw_response(SERVER_FULL))
        accepted.shutdown(socket.SHUT_WR)


def raise_descriptor_limit() -> int:
    """Raises the process's soft limit to `WANTED_LIMIT`, or to a lower hard limit. Returns the number of
    client connections that leave `RESERVED` descriptors free.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    limit = soft
    if soft != resource.RLIM_INFINITY and soft < WANTED_LIMIT:
        limit = WANTED_LIMIT if hard == resource.RLIM_INFINITY else min(WANTED_LIMIT, hard)
        try:
            resource.setrlimit(resource.RLIMIT_NOFILE, (limit, hard))
        except (OSError, ValueError):
            limit = soft
    if limit == resource.RLIM_INFINITY:
        return WANTED_LIMIT
    if limit < WANTED_LIMIT:
        log.warning(
            "This process may open %d files only (ulimit -n): fewer clients can connect at once. "
            "%d or more are better.",
            limit,
            WANTED_LIMIT,
        )
    return max(limit - RESERVED, limit // 2)
