"""The files on a vehicle: `vehicle.files.list("/fs/microsd")`, `get`, `put`, `remove`, `make_folder`."""

from __future__ import annotations

import base64
from typing import Any, Protocol

from gcs_server.client.control import VehicleApi
from gcs_server.client.plans import Operations
from gcs_server.client.setpoints import Body


class FileApi(VehicleApi, Protocol):
    """The part of a vehicle that this module uses."""

    id: str

    async def raw(self, method: str, path: str) -> bytes: ...


class Files:
    """The files on one vehicle, by MAVLink FTP."""

    def __init__(self, vehicle: FileApi, operations: Operations) -> None:
        self._vehicle, self._operations = vehicle, operations

    async def list(self, path: str = "/") -> list[dict[str, Any]]:
        """The entries of a folder: `name`, `path`, `size_bytes` (None: a folder), and `danger`: what hangs on
        it (None: nothing that is known)."""
        return (await self._vehicle.request("POST", "/files/list", {"path": path}))["entries"]

    async def get(self, path: str, *, timeout_s: float = 600.0) -> bytes:
        """Downloads a file; refused while the vehicle is armed.

        Raises:
            ApiError: the vehicle refused, or the file is too large.
            Timeout: it takes longer; it continues without this program, and the next call takes it up.
        """
        operation = await self._vehicle.request("POST", "/files/get", {"path": path})
        done = await self._operations.wait(operation["id"], timeout_s=timeout_s)
        return await self._vehicle.raw("GET", f"/files/{done['result']['file']}")

    async def put(self, path: str, content: bytes, *, timeout_s: float = 600.0) -> None:
        """Writes a file, at most 700,000 bytes, in place of an earlier one; refused while the vehicle is
        armed. What ends early leaves the earlier file as it was.

        Raises:
            ApiError: the vehicle refused.
            Timeout: it takes longer; it continues without this program.
        """
        body: Body = {
            "path": path,
            "content_base64": base64.b64encode(content).decode(),
            "confirm": f"{path} is written on vehicle {self._vehicle.id}",
        }
        operation = await self._vehicle.request("POST", "/files/put", body)
        await self._operations.wait(operation["id"], timeout_s=timeout_s)

    async def remove(self, path: str) -> None:
        """Removes a file, or an empty folder; it cannot be recovered. Refused while the vehicle is armed."""
        confirm = f"{path} is removed from vehicle {self._vehicle.id}"
        await self._vehicle.request("POST", "/files/remove", {"path": path, "confirm": confirm})

    async def make_folder(self, path: str) -> None:
        """Makes a folder; refused while the vehicle is armed."""
        await self._vehicle.request("POST", "/files/make_folder", {"path": path})
