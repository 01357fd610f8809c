"""Stores which items a vehicle has, so that a restarted server finds them by the ids that the vehicle
reports.

PX4's ids are checksums of the items, so equal ids mean equal items. Only the items of a known plan are
stored, after the server has read them back from the vehicle. If a file is lost or damaged, the plan is not
known.
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
from gcs_server.vehicle.services.mission_on_vehicle import Ids, ItemsOnVehicle, PlanReference
from missions.formats.mavlink_items import WireItem

RunInThread = Callable[[Callable[[], Any]], Awaitable[Any]]
FORMAT = 2
_TYPES = (int, int, int, float, float, float, float, int, int, float, bool, bool)
"""Types of the fields of a `WireItem`, in order."""


class ItemsCache:
    """Items of vehicles, one file for each vehicle and plan.

    Args:
        cache: stores the files.
        run_in_thread: `asyncio.to_thread`, except in tests.
    """

    def __init__(self, cache: Cache, run_in_thread: RunInThread = asyncio.to_thread) -> None:
        self._cache = cache
        self._run_in_thread = run_in_thread

    async def store(self, system_id: int, items: ItemsOnVehicle) -> None:
        """Stores the items of a known plan, if the vehicle reports ids."""
        if items.plan is not None and any(items.ids.values()):
            await self._run_in_thread(partial(self._write, _name(system_id, items.ids), items))

    async def find(self, system_id: int, ids: Ids) -> ItemsOnVehicle | None:
        """The items that this vehicle had with these ids; None if they are not known."""
        return await self._run_in_thread(partial(self._read, _name(system_id, ids)))

    def _write(self, name: str, items: ItemsOnVehicle) -> None:
        item_lists = {part: [astuple(item) for item in items.items[part]] for part in PARTS}
        plan = None if items.plan is None else asdict(items.plan)
        content = {
            "format": FORMAT, "plan": plan, "at_unix_s": items.at_unix_s, "ids": items.ids,
            "rejections": items.rejections,
        }  # fmt: skip
        self._cache.write(name, json.dumps({**content, "items": item_lists}).encode())

    def _read(self, name: str) -> ItemsOnVehicle | None:
        content = self._cache.read(name)
        if content is None:
            return None
        try:
            return _items_on_vehicle(json.loads(content), name)
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            self._cache.forget(name)
            return None


def _name(system_id: int, ids: Ids) -> str:
    return "-".join(("plan", str(system_id), *(f"{ids[part]:08x}" for part in PARTS)))


def _items_on_vehicle(content: dict[str, Any], name: str) -> ItemsOnVehicle:
    ids: Ids = {part: content["ids"][part] for part in PARTS}
    plan, at_unix_s = content["plan"], float(content["at_unix_s"])
    values = [plan["id"], plan["version"], plan["name"]]
    types_match = all(
        isinstance(value, kind | None) for value, kind in zip(values, (str, int, str), strict=True)
    )
    if (
        content["format"] != FORMAT
        or not types_match
        or not name.endswith(_name(0, ids).removeprefix("plan-0"))
    ):
        raise ValueError("not the items of a known plan")
    item_lists: dict[Part, tuple[WireItem, ...]] = {
        part: tuple(_item(each) for each in content["items"][part]) for part in PARTS
    }
    rejections = tuple(str(each) for each in content["rejections"])
    return ItemsOnVehicle(item_lists, ids, PlanReference(*values), at_unix_s, rejections)


def _item(values: list[Any]) -> WireItem:
    if tuple(type(value) for value in values) != _TYPES:
        raise ValueError("not an item")
    return WireItem(*values)
