"""The result of a pattern: items for a plan, and key figures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from missions.camera_items import TriggerDistance
from missions.errors import PlanError
from missions.patterns.camera import AnyCoverage
from missions.patterns.ground import EastNorth, Map
from missions.plan import MAX_ITEMS, SimpleItem
from missions.values import Altitude, Point


@dataclass(frozen=True, slots=True)
class Pattern:
    """Items for a plan, and their key figures."""

    items: tuple[SimpleItem, ...]
    lines: tuple[tuple[Point, Point], ...] = ()
    """Lines on which photos are taken, without approach and turns."""
    lines_length_m: float = 0.0
    lower_bound_m: float = 0.0
    """Smallest possible length of lines with this spacing: area / spacing."""
    photos: int = 0
    spacing_m: float = 0.0
    trigger_m: float = 0.0
    resolution_m_px: float | None = None
    """Ground sampling distance."""
    heading_deg: float | None = None
    """Direction of the lines, clockwise from north."""
    area_m2: float | None = None
    """Area that the photos show; None: the pattern takes no photos."""


def photo_path_items(
    path: Sequence[EastNorth],
    flat_map: Map,
    altitude: Altitude,
    coverage: AnyCoverage,
    turnaround_m: float = 0.0,
) -> list[SimpleItem]:
    """Items that fly a path and take photos; the path is extended straight by `turnaround_m` at both
    ends."""
    start, end = path[0], path[-1]
    last = _beyond(path[-2], end, coverage.lead_out_m)
    items: list[SimpleItem] = []
    if turnaround_m > 0.0:
        items.append(flat_map.waypoint(_beyond(path[1], start, turnaround_m), altitude))
    items.append(flat_map.waypoint(start, altitude))
    rest: list[SimpleItem] = [flat_map.waypoint(position, altitude) for position in (*path[1:-1], last)]
    items += with_photos(rest, coverage)
    if turnaround_m > coverage.lead_out_m:
        items.append(flat_map.waypoint(_beyond(path[-2], end, turnaround_m), altitude))
    return items


def with_photos(items: Sequence[SimpleItem], coverage: AnyCoverage) -> list[SimpleItem]:
    """The items between the start and the end of taking photos; unchanged if no photos are taken."""
    if coverage.trigger_m <= 0.0:
        return list(items)
    start = TriggerDistance(distance_m=coverage.trigger_m, at_once=1.0)
    return [start, *items, TriggerDistance(distance_m=0.0)]


def photo_count(length_m: float, coverage: AnyCoverage) -> int:
    """Number of photos on a line: one at the start, then one for each trigger distance."""
    if coverage.trigger_m <= 0.0:
        return 0
    return 1 + int((length_m + coverage.lead_out_m) / coverage.trigger_m + 1e-9)


def within_item_limit(items: Sequence[SimpleItem]) -> tuple[SimpleItem, ...]:
    """Returns the items if a plan can store that many.

    Raises:
        PlanError: There are too many items.
    """
    if len(items) > MAX_ITEMS:
        reason = f"it has {len(items)} items, the maximum is {MAX_ITEMS}"
        raise PlanError("the pattern", reason, "Split it into smaller ones.")
    return tuple(items)


def _beyond(start: EastNorth, end: EastNorth, by_m: float) -> EastNorth:
    """The position `by_m` beyond `end`, on the line from `start` to `end`."""
    length_m = math.dist(start, end)
    if length_m < 1e-9:
        return end
    scale = by_m / length_m
    return (end[0] + (end[0] - start[0]) * scale, end[1] + (end[1] - start[1]) * scale)
