"""How an agent's calls reach the API."""

from __future__ import annotations

from collections.abc import Awaitable, Mapping
from typing import Any, Protocol

from gcs_server.agents.agent import Agent


class Request(Protocol):
    """Calls the API as an agent."""

    def __call__(
        self, agent: Agent, method: str, path: str, query: Mapping[str, Any], body: object
    ) -> Awaitable[tuple[int, Any]]:
        """Status and body of the answer."""
        ...
