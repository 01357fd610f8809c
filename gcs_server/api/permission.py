"""Checks before each route whether the caller's role includes the route's command (`control/commands.py`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from fastapi import FastAPI
from fastapi.routing import iter_route_contexts
from starlette.exceptions import WebSocketException
from starlette.requests import HTTPConnection

from gcs_server.api.principals import principal_of
from gcs_server.control.commands import BY_CALL, Command
from gcs_server.control.principal import Principal
from gcs_server.errors import NotPermitted

POLICY_VIOLATION = 1008


def calls_of(app: FastAPI) -> Iterator[tuple[str, Callable[..., Any] | None]]:
    """Call (`METHOD /path`) and endpoint of every route. The method of a WebSocket is `WS`; mounted files
    have no endpoint."""
    for route in iter_route_contexts(app.routes):
        if route.endpoint is None:
            yield f"GET {route.path or '/'}", None
            continue
        for method in sorted(route.methods - {"HEAD"}) if route.methods else ("WS",):
            yield f"{method} {route.path_format or route.path}", route.endpoint


def bind_commands(app: FastAPI) -> None:
    """Binds each route to its row of the command table; called once all routes exist.

    Raises:
        RuntimeError: a route has no row.
    """
    commands: dict[Callable[..., Any], Command] = {}
    for call, endpoint in calls_of(app):
        command = BY_CALL.get(call)
        if command is None:
            raise RuntimeError(f"{call} has no row in control/commands.py: add one with its requirements.")
        if endpoint is not None and commands.setdefault(endpoint, command) is not command:
            raise RuntimeError(f"{call}: its function already serves {commands[endpoint].name}, too.")
    app.state.commands = commands


def command_of(connection: HTTPConnection) -> Command:
    """The command of the matched route."""
    return connection.app.state.commands[connection.scope["endpoint"]]


def require_permission(principal: Principal, command: Command) -> None:
    """Refuses a command that the caller's role does not include.

    Raises:
        NotPermitted: the caller's role does not include the command.
    """
    if command.permission is not None and command.permission not in principal.permissions:
        raise NotPermitted(str(principal), command.name, command.permission)


async def check_permission(connection: HTTPConnection) -> None:
    """Checks the permission for the matched route; a refusal is written to the journal.

    Raises:
        NotPermitted: the caller's role does not include the command.
    """
    command, principal = command_of(connection), principal_of(connection)
    try:
        require_permission(principal, command)
    except NotPermitted as error:
        if command.journaled:
            vehicle = connection.path_params.get("v")
            journal = connection.app.state.station.journal
            journal.add(principal.name, command.name, vehicle, {}, error.code, str(error), 0.0)
        if connection.scope["type"] == "websocket":  # closed before it is accepted
            raise WebSocketException(POLICY_VIOLATION, error.code) from error
        raise
