"""Remembers over a restart of the server which items a vehicle has, by the ids that the vehicle reports.

PX4's ids are checksums of the items, so equal ids mean equal items. Only items of a known plan are stored,
after they were read back from the vehicle. A lost or damaged file only means that the plan is not known.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from dataclasses import asdict, astuple
from functools import partial
from typing import Any

from gcs_server.storage.cache import Cache
from gcs_server.vehicle.services.mission_dialogue import PARTS, Part
from gcs_server.vehicle.services.mission_held import HeldItems, Ids, PlanReference
from missions.formats.mavlink_items import WireItem

RunInThread = Callable[[Callable[[], Any]], Awaitable[Any]]
FORMAT = 1
_TYPES = (int, int, int, float, float, float, float, int, int, float, bool, bool)
"""Types of the fields of a `WireItem`, in order."""


class HeldCache:
    """Items of vehicles, one file for each vehicle and plan.

    Args:
        cache: stores the files.
        run_in_thread: `asyncio.to_thread`, except in tests.
    """

    def __init__(self, cache: Cache, run_in_thread: RunInThread = asyncio.to_thread) -> None:
        self._cache = cache
        self._run_in_thread = run_in_thread

    async def store(self, system_id: int, held: HeldItems) -> None:
        """Stores the items of a known plan, if the vehicle reports ids."""
        if held.plan is not None and any(held.ids.values()):
            await self._run_in_thread(partial(self._write, _name(system_id, held.ids), held))

    async def find(self, system_id: int, ids: Ids) -> HeldItems | None:
        """The items that this vehicle had with these ids; None if they are not known."""
        return await self._run_in_thread(partial(self._read, _name(system_id, ids)))

    def _write(self, name: str, held: HeldItems) -> None:
        items = {part: [astuple(item) for item in held.items[part]] for part in PARTS}
        plan = None if held.plan is None else asdict(held.plan)
        content = {"format": FORMAT, "plan": plan, "at_unix_s": held.at_unix_s, "ids": held.ids}
        self._cache.write(name, json.dumps({**content, "items": items}).encode())

    def _read(self, name: str) -> HeldItems | None:
        content = self._cache.read(name)
        if content is None:
            return None
        try:
            return _held(json.loads(content), name)
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            self._cache.forget(name)
            return None


def _name(system_id: int, ids: Ids) -> str:
    return "-".join(("plan", str(system_id), *(f"{ids[part]:08x}" for part in PARTS)))


def _held(content: dict[str, Any], name: str) -> HeldItems:
    ids: Ids = {part: content["ids"][part] for part in PARTS}
    plan, at_unix_s = content["plan"], float(content["at_unix_s"])
    values = [plan["id"], plan["version"], plan["name"]]
    types = [isinstance(value, kind | None) for value, kind in zip(values, (str, int, str), strict=True)]
    if (
        content["format"] != FORMAT
        or not all(types)
        or not name.endswith(_name(0, ids).removeprefix("plan-0"))
    ):
        raise ValueError("not the items of a known plan")
    items: dict[Part, tuple[WireItem, ...]] = {
        part: tuple(_item(each) for each in content["items"][part]) for part in PARTS
    }
    return HeldItems(items, ids, PlanReference(*values), at_unix_s)


def _item(values: list[Any]) -> WireItem:
    if tuple(type(value) for value in values) != _TYPES:
        raise ValueError("not an item")
    return WireItem(*values)
