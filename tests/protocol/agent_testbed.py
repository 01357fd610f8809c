"""An agent that calls the routes of the server, on simulated time. What it calls passes `Agents.call`."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec

from gcs_server.agents.agent import Agent
from gcs_server.agents.agents import Agents
from gcs_server.agents.answers import UNTRUSTED
from gcs_server.agents.tools import all_tools
from gcs_server.api.agent_calls import InProcessRequests
from gcs_server.api.permission import bind_commands
from gcs_server.api.schema import bare_app, description
from gcs_server.plans.dry_run_worker import fly
from gcs_server.plans.dry_runs import DryRuns
from gcs_server.plans.store import PlanStore
from gcs_server.settings import AgentScope
from tests.protocol.api_calls import run_with_routes

TOOLS = all_tools(description())
SCOPES: dict[str, AgentScope] = {
    "reader": "read", "planner": "plan", "pilot": "simulated", "flyer": "fly", "other": "simulated"
}  # fmt: skip


class CallingAgent:
    """One agent as its client sees it."""

    def __init__(self, agents: Agents, agent: Agent) -> None:
        self.agents, self.agent = agents, agent

    async def call(self, tool: str, /, **arguments: Any) -> Any:
        """The answer of a tool; a refusal has `refused`."""
        text, failed = await self.agents.call(self.agent, TOOLS, tool, arguments)
        answer = json.loads(text)[UNTRUSTED]
        assert failed == (isinstance(answer, dict) and "refused" in answer)
        return answer

    async def refusal(self, tool: str, /, **arguments: Any) -> str:
        """Why a call is refused."""
        answer = await self.call(tool, **arguments)
        assert "refused" in answer, answer
        return answer["why"]


def with_plans(station: Any, folder: Path) -> None:
    """Gives a station a store of plans in this folder, and dry runs."""
    station.flights.plans = PlanStore(folder, station.clock, station.fleet.events)
    station.flights.dry_runs = InlineDryRuns()


def with_agents(
    station: Any, supervisor: Any, *, simulated: bool = True, calls_per_min: int = 600
) -> dict[str, CallingAgent]:
    """Agents of each scope.

    Args:
        station: the station.
        supervisor: owns the tasks.
        simulated: whether the server says that it simulates the vehicles.
        calls_per_min: the limit of calls.
    """
    tokens = {name: f"{name}-token" for name in SCOPES}
    app = bare_app()
    requests = InProcessRequests(app, None)
    agents = station.agents = Agents(
        station, supervisor, requests, SCOPES, tokens, calls_per_min, lambda _: simulated
    )
    app.state.station, app.state.record_invalid_request = station, lambda *_: None
    bind_commands(app)
    return {name: CallingAgent(agents, agents.of_token(token)) for name, token in tokens.items()}


class InlineDryRuns(DryRuns):
    """Flies dry runs in this process: simulated time would advance while the loop waits for another one."""

    async def run(self, dry_run_id, plan, request, details, report, client_key):
        line = {**request, "plan": plan.decode(), "id": dry_run_id, "details": details}
        summary, body = fly(json.loads(msgspec.json.encode(line)), report)
        self._store(dry_run_id, body, plan)
        return {"dry_run": dry_run_id, **summary}


def run_with_agents(run_simulated: Any, scenario: Any, *, flying: bool = True, **options: Any) -> None:
    """Runs a test with a scripted vehicle and agents; `rig.agents` has them by name."""

    async def run(rig: SimpleNamespace) -> None:
        rig.agents = with_agents(rig.station, rig.testbed.supervisor, **options)
        await scenario(rig)

    run_with_routes(run_simulated, run, flying=flying)
