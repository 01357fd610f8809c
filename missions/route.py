"""The route of a plan: its items in the order of execution, jumps included, and the legs between
positions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from missions.geodesy import distance_m
from missions.items import Delay, Jump, Land, LegacyRoi, LoiterUnlimited, PlacedItem, ReturnHome, RoiLocation
from missions.plan import Plan, SimpleItem
from missions.values import Altitude

MAX_STEPS = 20_000
"""Maximum number of executed items; jumps may repeat items many times."""


def plan_positions(plan: Plan) -> list[tuple[float, float]]:
    """Latitude and longitude of home, all items with a position, and the rally points [deg]."""
    items = [item for _, item in plan.simple_items() if isinstance(item, PlacedItem)]
    home = [] if plan.planned_home is None else [plan.planned_home]
    return [(each.lat_deg, each.lon_deg) for each in (*home, *items, *plan.rally_points)]


@dataclass(frozen=True, slots=True)
class Step:
    """One execution of an item."""

    seq: int
    """Index in upload order."""
    row: int
    """Index of the item's row in `Plan.items`."""
    item: SimpleItem


@dataclass(frozen=True, slots=True)
class Route:
    """The items in the order of execution."""

    steps: tuple[Step, ...]
    endless: bool
    """Whether a jump repeats without end; the route contains the loop once."""
    truncated: bool
    """Whether there are more steps than `MAX_STEPS`."""
    stalled_row: int | None
    """The row of a jump whose loop neither flies to an item nor waits; None: no such jump."""


@dataclass(frozen=True, slots=True)
class Leg:
    """The straight path from one position to the next."""

    step: Step
    length_m: float
    """Horizontal length."""
    altitude_change_m: float | None
    """Positive upwards; None: the two altitudes cannot be compared."""


def is_flown_to(item: SimpleItem) -> bool:
    """Whether the vehicle flies to the item's position; at a region of interest only the camera is
    pointed."""
    return isinstance(item, PlacedItem) and not isinstance(item, LegacyRoi | RoiLocation)


def route_of(plan: Plan) -> Route:
    """The items as PX4 executes them, including jumps, up to a landing or return."""
    items = [Step(seq, row, item) for seq, (row, item) in enumerate(plan.simple_items())]
    steps: list[Step] = []
    jumps: dict[int, int] = {}
    endless, stalled_row = False, None
    seq = steps_without_flight = 0
    while seq < len(items) and len(steps) < MAX_STEPS:
        step = items[seq]
        steps.append(step)
        item = step.item
        steps_without_flight = 0 if is_flown_to(item) or isinstance(item, Delay) else steps_without_flight + 1
        if steps_without_flight > len(items) + 1:
            stalled_row = step.row
            break
        seq += 1
        if isinstance(item, Jump):
            times_jumped = jumps.get(step.seq, 0)
            endless |= item.repeat < 0
            if item.target_index < len(items) and times_jumped < (1 if item.repeat < 0 else item.repeat):
                jumps[step.seq] = times_jumped + 1
                seq = item.target_index
            else:
                jumps.pop(step.seq, None)
        elif isinstance(item, Land | LoiterUnlimited | ReturnHome) or not item.autocontinue:
            break
    return Route(tuple(steps), endless, len(steps) >= MAX_STEPS, stalled_row)


def legs(plan: Plan, route: Route) -> tuple[Leg, ...]:
    """The legs between the positions of a route; the first leg starts at the planned home, if the plan
    has a home."""
    home = plan.planned_home
    position = None if home is None else (home.lat_deg, home.lon_deg)
    altitude = None if home is None else Altitude(value_m=home.alt_amsl_m, reference="amsl")
    home_amsl_m = None if home is None else home.alt_amsl_m
    route_legs: list[Leg] = []
    for step in route.steps:
        item = step.item
        if not isinstance(item, PlacedItem) or not is_flown_to(item):
            continue
        if position is not None:
            length_m = distance_m(*position, item.lat_deg, item.lon_deg)
            route_legs.append(Leg(step, length_m, altitude_change_m(altitude, item.altitude, home_amsl_m)))
        position, altitude = (item.lat_deg, item.lon_deg), item.altitude
    return tuple(route_legs)


def altitude_change_m(start: Altitude | None, end: Altitude, home_alt_amsl_m: float | None) -> float | None:
    """Altitude difference from start to end; None: the altitude of home or of the terrain is unknown."""
    if start is None:
        return None
    if start.reference == end.reference == "home":
        return end.value_m - start.value_m
    start_amsl_m, end_amsl_m = start.amsl_m(home_alt_amsl_m), end.amsl_m(home_alt_amsl_m)
    return None if start_amsl_m is None or end_amsl_m is None else end_amsl_m - start_amsl_m


GeoPosition = tuple[float, float, float]
"""Latitude, longitude [deg], altitude AMSL [m]."""


@dataclass(frozen=True, slots=True)
class FlightLine:
    """The straight path that is flown for one item. Without a planned home, the path of the first item begins
    and ends at the position of the item."""

    step: Step
    start: GeoPosition
    end: GeoPosition
    from_home: bool = False
    """Whether the path begins above home, after the vehicle has climbed at home to the altitude of the
    path."""


def flight_lines(plan: Plan, return_alt_m: float) -> Iterator[FlightLine]:
    """The straight paths of a plan's flight, at most one for each item, and one for each return.

    The first path is flown at the altitude of its end, because the vehicle climbs first. The path to a
    landing is flown at the altitude of the previous item. A return is flown at RTL_RETURN_ALT above home or
    higher. Paths with an unknown altitude are omitted.

    Args:
        plan: a plan with resolved terrain altitudes.
        return_alt_m: the vehicle's RTL_RETURN_ALT, above home.
    """
    home = plan.planned_home
    home_amsl_m = None if home is None else home.alt_amsl_m
    yielded: set[int] = set()
    position: GeoPosition | None = None
    for step in route_of(plan).steps:
        item = step.item
        if isinstance(item, ReturnHome) and home is not None and position is not None:
            path_amsl_m = max(position[2], home.alt_amsl_m + return_alt_m)
            yield FlightLine(step, (*position[:2], path_amsl_m), (home.lat_deg, home.lon_deg, path_amsl_m))
        if not isinstance(item, PlacedItem) or not is_flown_to(item):
            continue
        amsl_m = item.altitude.amsl_m(home_amsl_m)
        if amsl_m is None:
            position = None
            continue
        start, from_home = position, position is None and home is not None and not yielded
        if from_home and home is not None:
            start = (home.lat_deg, home.lon_deg, amsl_m)
        path_amsl_m = start[2] if isinstance(item, Land) and start is not None else amsl_m
        position = (item.lat_deg, item.lon_deg, path_amsl_m)
        if step.seq not in yielded:
            yielded.add(step.seq)
            yield FlightLine(step, start or position, position, from_home)
