"""All agents, and the only place where their scopes are enforced: whatever an agent calls passes `call`.

An agent is known by its token, which only `/mcp` accepts; without one it only reads. Its calls then pass the
same routes and rules as those of any other client.
"""

from __future__ import annotations

import asyncio
import hmac
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, Final

from gcs_server.agents.agent import UNNAMED, Agent, AgentView
from gcs_server.agents.answers import answer_text, visible
from gcs_server.agents.calls import Request
from gcs_server.agents.evidence import SendsFrom, why_not_simulated
from gcs_server.agents.flight_requests import FlightRequests, RequestingStation
from gcs_server.agents.limits import CallLimit
from gcs_server.agents.own_tools import OWN_TOOLS, WAIT, OwnTool, Waits
from gcs_server.agents.tools import Tool, includes
from gcs_server.control.principal import Principal
from gcs_server.errors import GcsError, InvalidRequest, Refused
from gcs_server.settings import AgentScope
from gcs_server.supervise import Supervisor
from gcs_server.vehicle.events import Event
from gcs_server.vehicle.fleet import Notice
from gcs_server.vehicle.vehicle import Vehicle

READ: Final = "read"
"""Result in the journal of a call that only read."""
OVERRULING: Final = frozenset({"intervened", "forced"})
"""Changes of control by which another client overrules the one in control."""


class Agents:
    """The agents of a server.

    Args:
        station: the parts of the server that execute commands.
        supervisor: owns the tasks.
        request: calls the API as an agent.
        scopes: scope of each agent by name.
        tokens: token of each agent by name.
        calls_per_min: calls that each agent may make per minute.
        sends_from: whether an address is that of the simulator which this server runs.
    """

    def __init__(
        self,
        station: RequestingStation,
        supervisor: Supervisor,
        request: Request,
        scopes: Mapping[str, AgentScope],
        tokens: Mapping[str, str],
        calls_per_min: int,
        sends_from: SendsFrom,
    ) -> None:
        self._station = station
        self._sends_from = sends_from
        self._unnamed = Agent(UNNAMED, "read", CallLimit(calls_per_min))
        self._agents = {
            tokens[name]: Agent(name, scope, CallLimit(calls_per_min)) for name, scope in scopes.items()
        }
        self._request = request
        self.requests = FlightRequests(station, supervisor, request, self._take_control)
        """The flights that agents ask for."""
        self._waits = Waits(station, self.requests.view)
        station.fleet.subscribe(self._take_event)

    # --- agents ---------------------------------------------------------------------------------

    def all(self) -> list[Agent]:
        """The named agents, and the unnamed ones once they have called."""
        return [*self._agents.values(), *([self._unnamed] if self._unnamed.calls else [])]

    def views(self) -> list[AgentView]:
        """All agents as the API shows them."""
        return [agent.view(self._station.authority.controlled_by(agent.principal)) for agent in self.all()]

    def of_token(self, token: str | None) -> Agent:
        """The agent of a token; without one of an agent, an unnamed agent."""
        given = (token or "").encode()
        for known, agent in self._agents.items():
            if hmac.compare_digest(known.encode(), given):
                return agent
        return self._unnamed

    def require_person(self, client: Principal) -> None:
        """Raises Refused if a client is an agent."""
        if any(agent.principal.key == client.key for agent in self.all()):
            raise Refused("An agent cannot allow itself what a person is asked for.")

    def resume(self, name: str, vehicle_id: str, by: Principal) -> AgentView:
        """Lets an agent command a vehicle again after it was overruled.

        Raises:
            InvalidRequest: there is no such agent.
            Refused: an agent asks.
        """
        self.require_person(by)
        agent = next((each for each in self.all() if each.name == name), None)
        if agent is None:
            names = ", ".join(sorted(each.name for each in self.all())) or "none"
            raise InvalidRequest("name", f"There is no agent {name!r}.", remedy=f"Agents: {names}.")
        agent.paused.pop(vehicle_id, None)
        agent.commanded_unix_s.pop(vehicle_id, None)
        return agent.view(self._station.authority.controlled_by(agent.principal))

    def warnings(self) -> list[Notice]:
        """Agents that wait for a person."""
        notices = [
            Notice(
                "agent",
                f"Agent {each.agent} asks to fly {each.plan_name!r} with vehicle {each.vehicle}.",
                vehicle=each.vehicle,
            )
            for each in self.requests.views()
            if each.state == "waiting"
        ]
        for agent in self.all():
            notices += [
                Notice("agent", f"{text} Agent {agent.name} waits until it may continue.", vehicle=vehicle_id)
                for vehicle_id, text in agent.paused.items()
            ]
        return notices

    # --- calls ----------------------------------------------------------------------------------

    async def call(
        self, agent: Agent, tools: Mapping[str, Tool], name: str, arguments: Mapping[str, Any]
    ) -> tuple[str, bool]:
        """Executes a call of a tool. Returns the answer, and whether it was refused or has failed. Each call
        has a line in the journal: that of its command, or else its own."""
        began_s = self._station.clock.monotonic_s()
        self._begin(agent, name)
        vehicle_id = arguments.get("vehicle")
        vehicle_id = vehicle_id if isinstance(vehicle_id, str) else None
        try:
            self._require_within_limit(agent)
            tool = self._tool(agent, tools, name)
            if isinstance(tool, OwnTool):
                value = await self._own(agent, tool, arguments)
                result = READ if tool is WAIT else "ok"
                self._note(agent, name, vehicle_id, arguments, result, None, began_s)
                return answer_text(value), False
            path, query, body = tool.request(arguments)
            self._require_vehicle(agent, tool, vehicle_id)
        except GcsError as error:
            agent.refuse(self._station.clock.unix_s(), visible(name, 60), visible(str(error)))
            self._note(agent, name, vehicle_id, arguments, error.code, str(error), began_s)
            return _refusal_text(error.code, error.message, error.remedy, error.details()), True
        except asyncio.CancelledError:
            detail = "The agent has closed its connection."
            self._note(agent, name, vehicle_id, arguments, "cancelled", detail, began_s)
            raise
        if vehicle_id is not None and tool.command.control == "lease":
            self._take_control(agent, vehicle_id)
        status, answer = await self._request(agent, tool.method, path, query, body)
        if status < 400:
            if not tool.command.journaled:
                self._note(agent, name, vehicle_id, arguments, READ, None, began_s)
            return answer_text(answer), False
        return self._take_problem(agent, tool, vehicle_id, arguments, answer, began_s), True

    async def _own(self, agent: Agent, tool: OwnTool, arguments: Mapping[str, Any]) -> dict[str, object]:
        """Executes a tool that is no call of the API."""
        if tool is WAIT:
            return await self._waits.wait(agent.principal, arguments)
        dry_run_id = arguments.get("dry_run_id")
        if not isinstance(dry_run_id, str) or len(arguments) > 1:
            raise InvalidRequest("dry_run_id", "The id of the dry run is needed, and nothing else.")
        return asdict(await self.requests.ask(agent, dry_run_id))

    def note_reading(self, agent: Agent, uri: str) -> None:
        """Counts the reading of a document as a call. Raises Refused: it is over the limit."""
        self._begin(agent, uri)
        self._require_within_limit(agent)
        arguments = {"uri": visible(uri)}
        self._note(agent, "read_document", None, arguments, READ, None, self._station.clock.monotonic_s())

    def _begin(self, agent: Agent, name: str) -> None:
        agent.calls += 1
        agent.last_call_unix_s, agent.last_tool = self._station.clock.unix_s(), visible(name, 60)

    def _take_problem(
        self,
        agent: Agent,
        tool: Tool,
        vehicle_id: str | None,
        arguments: Mapping[str, Any],
        answer: Any,
        began_s: float,
    ) -> str:
        """The answer to a call that a route has refused."""
        problem: dict[str, Any] = answer if isinstance(answer, dict) else {"detail": "The server failed."}
        code, detail = str(problem.pop("code", "error")), str(problem.pop("detail", ""))
        remedy = problem.pop("remedy", None)
        agent.refuse(self._station.clock.unix_s(), tool.name, visible(detail))
        if not tool.command.journaled:
            self._note(agent, tool.name, vehicle_id, arguments, code, detail, began_s)
        for name in ("type", "title", "status", "instance"):
            problem.pop(name, None)
        return _refusal_text(code, detail, remedy, problem)

    def _require_within_limit(self, agent: Agent) -> None:
        wait_s = agent.limit.take(self._station.clock.monotonic_s())
        if wait_s > 0.0:
            raise Refused(
                f"An agent may make {agent.limit.per_min} calls per minute.",
                remedy=f"The next call is accepted in {wait_s:.1f} s; the tool `wait` takes one call.",
            )

    def _tool(self, agent: Agent, tools: Mapping[str, Tool], name: str) -> Tool | OwnTool:
        tool = tools.get(name) or OWN_TOOLS.get(name)
        if tool is None:
            accepted = ", ".join(each for each, t in tools.items() if includes(agent.scope, t.scope))
            raise InvalidRequest(
                "name", f"There is no tool {visible(name, 60)!r} for agents.", remedy=f"Tools: {accepted}."
            )
        if not includes(agent.scope, tool.scope):
            raise Refused(
                f"The tool {name} needs the scope {tool.scope!r}, and this agent has {agent.scope!r}. "
                "Nothing was sent.",
                remedy="A person gives another scope when the server is started: "
                f"gcs serve --agent NAME={tool.scope}.",
            )
        return tool

    def _require_vehicle(self, agent: Agent, tool: Tool, vehicle_id: str | None) -> None:
        """Refuses a command to a vehicle that the scope does not include, or that a person has taken over."""
        if not includes(tool.scope, "simulated"):
            return
        vehicle = self._station.fleet.get(vehicle_id or "")
        why = why_not_simulated(vehicle, self._sends_from)
        ends = tool.command.acts == "stops" or tool.name == "control_release"
        holder = None if vehicle.control is None else vehicle.control.status().holder_key
        stops_own = agent.scope == "fly" and ends and holder == agent.principal.key
        if why is not None and not stops_own:
            raise Refused(
                f"Vehicle {vehicle_id} is not proven to be simulated: {why} Nothing was sent.",
                remedy="Commands of agents are accepted for vehicles that this server simulates (--sim), or "
                "on links that a person opened with simulated=1."
                + (" Ask for the flight of a dry run: request_flight." if agent.scope == "fly" else ""),
            )
        self._look_for_pilot(agent, vehicle)
        paused = agent.paused.get(vehicle.id)
        if paused is not None and tool.name not in ("hold", "control_release"):  # Return would undo a Hold
            raise Refused(
                f"{paused} Nothing was sent.",
                remedy="Wait until a person lets this agent continue on the page. Hold and reading are "
                "accepted.",
            )

    def _take_control(self, agent: Agent, vehicle_id: str) -> None:
        """Takes control for a command if the agent may; the vehicle holds if the agent is silent for too
        long."""
        lease, client = self._station.authority.control(vehicle_id).lease, agent.principal
        if lease.refusal(client) is None:  # otherwise the route refuses the command
            is_own = lease.holder is not None and lease.holder.key == client.key
            kept = lease.on_expiry if is_own and lease.on_expiry != "nothing" else None
            lease.take(client, on_expiry=kept or "hold")
            agent.commanded_unix_s[vehicle_id] = self._station.clock.unix_s()

    def _look_for_pilot(self, agent: Agent, vehicle: Vehicle) -> None:
        """Notes that a pilot or another station has taken the vehicle since the agent's newest command."""
        since_unix_s, cause = agent.commanded_unix_s.get(vehicle.id), vehicle.mode_cause
        if since_unix_s is None or cause is None:
            return
        if cause.is_external and cause.since_unix_s > since_unix_s:
            agent.paused.setdefault(vehicle.id, f"The mode was changed by {cause.text}.")

    def _take_event(self, event: Event) -> None:
        """Notes that another client has overruled an agent."""
        data = event.data or {}
        if event.kind != "control" or event.vehicle is None or data.get("action") not in OVERRULING:
            return
        control = data.get("control")
        holder_key = control.get("holder_key") if isinstance(control, dict) else None  # type: ignore[reportUnknownVariableType]
        for agent in self.all():
            key = agent.principal.key
            if data.get("client_key") != key and key in (holder_key, data.get("previous_key")):
                agent.paused[event.vehicle] = event.text

    def _note(
        self,
        agent: Agent,
        name: str,
        vehicle_id: str | None,
        arguments: Mapping[str, Any],
        result: str,
        detail: str | None,
        began_s: float,
    ) -> None:
        duration_s = self._station.clock.monotonic_s() - began_s
        client = agent.principal.name
        self._station.journal.add(
            client, f"agents/{visible(name, 60)}", vehicle_id, dict(arguments), result, detail, duration_s
        )


def _refusal_text(code: str, why: str, accepted: object, details: Mapping[str, object]) -> str:
    value = {"refused": code, "why": why, "accepted": accepted, **details}
    return answer_text(value)
