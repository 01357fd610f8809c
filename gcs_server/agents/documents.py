"""What agents can read about this server: its scopes and tools, and the schemas that are too long for a tool.
No I/O."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any, Final

from gcs_server.agents.own_tools import OWN_TOOLS
from gcs_server.agents.tools import LONG_SCHEMAS, Tool, schema_of
from gcs_server.settings import AGENT_SCOPES, AgentScope

SCOPE_TEXTS: Final[Mapping[AgentScope, str]] = {
    "read": "reads; changes nothing",
    "plan": "also writes plans and flies them in simulation (dry runs); commands no vehicle",
    "simulated": "also commands vehicles that are proven to be simulated: by their own identity, and by this "
    "server's simulator or a link that a person opened with simulated=1",
    "fly": "also asks a person to allow the flight of a stored plan whose dry run passed on this vehicle "
    "within five minutes, and stops what it flies",
}
ABOUT: Final = "gcs://docs/agents"
_REFERENCE = re.compile(r'"#/components/schemas/([^"]+)"')


class Documents:
    """The documents by their URI.

    Args:
        tools: the tools of all scopes.
        description: the API's description.
    """

    def __init__(self, tools: Mapping[str, Tool], description: Mapping[str, Any]) -> None:
        self._texts = {ABOUT: _about(tools)}
        self._descriptions = {ABOUT: "What agents may do, and the tools of each scope."}
        for name, (call, argument, text) in LONG_SCHEMAS.items():
            uri = f"gcs://docs/{name}"
            self._texts[uri] = _with_definitions(schema_of(description, call, argument), description)
            self._descriptions[uri] = text

    def descriptions(self) -> dict[str, str]:
        """What each document is, by URI."""
        return self._descriptions

    def read(self, uri: str) -> str | None:
        """A document; None: there is none of this URI."""
        return self._texts.get(uri)


def _about(tools: Mapping[str, Tool]) -> str:
    lines = ["Each scope includes those before it.", ""]
    for scope in AGENT_SCOPES:
        names = [each.name for each in (*tools.values(), *OWN_TOOLS.values()) if each.scope == scope]
        lines.append(f"- {scope}: {SCOPE_TEXTS[scope]}. Tools: {', '.join(names) or 'none'}.")
    lines += [
        "",
        "One client at a time controls a vehicle; a command takes control if nobody has it. A person's Hold, "
        "Land now or Stop motors overrules an agent, whose commands but Hold are then refused until a person "
        "lets it continue. Arguments with which a person accepts findings (`despite`) do not exist for "
        "agents: change the plan instead.",
    ]
    return "\n".join(lines)


def _with_definitions(schema: Mapping[str, Any], description: Mapping[str, Any]) -> str:
    """A schema as JSON, with all that it refers to."""
    schemas = description["components"]["schemas"]
    text, missing = json.dumps(schema), set[str]()
    found = set(_REFERENCE.findall(text))
    while found:
        missing |= found
        found = {n for name in found for n in _REFERENCE.findall(json.dumps(schemas[name]))} - missing
    whole = json.dumps({**schema, "$defs": {name: schemas[name] for name in sorted(missing)}})
    return whole.replace("#/components/schemas/", "#/$defs/")
