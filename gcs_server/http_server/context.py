"""What a connection passes from HTTP to WebSocket, and what both do with a client that does not read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from uvicorn.config import Config
from uvicorn.server import ServerState

from gcs_server.api.connections import Connection, Connections
from gcs_server.api.refusals import UNREAD_DEADLINE_S
from gcs_server.clock import Clock


@dataclass(frozen=True, slots=True)
class ConnectionContext:
    """One connection, with the objects shared by all connections."""

    config: Config
    server_state: ServerState
    app_state: dict[str, Any]
    """State of the application's lifespan."""
    connection: Connection
    """The entry of this connection in `connections`."""
    connections: Connections
    clock: Clock

    @property
    def uvicorn_arguments(self) -> tuple[Config, ServerState, dict[str, Any]]:
        """The arguments of uvicorn's own protocols."""
        return self.config, self.server_state, self.app_state


class StallDetector:
    """Detects that the client of one connection reads nothing.

    Args:
        clock: the server's clock.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._last_bytes = 0
        self._since_s = 0.0

    def is_stalled(self, unread_bytes: int) -> bool:
        """Whether the client has read nothing for `UNREAD_DEADLINE_S`; call periodically.

        Args:
            unread_bytes: bytes for the client that still wait in this process.
        """
        now_s = self._clock.monotonic_s()
        if not unread_bytes or unread_bytes < self._last_bytes or not self._last_bytes:
            self._since_s = now_s
        self._last_bytes = unread_bytes
        return bool(unread_bytes) and now_s - self._since_s > UNREAD_DEADLINE_S
