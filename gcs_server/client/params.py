"""A vehicle's parameters: `vehicle.params.review(…)`, then `vehicle.params.apply(rows)`.

Single parameters are `vehicle.param(name)` and `vehicle.set_param(name, value)`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from gcs_server.client.control import VehicleApi
from gcs_server.client.setpoints import Body


class FileApi(VehicleApi, Protocol):
    """The part of a vehicle that this module uses."""

    async def raw(self, method: str, path: str) -> bytes: ...


class Params:
    """The parameters of one vehicle."""

    def __init__(self, vehicle: FileApi) -> None:
        self._vehicle = vehicle

    async def read(self) -> dict[str, Any]:
        """Reads all parameters, unless they are unchanged; returns the list's state."""
        return await self._vehicle.request("POST", "/params/refresh", {"wait": True})

    async def all(self) -> dict[str, float]:
        """The values that the server has read, by name."""
        return {
            each["name"]: each["value"] for each in (await self._vehicle.request("GET", "/params"))["params"]
        }

    async def review(
        self,
        values: Mapping[str, float] | None = None,
        *,
        file: str | None = None,
        defaults: bool = False,
        of_vehicle: str | None = None,
        undo: bool = False,
        force: bool = False,
    ) -> list[dict[str, Any]]:
        """Compares with the vehicle's parameters; writes nothing.

        Args:
            values: wanted values by name.
            file: instead, the content of a file of QGroundControl (`.params`).
            defaults: instead, the defaults in the vehicle's metadata.
            of_vehicle: instead, the parameters of another vehicle.
            undo: instead, the values before the newest change.
            force: accepts values outside the documented range and choices.

        Returns:
            One row for each: `name`, `old`, `new`, `unit`, `state` (change, same, refused), `problem`, and
            `line` of the file.
        """
        options: Body = {
            "file": file,
            "defaults": defaults,
            "of_vehicle": of_vehicle,
            "undo": undo,
            "force": force,
        }
        body: Body = {name: value for name, value in options.items() if value not in (None, False)}
        if values is not None:
            body = {**body, "changes": [{"name": name, "value": value} for name, value in values.items()]}
        return (await self._vehicle.request("POST", "/param_changes/review", body))["rows"]

    async def apply(
        self,
        rows: Sequence[Mapping[str, Any]],
        *,
        undo: bool = False,
        while_armed: bool = False,
        force: bool = False,
    ) -> dict[str, Any]:
        """Writes the changes of a review; none if one of them cannot be written.

        Args:
            rows: rows of `review`; those that change nothing are left out.
            undo: whether they are those of a review with `undo`.
            while_armed: also writes while the vehicle is armed; the values act at once.
            force: also writes values outside the documented range and choices.

        Returns:
            `last.rows` with the `state` of each (set, not_taken, no_answer, not_written), and `waiting`: what
            takes effect only after a restart.

        Raises:
            Refused: nothing was written; the reasons are in the error.
        """
        changes = [
            {"name": row["name"], "old": row["old"], "value": row["new"]}
            for row in rows
            if row["state"] != "same"
        ]
        if not changes:
            return await self.changes()
        body: Body = {"changes": changes, "undo": undo, "while_armed": while_armed, "force": force}
        return await self._vehicle.request("POST", "/param_changes/apply", body)

    async def file(self) -> str:
        """The parameters that the server has read, as a file of QGroundControl (`.params`)."""
        return (await self._vehicle.raw("GET", "/param_file")).decode()

    async def changes(self) -> dict[str, Any]:
        """What became of the newest change, what waits for a restart, and how much can be undone."""
        return await self._vehicle.request("GET", "/param_changes")
