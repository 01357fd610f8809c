"""A waypoint plan with one changed item. Imports no simulator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from missions import items as i
from missions.geodesy import LocalOrigin
from missions.plan import Plan, SimpleItem
from missions.values import Altitude
from missions.what_if.flight import NotFlyable

Then = Literal["return", "hold", "land"]
THEN: tuple[Then, ...] = get_args(Then)


@dataclass(frozen=True, slots=True)
class ItemChange:
    """What is different at one item of a plan; a pattern is one item."""

    number: int
    """The item, from 1 as in the plan's list."""
    moved_ned_m: tuple[float, float, float] | None = None
    """What is added to its position."""
    speed_m_s: float | None = None
    """Speed over ground from this item on."""
    then: Then | None = None
    """What follows it instead of the next item."""


def changed_plan(plan: Plan, change: ItemChange, current: int) -> Plan:
    """The plan with the change; its patterns are the items that are flown, and the current item keeps its
    index.

    Args:
        plan: the flown plan.
        change: what is different.
        current: index of the current item, in the order of the upload.

    Raises:
        NotFlyable: there is no such item, it was flown before, or it has no position.
    """
    rows = list(plan.simple_items())
    own = [index for index, (row, _) in enumerate(rows) if row == change.number - 1]
    if not own:
        raise NotFlyable(f"The plan has no item {change.number}; it has {len(plan.items)}.", "item")
    if own[-1] < current:
        flown = rows[current][0] + 1
        raise NotFlyable(f"Item {change.number} was flown before; the vehicle flew to item {flown}.", "item")
    items = [item for _, item in rows]
    placed = [index for index in own if isinstance(items[index], i.PlacedItem)]
    if not placed and (change.moved_ned_m is not None or change.then in ("hold", "land")):
        raise NotFlyable(f"Item {change.number} has no position.", "item")
    if change.moved_ned_m is not None:
        for index in placed:
            items[index] = _moved(items[index], change.moved_ned_m)
    if change.then is not None:
        last = items[placed[-1]] if placed else None
        items = _inserted(items, own[-1] + 1, _following(change.then, last))
    if change.speed_m_s is not None:
        first = max(own[0], current)
        items = _inserted(items, first, i.ChangeSpeed(speed_m_s=change.speed_m_s))
    return plan.model_copy(update={"items": tuple(items)})


def _moved(item: SimpleItem, moved_ned_m: tuple[float, float, float]) -> SimpleItem:
    assert isinstance(item, i.PlacedItem)
    north_m, east_m, down_m = moved_ned_m
    lat_deg, lon_deg, _ = LocalOrigin(item.lat_deg, item.lon_deg, 0.0).to_geodetic((north_m, east_m, 0.0))
    old = item.altitude
    resolved_m = None if old.resolved_amsl_m is None else old.resolved_amsl_m - down_m
    altitude = old.model_copy(update={"value_m": old.value_m - down_m, "resolved_amsl_m": resolved_m})
    return item.model_copy(update={"lat_deg": lat_deg, "lon_deg": lon_deg, "altitude": altitude})


def _following(then: Then, last: SimpleItem | None) -> SimpleItem:
    if then == "return" or not isinstance(last, i.PlacedItem):
        return i.ReturnHome()
    if then == "hold":
        return i.LoiterUnlimited(lat_deg=last.lat_deg, lon_deg=last.lon_deg, altitude=last.altitude)
    ground = Altitude(value_m=0.0, reference="home")
    return i.Land(lat_deg=last.lat_deg, lon_deg=last.lon_deg, altitude=ground)


def _inserted(items: Sequence[SimpleItem], index: int, new: SimpleItem) -> list[SimpleItem]:
    """The items with a new one; jumps lead to the same items as before."""

    def shifted(item: SimpleItem) -> SimpleItem:
        if isinstance(item, i.Jump) and item.target_index >= index:
            return item.model_copy(update={"target_index": item.target_index + 1})
        return item

    return [*map(shifted, items[:index]), new, *map(shifted, items[index:])]
