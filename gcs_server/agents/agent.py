"""One agent: its scope, what it has called, and what it was refused."""

from __future__ import annotations

import secrets
from collections import deque
from dataclasses import dataclass, field
from typing import Final

from gcs_server.agents.limits import CallLimit
from gcs_server.control.principal import Principal
from gcs_server.guard.program import Refusal, note_refusal
from gcs_server.settings import AgentScope

MAX_REFUSALS: Final = 20
UNNAMED: Final = "unnamed"
"""Name of agents that sent no token of an agent; they only read."""


@dataclass(frozen=True, slots=True)
class AgentView:
    """An agent, and what it does."""

    name: str
    """Its name; `unnamed`: all that sent no token of an agent."""
    scope: str
    """read, plan, simulated or fly (docs/how-to-give-an-agent-a-simulator.md)."""
    client: str
    """Its name as a client, in the journal and when it has control."""
    client_key: str
    """Key of this client."""
    calls: int
    """Calls since the server's start."""
    refused: int
    """Calls that were refused."""
    last_call_unix_s: float | None
    """When it last called [s since 1970 UTC]; null: never."""
    last_tool: str | None
    """The tool that it called last; null: none."""
    max_calls_per_min: int
    """Calls per minute that it may make."""
    controls: tuple[str, ...]
    """Vehicles that it controls."""
    paused: dict[str, str]
    """Who has overruled it, by vehicle: its commands are refused until a person lets it continue."""
    refusals: tuple[Refusal, ...]
    """What it was refused, newest first."""


@dataclass(slots=True, eq=False)
class Agent:
    """An agent that a person has named, or all unnamed ones."""

    name: str
    scope: AgentScope
    limit: CallLimit
    client_id: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    """`X-Client-Id` of its calls, known to no other client."""
    calls: int = 0
    refused: int = 0
    last_call_unix_s: float | None = None
    last_tool: str | None = None
    paused: dict[str, str] = field(default_factory=dict[str, str])
    commanded_unix_s: dict[str, float] = field(default_factory=dict[str, float])
    """When it last commanded each vehicle [s since 1970 UTC]."""
    refusals: deque[Refusal] = field(default_factory=lambda: deque[Refusal](maxlen=MAX_REFUSALS))

    @property
    def principal(self) -> Principal:
        """The client that it is."""
        return Principal.from_identity(f"agent {self.name}", self.client_id, f"agent {self.name}")

    def refuse(self, unix_s: float, what: str, text: str) -> None:
        """Notes a refusal."""
        self.refused += 1
        note_refusal(self.refusals, unix_s, what, text)

    def view(self, controls: list[str]) -> AgentView:
        """The agent as the API shows it."""
        return AgentView(
            self.name,
            self.scope,
            self.principal.name,
            self.principal.key,
            self.calls,
            self.refused,
            self.last_call_unix_s,
            self.last_tool,
            self.limit.per_min,
            tuple(controls),
            dict(self.paused),
            tuple(self.refusals),
        )
