"""Divides one survey over several vehicles: an offboard mission with a role for each of them.

All lines, flown back and forth across the area, are one way, which is cut so that all vehicles fly equally
long, the way from the take-off position and back included. A line may be cut in two. All vehicles fly their
parts in the same direction across the area, so they stay about the width of a part from each other.

    take off ─ meet ─ out, each in its layer ─ meet ─ down, lines, up ─ meet ─ back ─ meet ─ land

The ways out and back may cross, so vehicles whose ways come near to each other have layers of altitude, one
minimum separation (with the margin of the separation guard, and 2 m) above the other. The meetings keep the
phases apart: nobody climbs or descends where another one flies level.

An offboard mission and not waypoint plans, because only its vehicles start together or not at all, wait for
each other, are watched by the separation guard in flight, and are stopped together if one leaves.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise

import shapely
from shapely.geometry import LineString

from missions.errors import PlanError
from missions.geodesy import LocalOrigin
from missions.items import PlacedItem
from missions.offboard import steps as s
from missions.offboard.document import MAX_ROLES, OffboardMission, Role
from missions.offboard.from_pattern import steps_from_pattern
from missions.offboard.positions import MissionPosition
from missions.pattern_settings import SurveyPattern
from missions.patterns import survey
from missions.patterns.document import survey_of
from missions.patterns.ground import EastNorth
from missions.patterns.sweep import Line
from missions.plan import PatternItem, Plan, SimpleItem
from missions.separation import braking_distance_m, planned_margin_m
from missions.values import Altitude, HomePosition, Point
from missions.vehicle import VehicleModel

MIN_HEIGHT_M = 2.5
"""Lowest altitude of the lines above a take-off position [m]."""
START_GAP_M = 1.0
"""Planned distance of two starts above the smallest permitted one, if no vehicles are chosen [m]."""
LAYER_GAP_M = 2.0
"""Height of a layer above the smallest permitted one [m], because vehicles do not hold their height exactly:
in a dry run the guard would act on layers without it."""
TAKE_OFF_S, CLIMB_M_S = 60.0, 0.7
"""Time for a take-off: at least 60 s, and as long as at the slowest usual climb (MPC_TKO_SPEED is 1.5)."""
WAIT_S = 180.0
"""A vehicle waits at a meeting this much longer than the longest way of a vehicle takes."""
MAX_WAIT_S = 7200.0
BISECTIONS = 32
TURN_S = 25.0
"""Time from the end of a line to the start of the next one, beside the way. The vehicle stops and turns on
the spot twice: with PX4's defaults 27 s with a spacing of 12 m, at 3, 5 and 8 m/s."""
SHORTEST_M = 20.0
"""A line is not cut nearer to its ends [m]; nor nearer than two photos."""


@dataclass(frozen=True, slots=True)
class Part:
    """What one vehicle flies."""

    role: str
    vehicle: int
    """Index of the vehicle in the starts."""
    lines: tuple[tuple[Point, Point], ...]
    """Lines in flight order and direction, without turnarounds."""
    layer_m: float
    """Height of the way out and back above the lines [m]."""


@dataclass(frozen=True, slots=True)
class Division:
    """A divided survey."""

    mission: OffboardMission
    parts: tuple[Part, ...]
    """In the order of the roles: from one side of the area to the other."""
    notes: tuple[str, ...]
    """What the mission does not contain, as sentences."""


def divide(
    plan: Plan,
    item: int | None,
    starts: Sequence[HomePosition],
    name: str,
    *,
    minimum_m: float,
    vehicle: VehicleModel | None = None,
) -> Division:
    """Divides a survey of a plan.

    Args:
        plan: the plan; its geofence and obstacles become those of the mission.
        item: row of the survey; None: the only survey of the plan.
        starts: take-off position of each vehicle; see `planned_starts` if they are not known.
        name: name of the mission.
        minimum_m: minimum separation of any two vehicles [m].
        vehicle: parameters of the vehicles; None: PX4's defaults.

    Raises:
        PlanError: there is no such survey, it cannot be divided over so many vehicles, or its lines
            are too low.
    """
    vehicle = vehicle or VehicleModel()
    row, pattern = _survey_row(plan, item)
    if not 2 <= len(starts) <= MAX_ROLES:
        reason = f"a survey is divided over 2 to {MAX_ROLES} vehicles, not {len(starts)}"
        raise PlanError("vehicles", reason, "Choose other vehicles.", field="vehicles")
    settings = survey_of(pattern)
    flat_map, _, (sweep, *crossing) = survey.lines_of(settings)
    if crossing:
        fix = "Turn off the crosshatch, and divide a second survey with the other heading afterwards."
        raise PlanError("the survey", "a crosshatch is not divided: the parts would cross", fix, field="item")
    speed_m_s = settings.speed_m_s or plan.hover_speed_m_s or vehicle.cruise_m_s
    places = [flat_map.local(Point(lat_deg=each.lat_deg, lon_deg=each.lon_deg)) for each in starts]
    ways = _back_and_forth(sweep.lines, sweep.heading_deg, settings.coverage.spacing_m)
    required_m = minimum_m + planned_margin_m()
    step_m = required_m + LAYER_GAP_M
    if pattern.altitude.reference == "home":  # each vehicle's altitudes count from its own take-off position
        step_m += max(each.alt_amsl_m for each in starts) - min(each.alt_amsl_m for each in starts)
    climbs = 1.0 / vehicle.takeoff_m_s + 1.0 / vehicle.climb_m_s + 2.0 / vehicle.descent_m_s
    costs = _Costs(
        turn_m=TURN_S * speed_m_s,
        layer_m=step_m * climbs * speed_m_s,
        shortest_m=max(SHORTEST_M, 2.0 * settings.coverage.trigger_m),
        near_m=required_m + 2.0 * float(braking_distance_m(speed_m_s)),
    )
    found = [_with_layers(places, each, costs) for each in ways]
    order, layers = min(found, key=lambda each: each[0].longest_m)
    heights_m = [_height_m(pattern.altitude, start) for start in starts]
    wait_s = min(MAX_WAIT_S, WAIT_S + order.longest_m / speed_m_s)
    roles: dict[str, Role] = {}
    parts: list[Part] = []
    origin = LocalOrigin(starts[0].lat_deg, starts[0].lon_deg, starts[0].alt_amsl_m)
    for number, (index, lines, layer) in enumerate(zip(order.vehicles, order.lines, layers, strict=True), 1):
        role, start = f"part {number}", starts[index]
        items = survey.items_of(settings, flat_map, lines)
        roles[role] = Role(
            start_ned_m=origin.to_ned(start.lat_deg, start.lon_deg, start.alt_amsl_m),
            steps=tuple(_steps(pattern, items, vehicle, speed_m_s, heights_m[index], layer * step_m, wait_s)),
        )
        points = tuple((flat_map.point(a), flat_map.point(b)) for a, b in lines)
        parts.append(Part(role, index, points, layer * step_m))
    mission = OffboardMission(
        name=name, home=starts[0], fence=plan.fence[:100], obstacles=plan.obstacles, roles=roles,
        minimum_separation_m=minimum_m,
    )  # fmt: skip
    return Division(mission, tuple(parts), tuple(_notes(plan, row)))


def planned_starts(home: HomePosition, count: int, minimum_m: float) -> list[HomePosition]:
    """Take-off positions in a row to the east of home, far enough apart to take off together."""
    origin = LocalOrigin(home.lat_deg, home.lon_deg, home.alt_amsl_m)
    distance_m = minimum_m + planned_margin_m() + START_GAP_M
    places = [origin.to_geodetic((0.0, number * distance_m, 0.0)) for number in range(count)]
    return [HomePosition(lat_deg=lat, lon_deg=lon, alt_amsl_m=home.alt_amsl_m) for lat, lon, _ in places]


def _survey_row(plan: Plan, item: int | None) -> tuple[int, SurveyPattern]:
    surveys = [
        (row, each.pattern)
        for row, each in enumerate(plan.items)
        if isinstance(each, PatternItem) and isinstance(each.pattern, SurveyPattern) and item in (None, row)
    ]
    if len(surveys) != 1:
        if item is not None:
            raise PlanError(
                f"item {item + 1}", "it is not a survey", "Give the item of a survey.", field="item"
            )
        reason = f"the plan has {len(surveys)} surveys"
        raise PlanError("the plan", reason, "Give the item of the survey to divide.", field="item")
    row, pattern = surveys[0]
    if pattern.altitude.reference == "terrain":
        reason = "its altitude is above the ground, and the layers of the ways out need one altitude"
        raise PlanError("the survey", reason, "Choose an altitude above home or AMSL.", field="item")
    return row, pattern


def _notes(plan: Plan, row: int) -> Iterator[str]:
    others = len(plan.items) - 1
    if others:
        yield f"{others} other {'items' if others > 1 else 'item'} of the plan (not {row + 1}) are left out."
    if plan.rally_points:
        yield "Rally points are left out, because the vehicle stores them."
    if len(plan.fence) > 100:
        yield "Only the first 100 geofence zones are kept."


def _height_m(altitude: Altitude, start: HomePosition) -> float:
    """Height of the lines above a take-off position [m]. Raises PlanError if they are too low."""
    height_m = altitude.value_m - (start.alt_amsl_m if altitude.reference == "amsl" else 0.0)
    if height_m < MIN_HEIGHT_M:
        reason = (
            f"its lines are {height_m:.1f} m above a take-off position, at least {MIN_HEIGHT_M} m are needed"
        )
        raise PlanError("the survey", reason, "Fly higher.", field="item")
    return height_m


# --- which vehicle flies which lines ------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Costs:
    """What decides about the parts, as distances at the speed of the survey [m]."""

    turn_m: float
    """What a turn costs beside its way."""
    layer_m: float
    """What one layer costs: climbs and descents."""
    shortest_m: float
    """No line is cut nearer to its ends."""
    near_m: float
    """Ways that come nearer than this to each other get different layers."""


@dataclass(frozen=True, slots=True)
class _Order:
    """The vehicles of the parts, and what they fly."""

    vehicles: tuple[int, ...]
    lines: tuple[tuple[Line, ...], ...]
    longest_m: float
    """Length of the longest way of a vehicle: out, lines with turns, back [m]."""


def _back_and_forth(lines: Sequence[Line], heading_deg: float, spacing_m: float) -> list[list[Line]]:
    """The four ways to fly all lines back and forth across the area: from each side, and with the first line
    in each direction."""
    heading_rad = math.radians(heading_deg)
    along = (math.sin(heading_rad), math.cos(heading_rad))
    across = (along[1], -along[0])

    def dot(position: EastNorth, axis: EastNorth) -> float:
        return position[0] * axis[0] + position[1] * axis[1]

    forward = [line if dot(line[0], along) <= dot(line[1], along) else _turned(line) for line in lines]
    bands: list[list[Line]] = []
    last_m = -math.inf
    for line in sorted(forward, key=lambda each: dot(each[0], across)):
        if dot(line[0], across) - last_m > spacing_m / 2.0:
            bands.append([])
        bands[-1].append(line)  # several lines in one band: the area has a hole, or is not convex
        last_m = dot(line[0], across)
    ways: list[list[Line]] = []
    for first_backwards in (0, 1):
        way: list[Line] = []
        for number, band in enumerate(bands, first_backwards):
            band.sort(key=lambda each: dot(each[0], along))
            way += [_turned(line) for line in reversed(band)] if number % 2 else band
        ways += [way, [_turned(line) for line in reversed(way)]]
    return ways


def _turned(line: Line) -> Line:
    return (line[1], line[0])


class _Way:
    """All lines in flight order as one way, by the distance flown with the costs of turns.

    Args:
        lines: the lines in flight order.
        costs: see `_Costs`.
    """

    def __init__(self, lines: Sequence[Line], costs: _Costs) -> None:
        self._lines, self._shortest_m = lines, costs.shortest_m
        self._starts_m: list[float] = []
        self.length_m = 0.0
        for number, line in enumerate(lines):
            if number > 0:
                self.length_m += math.dist(lines[number - 1][1], line[0]) + costs.turn_m
            self._starts_m.append(self.length_m)
            self.length_m += math.dist(*line)

    def point(self, at_m: float) -> EastNorth:
        """The position at a distance; in a turn, the start of the next line."""
        index = self._line(at_m)
        line = self._lines[index]
        if (within_m := at_m - self._starts_m[index]) <= (length_m := math.dist(*line)):
            return _between(line, within_m / max(length_m, 1e-9))
        return self._lines[index + 1][0] if index + 1 < len(self._lines) else line[1]

    def whole(self, at_m: float) -> float:
        """The nearest distance at which the way may be cut."""
        index = self._line(at_m)
        start_m, length_m = self._starts_m[index], math.dist(*self._lines[index])
        end_m = self._starts_m[index + 1] if index + 1 < len(self._lines) else self.length_m
        if at_m - start_m < min(self._shortest_m, length_m / 2.0):
            return start_m
        return at_m if start_m + length_m - at_m >= self._shortest_m else end_m

    def part(self, from_m: float, to_m: float) -> tuple[Line, ...]:
        """The lines between two distances; the first and the last one may be cut."""
        pieces: list[Line] = []
        for start_m, line in zip(self._starts_m, self._lines, strict=True):
            length_m = max(math.dist(*line), 1e-9)
            first, last = (min(1.0, max(0.0, (each - start_m) / length_m)) for each in (from_m, to_m))
            if (last - first) * length_m > 1e-6:
                pieces.append((_between(line, first), _between(line, last)))
        return tuple(pieces)

    def _line(self, at_m: float) -> int:
        return max(0, bisect.bisect_right(self._starts_m, at_m) - 1)


def _between(line: Line, fraction: float) -> EastNorth:
    (a, b), (c, d) = line
    return (a + (c - a) * fraction, b + (d - b) * fraction)


def _ordered(
    starts: Sequence[EastNorth], lines: Sequence[Line], costs: _Costs, extra_m: Sequence[float]
) -> _Order:
    """The parts if all lines are flown in this order.

    Args:
        starts: take-off positions.
        lines: lines in flight order.
        costs: see `_Costs`.
        extra_m: what the layer of each vehicle costs [m].

    Raises:
        PlanError: a part would have no line.
    """
    way, count = _Way(lines, costs), len(starts)
    middles = [way.point(way.length_m * (number + 0.5) / count) for number in range(count)]
    vehicles = _assigned(starts, middles)
    ordered = [(starts[each], extra_m[each]) for each in vehicles]
    low_m, high_m = 0.0, way.length_m + 2.0 * max(math.dist(a, b) for a in starts for b in middles)
    high_m += way.length_m + max(extra_m)
    for _ in range(BISECTIONS):
        middle_m = (low_m + high_m) / 2.0
        fits = _cuts(way, ordered, middle_m)[-1] >= way.length_m
        low_m, high_m = (low_m, middle_m) if fits else (middle_m, high_m)
    inner = [way.whole(each) for each in _cuts(way, ordered, high_m)[:-1]]
    parts = tuple(way.part(*each) for each in pairwise((0.0, *inner, way.length_m)))
    if not all(parts):
        reason = f"its {len(lines)} lines are too few for {count} vehicles"
        raise PlanError("the survey", reason, "Choose fewer vehicles.", field="vehicles")
    lengths_m = [
        math.dist(start, part[0][0]) + _Way(part, costs).length_m + math.dist(part[-1][1], start) + extra
        for (start, extra), part in zip(ordered, parts, strict=True)
    ]
    return _Order(vehicles, parts, max(lengths_m))


def _with_layers(
    starts: Sequence[EastNorth], lines: Sequence[Line], costs: _Costs
) -> tuple[_Order, list[int]]:
    """The parts and their layers.

    The layers follow from the parts, and a layer costs time: twice two climbs and descents. So the parts are
    made a second time.
    """
    extra_m = [0.0] * len(starts)
    order = _ordered(starts, lines, costs, extra_m)
    for vehicle, layer in zip(order.vehicles, _layers(order, starts, costs.near_m), strict=True):
        extra_m[vehicle] = layer * costs.layer_m
    with suppress(PlanError):  # in a small survey a layer may cost more than a part: then the first parts
        order = _ordered(starts, lines, costs, extra_m)
    return order, _layers(order, starts, costs.near_m)


def _cuts(way: _Way, starts: Sequence[tuple[EastNorth, float]], each_m: float) -> list[float]:
    """Ends of the parts if each vehicle flies `each_m` in all: out, its part of the way, and back."""
    ends_m: list[float] = []
    from_m = 0.0
    for start, extra_m in starts:
        left_m = each_m - extra_m - math.dist(start, way.point(from_m))
        low_m, high_m = from_m, way.length_m
        if high_m - from_m + math.dist(way.point(high_m), start) > left_m:
            for _ in range(BISECTIONS):
                middle_m = (low_m + high_m) / 2.0
                fits = middle_m - from_m + math.dist(way.point(middle_m), start) <= left_m
                low_m, high_m = (middle_m, high_m) if fits else (low_m, middle_m)
            high_m = low_m
        from_m = high_m
        ends_m.append(from_m)
    return ends_m


def _assigned(starts: Sequence[EastNorth], middles: Sequence[EastNorth]) -> tuple[int, ...]:
    """The vehicle of each part so that all ways together are shortest; such straight ways never cross."""
    best: dict[int, tuple[float, tuple[int, ...]]] = {0: (0.0, ())}
    for middle in middles:
        following: dict[int, tuple[float, tuple[int, ...]]] = {}
        for used, (total_m, vehicles) in best.items():
            for vehicle, start in enumerate(starts):
                if used >> vehicle & 1:
                    continue
                chosen = (total_m + math.dist(start, middle), (*vehicles, vehicle))
                key = used | 1 << vehicle
                following[key] = min(chosen, following.get(key, chosen))
        best = following
    return next(iter(best.values()))[1]


# --- layers and steps ---------------------------------------------------------------------------------------


def _layers(order: _Order, starts: Sequence[EastNorth], near_m: float) -> list[int]:
    """The lowest layer of each part in which its ways out and back are nowhere near those of another part."""
    ways = [
        [LineString([starts[v], lines[0][0]]), LineString([lines[-1][1], starts[v]])]
        for v, lines in zip(order.vehicles, order.lines, strict=True)
    ]
    layers: list[int] = []
    for own in ways:
        taken = {
            layer
            for layer, other in zip(layers, ways, strict=False)
            if any(shapely.dwithin(a, b, near_m) for a, b in zip(own, other, strict=True))
        }
        layers.append(next(each for each in range(len(ways)) if each not in taken))
    return layers


def _steps(
    pattern: SurveyPattern,
    items: Sequence[SimpleItem],
    vehicle: VehicleModel,
    speed_m_s: float,
    height_m: float,
    layer_m: float,
    wait_s: float,
) -> Iterator[s.MissionStep]:
    """The steps of one part."""
    placed = [each for each in items if isinstance(each, PlacedItem)]
    above_m = height_m + layer_m

    def level(at: MissionPosition, step_name: str) -> s.Fly:
        point = s.FlyPoint(**at.model_dump(), stop=True)
        return s.Fly(name=step_name, points=(point,), speed_m_s=speed_m_s, heading="along_path")

    def meet(meeting: str) -> s.Meet:
        return s.Meet(meeting=meeting, timeout_s=wait_s)

    first, last = (_above(each, layer_m) for each in (placed[0], placed[-1]))
    yield s.TakeOff(height_m=above_m, timeout_s=max(TAKE_OFF_S, above_m / CLIMB_M_S))
    yield meet("all up")
    yield level(first, "To the first line")
    yield meet("at the lines")
    yield from steps_from_pattern(pattern, items, vehicle)
    if layer_m > 0.0:
        yield s.Fly(name="Up to the way back", points=(s.FlyPoint(**last.model_dump(), stop=True),))
    yield meet("lines done")
    yield level(MissionPosition(offset_ned_m=(0.0, 0.0, -above_m)), "Back to the take-off position")
    yield meet("all back")
    yield s.Land()


def _above(item: PlacedItem, by_m: float) -> MissionPosition:
    """The position of an item, higher."""
    value_m = item.altitude.value_m + by_m
    amsl = item.altitude.reference == "amsl"
    return MissionPosition(
        lat_deg=item.lat_deg,
        lon_deg=item.lon_deg,
        alt_amsl_m=value_m if amsl else None,
        alt_home_m=None if amsl else value_m,
    )
