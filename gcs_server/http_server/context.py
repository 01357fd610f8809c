"""The context that a connection passes from HTTP to WebSocket."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from uvicorn.config import Config
from uvicorn.server import ServerState

from gcs_server.api.connections import Connection, Connections
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
