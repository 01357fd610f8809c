"""What a connection is handed from HTTP to WebSocket."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from uvicorn.config import Config
from uvicorn.server import ServerState

from gcs_server.api.connections import Connection, Connections
from gcs_server.clock import Clock


@dataclass(frozen=True, slots=True)
class ConnectionContext:
    """One connection, and what serves all of them."""

    config: Config
    server_state: ServerState
    app_state: dict[str, Any]
    """Of the application's lifespan."""
    connection: Connection
    """Its place among the others."""
    connections: Connections
    clock: Clock

    @property
    def of_uvicorn(self) -> tuple[Config, ServerState, dict[str, Any]]:
        """What uvicorn's own protocols take."""
        return self.config, self.server_state, self.app_state
