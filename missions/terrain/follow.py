"""Resolves altitudes above the ground to altitudes above mean sea level, and adds waypoints so that a plan
follows the ground.

PX4 rejects terrain frames: it flies to each item at one altitude, and in straight lines between items.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from missions.errors import PlanError
from missions.items import Jump, PlacedItem, Takeoff, Waypoint
from missions.plan import MAX_ITEMS, ComplexItem, ItemGroup, Plan, PlanItem, SimpleItem
from missions.route import is_flown_to
from missions.terrain.ground import Ground, line_positions
from missions.values import Altitude, RallyPoint


@dataclass(frozen=True, slots=True)
class GroundFollowing:
    """A plan with resolved altitudes above the ground."""

    plan: Plan
    resolved: int
    """Number of items and rally points whose altitude was resolved."""
    unknown: int
    """Number of items and rally points that stay unresolved, because no elevation data cover their
    positions."""
    added: int
    """Number of waypoints added between items."""


def follow_ground(plan: Plan, ground: Ground | None, tolerance_m: float | None = None) -> GroundFollowing:
    """Resolves all altitudes above the ground in a plan.

    Args:
        plan: a waypoint plan.
        ground: elevation data of the plan's area; None: no data.
        tolerance_m: allowed deviation of the straight lines from the planned height above the ground, which
            is interpolated between two items. Waypoints are added until the lines are within this tolerance.
            None: no waypoints are added.

    Raises:
        PlanError: the plan would have more items than PX4 can store.
    """
    resolved = unknown = added_count = 0

    def altitude_at(lat_deg: float, lon_deg: float, altitude: Altitude) -> Altitude:
        nonlocal resolved, unknown
        if altitude.reference != "terrain":
            return altitude
        amsl_m = None if ground is None else ground.altitude_amsl_m(lat_deg, lon_deg)
        resolved, unknown = resolved + (amsl_m is not None), unknown + (amsl_m is None)
        return altitude.model_copy(
            update={"resolved_amsl_m": None if amsl_m is None else round(amsl_m + altitude.value_m, 2)}
        )

    def with_resolved_altitude(item: SimpleItem) -> SimpleItem:
        if not isinstance(item, PlacedItem):
            return item
        return item.model_copy(update={"altitude": altitude_at(item.lat_deg, item.lon_deg, item.altitude)})

    def rally_with_resolved_altitude(point: RallyPoint) -> RallyPoint:
        return point.model_copy(
            update={"altitude": altitude_at(point.lat_deg, point.lon_deg, point.altitude)}
        )

    items: list[PlanItem] = []
    new_index: list[int] = []
    """New upload index of each item, by its old upload index."""
    count = 0
    previous: PlacedItem | None = None
    for row in plan.items:
        inner: list[SimpleItem] = []
        if isinstance(row, ComplexItem):
            previous = None
        for each in row.items if isinstance(row, ItemGroup) else (row,):
            item = with_resolved_altitude(each)
            current = item if isinstance(item, PlacedItem) and is_flown_to(item) else None
            if current is not None and previous is not None:
                added_waypoints = _waypoints_between(previous, current, ground, tolerance_m)
                before_group = not any(isinstance(earlier, Waypoint) for earlier in inner)
                (items if before_group else inner).extend(added_waypoints)
                added_count, count = added_count + len(added_waypoints), count + len(added_waypoints)
            new_index.append(count)
            inner.append(item)
            count += 1
            if not isinstance(row, ComplexItem):
                previous = current or previous
        items += [row.model_copy(update={"items": tuple(inner)})] if isinstance(row, ItemGroup) else inner
    if count > MAX_ITEMS:
        reason = f"following the ground needs {count} items, the maximum is {MAX_ITEMS}"
        raise PlanError("the plan", reason, "Increase the tolerance, or split the plan.")
    return GroundFollowing(
        plan.model_copy(
            update={
                "items": tuple(_with_new_target(row, new_index) if added_count else row for row in items),
                "rally_points": tuple(rally_with_resolved_altitude(each) for each in plan.rally_points),
            }
        ),
        resolved,
        unknown,
        added_count,
    )  # fmt: skip


def _with_new_target(item: PlanItem, new_index: Sequence[int]) -> PlanItem:
    """The item; a jump gets the new index of its target."""
    if isinstance(item, Jump) and item.target_index < len(new_index):
        return item.model_copy(update={"target_index": new_index[item.target_index]})
    return item


def _waypoints_between(
    start: PlacedItem, end: PlacedItem, ground: Ground | None, tolerance_m: float | None
) -> list[Waypoint]:
    """Waypoints that keep the straight lines from start to end near the planned height above the ground.

    A line is divided where its error is largest (Ramer, Douglas, Peucker). No waypoint is added if the
    altitude of one end is not a terrain altitude, or if the ground is unknown anywhere on the line.
    """
    if ground is None or tolerance_m is None:
        return []
    start_altitude, end_altitude = start.altitude, end.altitude
    if start_altitude.reference != "terrain" or end_altitude.reference != "terrain":
        return []
    if start_altitude.resolved_amsl_m is None or end_altitude.resolved_amsl_m is None:
        return []
    line = line_positions((start.lat_deg, start.lon_deg), (end.lat_deg, end.lon_deg), ground.spacing_m)
    fractions = line[:, 2]
    height_m = start_altitude.value_m + (end_altitude.value_m - start_altitude.value_m) * fractions
    target_amsl_m = ground.altitudes_amsl_m(line[:, 0], line[:, 1]) + height_m
    if np.isnan(target_amsl_m).any():
        return []
    dividing_indices = _dividing_indices(fractions, target_amsl_m, tolerance_m)
    found: list[Waypoint] = []
    for index in dividing_indices:
        altitude = Altitude(
            value_m=round(float(height_m[index]), 2), reference="terrain",
            resolved_amsl_m=round(float(target_amsl_m[index]), 2),
        )  # fmt: skip
        lon_deg = float((line[index, 1] + 180.0) % 360.0 - 180.0)
        heading = end.yaw_ned_deg if isinstance(end, Waypoint | Takeoff) else None
        found.append(
            Waypoint(lat_deg=float(line[index, 0]), lon_deg=lon_deg, altitude=altitude, yaw_ned_deg=heading)
        )
    return found


def _dividing_indices(fractions: np.ndarray, target_amsl_m: np.ndarray, tolerance_m: float) -> list[int]:
    """Indices between the ends at which the line is divided, in order."""
    dividing_indices: list[int] = []
    parts = [(0, len(fractions) - 1)]
    while parts:
        first, last = parts.pop()
        if last - first < 2:
            continue
        inner = slice(first + 1, last)
        straight_m = np.interp(fractions[inner], fractions[[first, last]], target_amsl_m[[first, last]])
        error_m = np.abs(target_amsl_m[inner] - straight_m)
        largest = int(np.argmax(error_m))
        if error_m[largest] <= tolerance_m:
            continue
        dividing_indices.append(first + 1 + largest)
        parts += [(first, dividing_indices[-1]), (dividing_indices[-1], last)]
    return sorted(dividing_indices)
