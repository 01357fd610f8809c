"""Operations of the server, such as reading parameters or indexing a recording."""

from __future__ import annotations

import asyncio
from typing import Any, Protocol

from gcs_server.client.errors import Timeout, raise_problem
from gcs_server.client.setpoints import Body

POLL_S = 0.25


class GcsApi(Protocol):
    """The part of `Gcs` that this module uses."""

    async def request(self, method: str, path: str, body: Body | None = None) -> Any: ...


class Operations:
    """The server's operations, running or recently ended, each in the form of `GET /operations/{o}`."""

    def __init__(self, gcs: GcsApi) -> None:
        self._gcs = gcs

    async def all(self, vehicle_id: str | None = None) -> list[dict[str, Any]]:
        """The operations of one vehicle, or all; oldest first."""
        operations = (await self._gcs.request("GET", "/operations"))["operations"]
        return [operation for operation in operations if vehicle_id in (None, operation["vehicle"])]

    async def get(self, operation_id: str) -> dict[str, Any]:
        """One operation: `state`, `progress`, `text`, and at the end `result` or `error`."""
        return await self._gcs.request("GET", f"/operations/{operation_id}")

    async def wait(self, operation_id: str, *, timeout_s: float = 60.0) -> dict[str, Any]:
        """Waits for the end and returns the operation; its `state` is `succeeded` or `cancelled`.

        Raises:
            ApiError: the operation failed; the error contains the reason.
            Timeout: the operation is still running, and continues without this program.
        """
        loop = asyncio.get_running_loop()
        end_s = loop.time() + timeout_s
        while (operation := await self.get(operation_id))["state"] == "running":
            if loop.time() > end_s:
                raise Timeout(
                    f"Operation {operation_id} is still running after {timeout_s:g} s: {operation['text']}"
                )
            await asyncio.sleep(POLL_S)
        if operation["error"] is not None:
            raise_problem(operation["error"])
        return operation

    async def cancel(self, operation_id: str) -> dict[str, Any]:
        """Cancels an operation and returns its final state; an ended operation is not changed."""
        return await self._gcs.request("DELETE", f"/operations/{operation_id}")
