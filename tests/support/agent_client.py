"""An agent outside the server: a server that knows it, and its calls with the client of the package `mcp`."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import subprocess
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx2
from mcp import Client
from mcp.client.streamable_http import streamable_http_client

from gcs_server.agents.answers import UNTRUSTED
from gcs_server.storage.folder import DataFolder
from tests.station import free_port, is_up, running_process, server_command, wait_for_start


@contextlib.contextmanager
def server_with_agent(
    folder: Path, agent: str, links: Sequence[str], arguments: Sequence[str] = ()
) -> Iterator[str]:
    """Runs a server with one agent.

    Args:
        folder: the data folder; the server's output goes to a file in it.
        agent: `name=scope`.
        links: URLs of the links.
        arguments: further arguments of `gcs serve`.
    """
    port, output = free_port(socket.SOCK_STREAM), folder / "output.log"
    url = f"http://127.0.0.1:{port}"
    command = [*server_command(port, links, folder), "--agent", agent, *arguments]
    with (
        output.open("wb") as file,
        running_process(command, stdout=file, stderr=subprocess.STDOUT) as process,
    ):
        wait_for_start(process, lambda: is_up(url), output)
        yield url


@dataclass(frozen=True)
class OutsideAgent:
    """The calls of an agent, each on a connection of its own, because the server keeps no sessions."""

    url: str
    folder: Path
    name: str
    timeout_s: float = 90
    """After this time the agent closes its connection."""

    def call(self, tool: str, /, **arguments: Any) -> Any:
        """The answer of a tool; a refusal has `refused`."""
        with ThreadPoolExecutor(1) as thread:  # Playwright's tests already run in an event loop
            return thread.submit(asyncio.run, self._call(tool, arguments)).result()

    def done(self, tool: str, /, **arguments: Any) -> Any:
        """The answer of a tool that is not refused."""
        answer = self.call(tool, **arguments)
        assert "refused" not in answer, answer
        return answer

    async def _call(self, tool: str, arguments: dict[str, Any]) -> Any:
        token = DataFolder(self.folder).agent_token(self.name).read_text().strip()
        async with (
            httpx2.AsyncClient(headers={"Authorization": f"Bearer {token}"}, timeout=self.timeout_s) as http,
            Client(streamable_http_client(f"{self.url}/mcp", http_client=http)) as client,
        ):
            result = await client.call_tool(tool, arguments)
            return json.loads(result.content[0].text)[UNTRUSTED]
