"""The planned flight of a waypoint plan, item by item: from a dry run, or from the plan itself."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from missions.estimates import StepEstimate, step_estimates
from missions.frames import Vector3
from missions.geodesy import LocalOrigin
from missions.items import Land, PlacedItem, ReturnHome, Takeoff
from missions.offboard.samples import Leg
from missions.plan import Plan, SimpleItem
from missions.route import is_flown_to, route_of
from missions.runner.flown import PlannedFlight
from missions.values import HomePosition
from missions.vehicle import VehicleModel

MAX_POINTS = 3000
"""Maximum number of points of a dry run's path; a longer path keeps only some of its points."""
MAX_PASSES = 3000
"""Maximum number of passes of a planned flight."""


@dataclass(frozen=True, slots=True)
class Pass:
    """One execution of an item; a repeated item has several passes."""

    items: frozenset[int]
    """Indices in upload order: of one item, or of all items of a pattern."""
    leg: Leg
    """Path of the pass; `start_s` counts from the start of the mission on the ground."""
    compared: bool = True
    """Whether the flight is compared with this path; False: PX4 chooses the path itself."""


@dataclass(frozen=True, slots=True)
class PlannedPasses:
    """The planned flight, in the vehicle's local frame."""

    source: Literal["dry_run", "plan"]
    passes: tuple[Pass, ...]
    duration_s: float | None
    """Time from the start to disarming, or to the end of a flight that ends in the air; None: a jump repeats
    without end."""

    def planned_flight(self, first: int = 0) -> PlannedFlight:
        """The planned flight from pass `first` on, to compare a flight that began with this pass."""
        legs = tuple(each.leg for each in self.passes[first:])
        if self.duration_s is None or not legs:
            return PlannedFlight(self.source, None, None, legs)
        duration_s = self.duration_s - (legs[0].start_s if first else 0.0)
        return PlannedFlight(self.source, duration_s, sum(_length_m(each) for each in legs), legs)

    def has_repeated_items(self) -> bool:
        """Whether an item is flown more than once."""
        items = [item for each in self.passes for item in each.items]
        return len(items) > len(set(items))


def _length_m(leg: Leg) -> float:
    return sum(math.dist(a[1:], b[1:]) for a, b in itertools.pairwise(leg.points))


def item_title(item: SimpleItem) -> str:
    """Kind of an item as a text: "Return home"."""
    return item.kind.replace("_", " ").capitalize()


# --- from a dry run -----------------------------------------------------------------------------------


def planned_by_dry_run(
    nominal: Mapping[str, Any], rows_of_items: Sequence[int], start_ned_m: Vector3
) -> PlannedPasses:
    """The nominal flight of a dry run.

    Args:
        nominal: `DryRun.document` of a dry run that has flown the whole plan.
        rows_of_items: of the plan that the dry run has flown, the index in `items` of each item as uploaded.
        start_ned_m: start position of the dry run in the vehicle's local frame.
    """
    items_of_row: dict[int, set[int]] = {}
    for index, row in enumerate(rows_of_items):
        items_of_row.setdefault(row, set()).add(index)
    times = np.array(nominal["path"]["t_s"])
    path = np.array(nominal["path"]["position_ned_m"]).reshape(-1, 3)
    rows = np.column_stack((times, path + np.array(start_ned_m)))
    stride = math.ceil(len(rows) / MAX_POINTS)
    passes = [
        Pass(
            frozenset(items_of_row[step["row"]]),
            _leg(step["place"], step["title"], step["start_s"], _part(rows, step, stride)),
        )
        for step in nominal["steps"]
    ]
    return PlannedPasses("dry_run", tuple(passes), float(nominal["duration_s"]))


def _part(rows: NDArray[np.float64], step: Mapping[str, Any], stride: int) -> NDArray[np.float64]:
    """The rows (time, north, east, down) of one step, at least two; the last row begins the next step."""
    first, last = np.searchsorted(rows[:, 0], (step["start_s"] - 1e-6, step["end_s"] - 1e-6))
    last = min(int(last), len(rows) - 1)
    first = min(int(first), max(0, last - 1))
    kept = np.unique(np.append(np.arange(first, last, stride), last))
    return rows[kept]


def _leg(place: str, title: str, start_s: float, rows: NDArray[np.float64]) -> Leg:
    rows = rows - np.array([start_s, 0.0, 0.0, 0.0])
    points = tuple((t, n, e, d) for t, n, e, d in np.round(rows, 3).tolist())
    return Leg(place, title, start_s, points[-1][0], True, points)


# --- from the plan ------------------------------------------------------------------------------------


def estimate_passes(
    plan: Plan, vehicle: VehicleModel, home: HomePosition, origin: LocalOrigin
) -> PlannedPasses | None:
    """Straight lines between the items, with estimated times; None: more than MAX_PASSES legs.

    Args:
        plan: the plan on the vehicle.
        vehicle: speeds of the vehicle.
        home: home of the vehicle.
        origin: origin of the vehicle's local frame.
    """
    plan = plan.model_copy(update={"planned_home": home})
    route = route_of(plan)
    home_ned_m = origin.to_ned(home.lat_deg, home.lon_deg, home.alt_amsl_m)
    position_ned_m, now_s = home_ned_m, 0.0
    passes: list[Pass] = []
    for each in step_estimates(plan, vehicle, route):
        corners_ned_m = _path_corners(each, position_ned_m, home_ned_m, home, origin)
        if each.time_s <= 0.0 and len(corners_ned_m) < 2:
            continue
        points = _timed_points(corners_ned_m, each.time_s - each.wait_s, each.time_s)
        leg = Leg(f"item {each.step.seq + 1}", item_title(each.step.item), now_s, each.time_s, True, points)
        item = each.step.item
        compared = not isinstance(item, ReturnHome) and (bool(passes) or isinstance(item, Takeoff))
        passes.append(Pass(frozenset([each.step.seq]), leg, compared))
        position_ned_m, now_s = corners_ned_m[-1], now_s + each.time_s
        if len(passes) > MAX_PASSES:
            return None
    endless = route.endless or route.truncated or route.stalled_row is not None
    return PlannedPasses("plan", tuple(passes), None if endless else now_s)


def _path_corners(
    each: StepEstimate, position_ned_m: Vector3, home_ned_m: Vector3, home: HomePosition, origin: LocalOrigin
) -> list[Vector3]:
    """The corners of one step's path, from `position_ned_m`."""
    item, (n, e, d) = each.step.item, position_ned_m
    if isinstance(item, ReturnHome):
        top_down_m = d - each.climb_m
        return [position_ned_m, (n, e, top_down_m), (home_ned_m[0], home_ned_m[1], top_down_m), home_ned_m]
    if not isinstance(item, PlacedItem) or not is_flown_to(item):
        return [position_ned_m]
    amsl_m = item.altitude.amsl_m(home.alt_amsl_m)
    target_ned_m = origin.to_ned(
        item.lat_deg, item.lon_deg, origin.alt_amsl_m - d if amsl_m is None else amsl_m
    )
    if isinstance(item, Takeoff):
        return [position_ned_m, (n, e, target_ned_m[2]), target_ned_m]
    if isinstance(item, Land):
        return [position_ned_m, (target_ned_m[0], target_ned_m[1], d), target_ned_m]
    return [position_ned_m, target_ned_m]


def _timed_points(
    corners_ned_m: Sequence[Vector3], travel_s: float, time_s: float
) -> tuple[tuple[float, float, float, float], ...]:
    """The corners with their times, travelled at constant speed; then the vehicle waits at the last
    corner."""
    corner_array = np.array(corners_ned_m)
    along_m = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(corner_array, axis=0), axis=1))))
    times = along_m / max(float(along_m[-1]), 1e-9) * travel_s
    rows = np.column_stack((times, corner_array))
    if len(corners_ned_m) < 2 or time_s > travel_s:
        rows = np.vstack((rows, (time_s, *corners_ned_m[-1])))
    return tuple((t, n, e, d) for t, n, e, d in np.round(rows, 3).tolist())
