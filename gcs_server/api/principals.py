"""Creates the `Principal` (the caller's identity) of each request and WebSocket."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends
from starlette.requests import HTTPConnection

from gcs_server.control.principal import Principal

SCOPE_KEY = "gcs.principal"


def principal_of(connection: HTTPConnection) -> Principal:
    """The caller, from the headers `X-Client` and `X-Client-Id`, or else from its address; created once per
    request. Browsers cannot send these headers with a WebSocket; they use `?client=` and `&client_id=`
    instead.
    """
    principal = connection.scope.get(SCOPE_KEY)
    if principal is None:
        name, client_id = _sent_identity(connection)
        address = connection.client.host if connection.client is not None else ""
        principal = connection.scope[SCOPE_KEY] = Principal.from_identity(name, client_id, address)
    return principal


def has_identity(connection: HTTPConnection) -> bool:
    """Whether the caller has sent a name or an id."""
    return any(_sent_identity(connection))


def _sent_identity(connection: HTTPConnection) -> tuple[str, str]:
    headers = connection.headers
    query = connection.query_params if connection.scope["type"] == "websocket" else {}
    return (
        headers.get("x-client") or query.get("client", ""),
        headers.get("x-client-id") or query.get("client_id", ""),
    )


async def get_principal(connection: HTTPConnection) -> Principal:
    """Dependency: the caller. A coroutine, because FastAPI would call a plain function in another thread."""
    return principal_of(connection)


PrincipalDep = Annotated[Principal, Depends(get_principal)]
