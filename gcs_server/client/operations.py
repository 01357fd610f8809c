"""Operations of the server, followed by a program: reading parameters, indexing a recording, …"""

from __future__ import annotations

import asyncio
from typing import Any, Protocol

from gcs_server.client.errors import Timeout, raise_problem
from gcs_server.client.setpoints import Body

POLL_S = 0.25


class Caller(Protocol):
    """The part of `Gcs` that is needed here."""

    async def request(self, method: str, path: str, body: Body | None = None) -> Any: ...


class Operations:
    """The server's running and last ended operations; each as `GET /operations/{o}` answers it."""

    def __init__(self, gcs: Caller) -> None:
        self._gcs = gcs

    async def all(self, vehicle_id: str | None = None) -> list[dict[str, Any]]:
        """The operations of one vehicle, or all; oldest first."""
        found = (await self._gcs.request("GET", "/operations"))["operations"]
        return [each for each in found if vehicle_id in (None, each["vehicle"])]

    async def get(self, operation_id: str) -> dict[str, Any]:
        """One operation: `state`, `progress`, `text`, and once it has ended `result` or `error`."""
        return await self._gcs.request("GET", f"/operations/{operation_id}")

    async def wait(self, operation_id: str, *, timeout_s: float = 60.0) -> dict[str, Any]:
        """Waits for its end: `state` is then `succeeded` or `cancelled`.

        Raises:
            ApiError: it failed, for the reason that the error says.
            Timeout: it still runs; it goes on without this program.
        """
        loop = asyncio.get_running_loop()
        end_s = loop.time() + timeout_s
        while (shown := await self.get(operation_id))["state"] == "running":
            if loop.time() > end_s:
                raise Timeout(f"Operation {operation_id} still runs after {timeout_s:g} s: {shown['text']}")
            await asyncio.sleep(POLL_S)
        if shown["error"] is not None:
            raise_problem(shown["error"])
        return shown

    async def cancel(self, operation_id: str) -> dict[str, Any]:
        """Cancels it, and returns how it ended; one that has ended is not changed."""
        return await self._gcs.request("DELETE", f"/operations/{operation_id}")
