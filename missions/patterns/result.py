"""The result of a pattern: items for a plan, and key figures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from missions.camera_items import TriggerDistance
from missions.errors import PlanError
from missions.patterns.camera import Coverage
from missions.patterns.ground import East, Map
from missions.plan import MAX_ITEMS, SimpleItem
from missions.values import Altitude, Point


@dataclass(frozen=True, slots=True)
class Pattern:
    """Items for a plan, and what they do; lengths in metres."""

    items: tuple[SimpleItem, ...]
    lines: tuple[tuple[Point, Point], ...] = ()
    """Where pictures are taken, without what is flown before, between and after."""
    lines_length_m: float = 0.0
    lower_bound_m: float = 0.0
    """No pattern of this spacing has shorter lines: area / spacing."""
    photos: int = 0
    spacing_m: float = 0.0
    trigger_m: float = 0.0
    resolution_m_px: float | None = None
    """Ground sampling distance."""
    heading_deg: float | None = None
    """Of the lines, clockwise from north."""


def photographed(
    path: Sequence[East], chart: Map, altitude: Altitude, coverage: Coverage, turnaround_m: float = 0.0
) -> list[SimpleItem]:
    """Fly a path with pictures, straight on before and after it by the turnaround."""
    start, end = path[0], path[-1]
    last = _beyond(path[-2], end, coverage.lead_out_m)
    items: list[SimpleItem] = []
    if turnaround_m > 0.0:
        items.append(chart.waypoint(_beyond(path[1], start, turnaround_m), altitude))
    items.append(chart.waypoint(start, altitude))
    items.append(TriggerDistance(distance_m=coverage.trigger_m, at_once=1.0))
    items += [chart.waypoint(place, altitude) for place in (*path[1:-1], last)]
    items.append(TriggerDistance(distance_m=0.0))
    if turnaround_m > coverage.lead_out_m:
        items.append(chart.waypoint(_beyond(path[-2], end, turnaround_m), altitude))
    return items


def photo_count(length_m: float, coverage: Coverage) -> int:
    """Pictures on a line of this length: one at once, then one each trigger distance."""
    return 1 + int((length_m + coverage.lead_out_m) / coverage.trigger_m + 1e-9)


def bounded(items: Sequence[SimpleItem]) -> tuple[SimpleItem, ...]:
    """The items, where a plan has room for them.

    Raises:
        PlanError: It has not.
    """
    if len(items) > MAX_ITEMS:
        reason = f"it has {len(items)} items, the maximum is {MAX_ITEMS}"
        raise PlanError("the pattern", reason, "Split it into smaller ones.")
    return tuple(items)


def _beyond(before: East, end: East, by_m: float) -> East:
    """A place straight on from `end`, as seen from `before`."""
    length_m = math.dist(before, end)
    if length_m < 1e-9:
        return end
    scale = by_m / length_m
    return (end[0] + (end[0] - before[0]) * scale, end[1] + (end[1] - before[1]) * scale)
