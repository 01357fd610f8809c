"""Resolves positions at 0/0 of files, which mean "here".

ArduPilot and the programs for it write latitude and longitude 0 where an item has no position of its own:
a take-off climbs where the vehicle stands, and a waypoint, loiter or landing is flown where the path stands
at that moment. MAVLink's NaN means the same. PX4 would fly to 0/0, in the Gulf of Guinea.
https://ardupilot.org/copter/docs/mission-command-list.html
"""

from __future__ import annotations

from typing import Any

from missions.formats.mavlink_items import FILE_FRAME, frame_of, item_from_params, params_of
from missions.items import (
    CommandItem,
    Gate,
    Land,
    LegacyRoi,
    PlacedItem,
    ReturnHome,
    RoiLocation,
    RoiNone,
    Takeoff,
)
from missions.plan import ItemGroup, Plan, PlanItem, SimpleItem
from missions.route import is_flown_to
from missions.values import Altitude

ZERO_DEG = 5e-8
"""Half of the resolution of positions in messages [deg]."""


def is_here(lat_deg: float, lon_deg: float) -> bool:
    """Whether a position of a file is 0/0, and so no position."""
    return abs(lat_deg) <= ZERO_DEG and abs(lon_deg) <= ZERO_DEG


def resolve_here(plan: Plan, home: tuple[float, float] | None = None) -> tuple[Plan, tuple[str, ...]]:
    """The plan with the positions that its items at 0/0 mean, and notes about them.

    A take-off is at home; any other item is at the position of the item before it, a loiter or waypoint
    with the altitude 0 also at its altitude. An item whose position cannot be known (the file has no home)
    then has none, which the checks report as an error. A region of interest at 0/0 ends the region of
    interest.

    Args:
        plan: the plan as it was read.
        home: latitude and longitude of home [deg], if the file has a home without an altitude.
    """
    if plan.planned_home is not None:
        home = (plan.planned_home.lat_deg, plan.planned_home.lon_deg)
    resolver = _Resolver(home)
    items: list[PlanItem] = []
    for row, item in enumerate(plan.items, start=1):
        if isinstance(item, ItemGroup):
            inner = tuple(resolver.resolve(each, row) for each in item.items)
            items.append(item.model_copy(update={"items": inner}))
        else:
            items.append(resolver.resolve(item, row))
    if not resolver.rows:
        return plan, ()
    notes = tuple(f"{meaning}: item {_numbers(rows)}." for meaning, rows in resolver.rows.items())
    first = f"Latitude and longitude 0 mean \u201chere\u201d in this file. {notes[0]}"
    return plan.model_copy(update={"items": tuple(items)}), (first, *notes[1:])


def _numbers(rows: list[int]) -> str:
    rows = list(dict.fromkeys(rows))
    return ", ".join(map(str, rows[:10])) + (f" and {len(rows) - 10} more" if len(rows) > 10 else "")


class _Resolver:
    """Follows the path of a plan from item to item."""

    def __init__(self, home: tuple[float, float] | None) -> None:
        self._home = home
        self._position = home
        """Where the path stands before the next item; None: unknown."""
        self._altitude: Altitude | None = None
        """None: on the ground, or unknown."""
        self.rows: dict[str, list[int]] = {}
        """Numbers of the rows with items at 0/0, by what was made of them."""

    def resolve(self, item: SimpleItem, row: int) -> SimpleItem:
        """The item with its position, if it is at 0/0."""
        if isinstance(item, ReturnHome):
            self._position, self._altitude = self._home, None
        placed = _placed(item)
        if placed is None:
            return item
        if not is_here(placed.lat_deg, placed.lon_deg):
            if is_flown_to(placed) and not isinstance(placed, Gate):
                self._position, self._altitude = (placed.lat_deg, placed.lon_deg), placed.altitude
            return item
        if isinstance(placed, RoiLocation | LegacyRoi):
            self._note("The camera is pointed at nothing from here", row)
            return RoiNone(autocontinue=placed.autocontinue, original=placed.original)
        is_takeoff = isinstance(placed, Takeoff)
        position = (self._home or self._position) if is_takeoff else self._position
        if position is None or isinstance(placed, Gate):
            self._note("Without a position, because the file states no home or position before it", row)
            return _without_position(placed)
        altitude = placed.altitude
        if altitude.value_m == 0.0 and self._altitude and not isinstance(placed, Land | Takeoff):
            altitude = self._altitude
        self._note("At home" if position == self._home else "Where the path stands before it", row)
        self._position, self._altitude = position, altitude
        here = {"lat_deg": position[0], "lon_deg": position[1], "altitude": altitude}
        return placed.model_copy(update=here)

    def _note(self, meaning: str, row: int) -> None:
        self.rows.setdefault(meaning, []).append(row)


def _placed(item: SimpleItem) -> Any | None:
    """The item as one with a position; NaN for latitude and longitude is 0/0. None: it has no position, or no
    altitude."""
    if isinstance(item, PlacedItem):
        return item
    if not isinstance(item, CommandItem) or item.params[4:6] != (None, None):
        return None
    params = (*item.params[:4], 0.0, 0.0, item.params[6])
    placed = item_from_params(
        item.command, item.frame, params, autocontinue=item.autocontinue, original=item.original
    )
    return placed if isinstance(placed, PlacedItem) else None


def _without_position(item: Any) -> CommandItem:
    params = (*params_of(item)[:4], None, None, item.altitude.value_m)
    return CommandItem.model_validate(
        {
            "command": item.COMMAND,
            "frame": frame_of(item, FILE_FRAME),
            "params": params,
            "autocontinue": item.autocontinue,
            "original": item.original,
        }
    )
