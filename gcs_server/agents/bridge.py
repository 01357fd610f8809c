"""`gcs mcp`: passes the calls of an agent that starts programs and talks to them (stdio) to a running server.

It decides nothing: the server knows the agent by its token, and enforces its scope.
"""

from __future__ import annotations

import argparse
import asyncio
import os
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from gcs_server.errors import GcsError
from gcs_server.storage.folder import DataFolder, default_folder
from gcs_server.storage.token import load_token

TOKEN_VARIABLE: Final = "GCS_AGENT_TOKEN"
CALL_TIMEOUT_S: Final = 300.0
"""A command of the server has ended by then."""


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Adds the flags of the command."""
    parser.description = (
        "Passes the calls of an agent (Model Context Protocol, stdio) to a running server. Without the name "
        "or the token of an agent it only reads."
    )
    parser.add_argument(
        "--url", default="http://localhost:8080", help="the server (default http://localhost:8080)"
    )
    parser.add_argument(
        "--agent",
        metavar="NAME",
        help="agent of this computer's server (gcs serve --agent NAME=SCOPE), whose token is in the data "
        f"folder; elsewhere set {TOKEN_VARIABLE}",
    )
    parser.add_argument("--data", type=Path, metavar="FOLDER", help="data folder of the server")


def run(parsed: argparse.Namespace) -> int:
    """Runs the command; returns the exit code.

    Raises:
        GcsError: the package `mcp` is missing, the token cannot be read, or the server does not answer.
    """
    token = os.environ.get(TOKEN_VARIABLE)
    if parsed.agent is not None:
        folder = parsed.data or Path(os.environ.get("GCS_DATA", "") or default_folder())
        file = DataFolder(folder).agent_token(parsed.agent)
        if not file.exists():
            raise GcsError(
                f"A server with the data folder {folder} has no agent {parsed.agent!r}.",
                remedy=f"Start it with --agent {parsed.agent}=simulated, or name its folder with --data.",
            )
        token = load_token(file)
    if find_spec("mcp") is None:
        raise GcsError(
            "The Python package mcp is not installed.",
            remedy="Install it: pip install 'offboard-gcs[agents]'.",
        )
    try:
        asyncio.run(_serve(f"{parsed.url.rstrip('/')}/mcp", token))
    except (ExceptionGroup, OSError) as error:
        raise GcsError(
            f"{parsed.url} cannot be used by an agent: {_first(error)}.",
            remedy="Start the server (gcs serve), or name it with --url; name the agent with --agent.",
        ) from None
    return 0


def _first(error: Exception) -> Exception:
    return _first(error.exceptions[0]) if isinstance(error, ExceptionGroup) else error


async def _serve(url: str, token: str | None) -> None:
    import httpx2
    import mcp_types as types
    from mcp import Client
    from mcp.client.streamable_http import streamable_http_client
    from mcp.server.lowlevel import Server
    from mcp.server.stdio import stdio_server

    headers = {} if token is None else {"Authorization": f"Bearer {token}"}
    async with (
        httpx2.AsyncClient(headers=headers, timeout=CALL_TIMEOUT_S) as http,
        Client(streamable_http_client(url, http_client=http)) as client,
    ):

        async def list_tools(_context: Any, params: Any) -> types.ListToolsResult:
            return await client.list_tools(cursor=_cursor(params))

        async def call_tool(_context: Any, params: Any) -> types.CallToolResult:
            return await client.call_tool(params.name, params.arguments or {})

        async def list_resources(_context: Any, params: Any) -> types.ListResourcesResult:
            return await client.list_resources(cursor=_cursor(params))

        async def read_resource(_context: Any, params: Any) -> types.ReadResourceResult:
            return await client.read_resource(str(params.uri))

        server: Server[Any] = Server(
            "gcs",
            instructions=client.instructions,
            on_list_tools=list_tools,
            on_call_tool=call_tool,
            on_list_resources=list_resources,
            on_read_resource=read_resource,
        )
        async with stdio_server() as (received, sent):
            await server.run(received, sent, server.create_initialization_options())


def _cursor(params: Any) -> str | None:
    return None if params is None else params.cursor
