"""Agents: language models that call this server over MCP."""

from __future__ import annotations

from fastapi import Response
from pydantic import BaseModel, ConfigDict, Field

from gcs_server.agents.agent import AgentView
from gcs_server.agents.flight_requests import FlightRequestView
from gcs_server.api.guard_routes import RefusalModel
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.reflect import model_of
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import StationDep
from gcs_server.api.strict_body import StrictBody
from gcs_server.control.accepted import authorized_command

router = Routes(prefix="/agents", tags=["agents"], responses=RESPONSES)

AgentModel = model_of(AgentView, "Agent", refusals=list[RefusalModel])
FlightRequestModel = model_of(FlightRequestView, "AgentFlightRequest")


class AgentList(BaseModel):
    """All agents, and the flights that they ask for."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    agents: list[AgentModel] = Field(  # type: ignore[valid-type]
        description="The named agents, and the unnamed ones together once they have called."
    )
    requests: list[FlightRequestModel] = Field(  # type: ignore[valid-type]
        description="The newest flights that agents have asked for, newest first."
    )


class ResumeAgent(StrictBody):
    """Lets an agent command a vehicle again."""

    vehicle: str
    """Id of the vehicle."""


@router.get("", response_model=AgentList)
async def list_agents(station: StationDep) -> Response:
    """The agents: scope, what each called, controls and was refused. They are named with `gcs serve --agent
    NAME=SCOPE` (docs/how-to-give-an-agent-a-simulator.md) and call at `/mcp`."""
    agents = station.agents
    return json_response({"agents": agents.views(), "requests": agents.requests.views()})


@router.post("/{name}/resume", response_model=AgentModel)
async def resume_agent(
    name: str, body: ResumeAgent, station: StationDep, principal: PrincipalDep
) -> Response:
    """Lets an agent command a vehicle again after another client, the pilot or another station has commanded
    it. Nothing is sent to the vehicle."""
    arguments: dict[str, object] = {"name": name, "vehicle": body.vehicle}
    with authorized_command(station, principal, "agents/resume", None, arguments):
        return json_response(station.agents.resume(name, body.vehicle, principal))


@router.post("/requests/{request}/allow", response_model=FlightRequestModel)
async def allow_flight(request: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Allows the flight that an agent asks for: the server uploads and starts the plan, with control for the
    agent. A caller with control gives it to the agent. Refused for agents, and if anything has changed since
    the agent asked. Answers at once; `state` of the request says what has become of it."""
    agents = station.agents
    with authorized_command(station, principal, "agents/allow_flight", None, {"request": request}):
        agents.require_person(principal)
        return json_response(await agents.requests.allow(request, principal))


@router.post("/requests/{request}/refuse", response_model=FlightRequestModel)
async def refuse_flight(request: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Refuses the flight that an agent asks for. Nothing is sent to the vehicle."""
    agents = station.agents
    with authorized_command(station, principal, "agents/refuse_flight", None, {"request": request}):
        agents.require_person(principal)
        return json_response(agents.requests.refuse(request, principal))
