"""Serves agents at `/mcp`, and calls the API for them in this process: through the same checks as the
requests of any other client."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from starlette.types import ASGIApp, Receive, Scope, Send

from gcs_server.agents.agent import Agent
from gcs_server.agents.agents import Agents
from gcs_server.api.problems import problem
from gcs_server.api.schema import description
from gcs_server.supervise import Supervisor

if TYPE_CHECKING:
    from gcs_server.agents.protocol import Protocol


class InProcessRequests:
    """Calls an application without a socket.

    Args:
        app: the server's application, with all its middleware.
        token: the server's token; None: none is needed.
    """

    def __init__(self, app: ASGIApp, token: str | None) -> None:
        self._app = app
        self._token = token
        self._client: Any = None

    async def __call__(
        self, agent: Agent, method: str, path: str, query: Mapping[str, Any], body: object
    ) -> tuple[int, Any]:
        """Status and body of the answer to an agent's call."""
        if self._client is None:
            import httpx  # takes a tenth of a second, and only agents need it in the server

            transport = httpx.ASGITransport(self._app, raise_app_exceptions=False, client=("agent", 0))
            # A command ends by its own deadlines.
            self._client = httpx.AsyncClient(transport=transport, base_url="http://localhost", timeout=None)
        headers = {"X-Client": agent.principal.name, "X-Client-Id": agent.client_id}
        if self._token is not None:
            headers["Authorization"] = f"Bearer {self._token}"
        response = await self._client.request(method, path, params=query, json=body, headers=headers)
        # A plan of a megabyte takes long to parse.
        return response.status_code, await asyncio.to_thread(response.json)


class AgentsEndpoint:
    """The route `/mcp`. What it needs is loaded at the first call.

    Args:
        agents: the agents.
        supervisor: owns the task that serves them.
    """

    def __init__(self, agents: Agents, supervisor: Supervisor) -> None:
        self._agents, self._supervisor = agents, supervisor
        self._started: asyncio.Future[Protocol] | None = None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers a request of an agent."""
        if self._started is None:
            self._started = asyncio.get_running_loop().create_future()
            self._supervisor.spawn("agents", self._serve(self._started))
        try:
            protocol = await asyncio.shield(self._started)
        except ModuleNotFoundError as error:
            self._started = None
            response = problem(
                501,
                "Not installed",
                "not_installed",
                f"Agents need the Python package {error.name}.",
                remedy="Install it: pip install 'offboard-gcs[agents]'.",
            )
            await response(scope, receive, send)
            return
        await protocol.answer(scope, receive, send)

    async def _serve(self, started: asyncio.Future[Protocol]) -> None:
        try:
            protocol = await asyncio.to_thread(self._load)
        except Exception as error:
            started.set_exception(error)
            return
        async with protocol.running():
            started.set_result(protocol)
            await asyncio.Event().wait()

    def _load(self) -> Protocol:
        from gcs_server.agents.protocol import Protocol

        return Protocol(self._agents, description())
