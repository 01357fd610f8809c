"""The tools of agents, made from the table of commands and the description of the API. No I/O.

A tool is one call of the API. Its arguments are those of the path, of the query and of the body, so that it
cannot differ from what the server accepts. Arguments by which a person accepts a danger are left out.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final
from urllib.parse import quote

from gcs_server.control.commands import ALL, API, Command
from gcs_server.errors import InvalidRequest
from gcs_server.settings import AGENT_SCOPES, AgentScope

FOR_PERSONS: Final = frozenset({"despite", "confirm", "force", "hold_first"})
"""Arguments with which a person accepts findings or dangers, or overrules another client."""
LONG_SCHEMAS: Final = {
    "plans": (f"POST {API}/plans", "plan", "Schema of waypoint plans and offboard missions."),
    "setpoints": (f"POST {API}/vehicles/{{v}}/offboard/setpoint", "setpoint", "Schema of setpoints."),
}
"""Schemas that are documents, because a tool's own would be too long: call and argument of each."""
_DOCUMENT_OF: Final = {"plan": "plans", "mission": "plans", "setpoint": "setpoints"}
MAX_DESCRIPTION: Final = 900
_HEIGHT: Final = {"value_m": 10, "reference": "home"}
_HOME: Final = {"lat_deg": 47.397742, "lon_deg": 8.545594}
PLAN_EXAMPLE: Final = {
    "items": [
        {"kind": "takeoff", **_HOME, "altitude": _HEIGHT},
        {"kind": "waypoint", "lat_deg": 47.39785, "lon_deg": 8.545594, "altitude": _HEIGHT},
        {"kind": "land", **_HOME, "altitude": {"value_m": 0, "reference": "home"}},
    ],
}
"""A plan as an agent may send it."""
_VARIABLE = re.compile(r"(\w+)/\{(\w+)\}")


@dataclass(frozen=True, slots=True)
class Tool:
    """One call of the API as a tool."""

    name: str
    command: Command
    method: str
    path: str
    """With `{variable}`."""
    description: str
    schema: dict[str, Any]
    """JSON schema of the arguments."""
    in_path: Mapping[str, str]
    """Name of the argument, by name of the path's variable."""
    in_query: frozenset[str]
    in_body: frozenset[str] = field(default=frozenset())

    @property
    def scope(self) -> AgentScope:
        """The least scope of agents that have it."""
        assert self.command.agent is not None
        return self.command.agent

    @property
    def reads(self) -> bool:
        """Whether it changes nothing."""
        return self.scope == "read"

    def request(self, arguments: Mapping[str, Any]) -> tuple[str, dict[str, Any], dict[str, Any] | None]:
        """Path, query and body of a call.

        Raises:
            InvalidRequest: an argument is missing or unknown.
        """
        known = {*self.in_path.values(), *self.in_query, *self.in_body}
        for name in arguments.keys() - known:
            accepted = ", ".join(sorted(known)) or "none"
            raise InvalidRequest(
                name, f"{self.name} has no argument {name!r}.", remedy=f"Accepted: {accepted}."
            )
        path = self.path
        for variable, name in self.in_path.items():
            value = arguments.get(name)
            if not isinstance(value, str) or not value:
                raise InvalidRequest(name, f"{self.name} needs {name!r}, a text.")
            path = path.replace(f"{{{variable}}}", quote(value, safe=""))
        query = {name: arguments[name] for name in self.in_query if arguments.get(name) is not None}
        body = {name: arguments[name] for name in self.in_body if name in arguments} if self.in_body else None
        if body is not None and self.command.confirm_text is not None:
            # That a person wants it follows from the scope instead.
            body["confirm"] = self.command.confirmation_text(vehicle=arguments["vehicle"])
        return path, query, body


def includes(scope: AgentScope, needed: AgentScope) -> bool:
    """Whether a scope includes another one."""
    return AGENT_SCOPES.index(scope) >= AGENT_SCOPES.index(needed)


def tool_name(command: Command, call: str) -> str:
    """The name of a tool: the command's name, or else that of the path: `read_vehicle_mission`."""
    if len(command.agent_calls) < 2:
        return command.name.replace("/", "_")
    method, path = call.split(" ", 1)
    words = _VARIABLE.sub(lambda m: m[1].removesuffix("s"), path.removeprefix(API)).strip("/")
    return ("read_" if method == "GET" else "") + words.replace("/", "_")


def all_tools(description: Mapping[str, Any]) -> dict[str, Tool]:
    """All tools of all scopes by name, from the API's description."""
    tools = [_tool(command, call, description) for command in ALL for call in command.full_agent_calls()]
    return {tool.name: tool for tool in tools}


def _tool(command: Command, call: str, description: Mapping[str, Any]) -> Tool:
    method, path = call.split(" ", 1)
    operation = description["paths"][path][method.lower()]
    schemas = description["components"]["schemas"]
    arguments = {m[2]: _argument_name(m[1]) for m in _VARIABLE.finditer(path)}
    properties: dict[str, Any] = {}
    required: list[str] = []
    in_query: set[str] = set()
    for parameter in operation.get("parameters", []):
        name = parameter["name"]
        if parameter["in"] == "header" or name in FOR_PERSONS:
            continue
        if parameter["in"] == "query":
            in_query.add(name)
        shown = arguments[name] if parameter["in"] == "path" else name
        text = parameter.get("description")
        properties[shown] = {
            **_inlined(parameter["schema"], schemas),
            **({"description": text} if text else {}),
        }
        if parameter.get("required"):
            required.append(shown)
    body = _body(operation, schemas)
    fields = {name: each for name, each in body.get("properties", {}).items() if name not in FOR_PERSONS}
    for name, each in fields.items():
        properties[name] = _short(name, _inlined(each, schemas))
    required += [name for name in body.get("required", []) if name in fields]
    schema = {"type": "object", "properties": properties, "required": required, "additionalProperties": False}
    in_body = frozenset(fields) | (frozenset({"confirm"} & body.get("properties", {}).keys()))
    return Tool(
        tool_name(command, call.replace(API, "", 1)),
        command,
        method,
        path,
        " ".join(operation.get("description", operation.get("summary", "")).split())[:MAX_DESCRIPTION],
        schema,
        arguments,
        frozenset(in_query),
        in_body,
    )


def _argument_name(folder: str) -> str:
    """Name of the argument for the variable after a part of the path, as in bodies: `plans` → `plan_id`."""
    name = folder.removesuffix("s")
    return name if name in ("vehicle", "param") else f"{name}_id"


def _body(operation: Mapping[str, Any], schemas: Mapping[str, Any]) -> dict[str, Any]:
    """The schema of the request's object; empty: it has none."""
    content = operation.get("requestBody", {}).get("content", {})
    schema: dict[str, Any] = next(iter(content.values()))["schema"] if content else {}
    for each in (schema, *schema.get("anyOf", [])):
        resolved = schemas[each["$ref"].rpartition("/")[2]] if "$ref" in each else each
        if "properties" in resolved:
            return resolved
    return {}


def _inlined(schema: Any, schemas: Mapping[str, Any], within: tuple[str, ...] = ()) -> Any:
    """A schema without references; what refers to itself becomes an object."""
    if isinstance(schema, list):
        return [_inlined(each, schemas, within) for each in schema]  # type: ignore[reportUnknownVariableType]
    if not isinstance(schema, dict):
        return schema
    reference = schema.get("$ref")  # type: ignore[reportUnknownVariableType]
    if isinstance(reference, str):
        name = reference.rpartition("/")[2]
        # Nothing that a tool shows is nested deeper; a plan's schema would be a megabyte.
        if name in within or len(within) > 3:
            return {"type": "object"}
        rest = {k: v for k, v in schema.items() if k != "$ref"}  # type: ignore[reportUnknownVariableType]
        return {**_inlined(schemas[name], schemas, (*within, name)), **rest}
    shown = {
        key: _inlined(value, schemas, within)
        for key, value in schema.items()  # type: ignore[reportUnknownVariableType]
        if key not in ("title", "discriminator", "examples", "properties")
    }
    properties: object = schema.get("properties")  # type: ignore[reportUnknownVariableType]
    if isinstance(properties, dict):
        shown["properties"] = {
            name: _inlined(value, schemas, within)
            for name, value in properties.items()  # type: ignore[reportUnknownVariableType]
            if name not in FOR_PERSONS
        }
    return shown


def _short(name: str, schema: dict[str, Any]) -> dict[str, Any]:
    """The schema of an argument, or where it is."""
    if (document := _DOCUMENT_OF.get(name)) is None:
        return schema
    text = f"Its schema is the resource gcs://docs/{document}."
    if document == "plans":
        text = f"A waypoint plan or an offboard mission. {text} A short plan: {json.dumps(PLAN_EXAMPLE)}"
    return {"type": "object", "description": text}


def schema_of(description: Mapping[str, Any], call: str, argument: str) -> dict[str, Any]:
    """The schema of an argument of a call's body, with references."""
    method, path = call.split(" ", 1)
    operation = description["paths"][path][method.lower()]
    return _body(operation, description["components"]["schemas"])["properties"][argument]
