"""Ways around something: perimeter of an area, orbit of a point, layers around a structure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from shapely.geometry import Polygon

from missions.camera_items import GimbalPitchYaw, TriggerDistance
from missions.errors import PlanError
from missions.items import RoiLocation, RoiNone
from missions.patterns.camera import Coverage
from missions.patterns.ground import East, Map, heading_deg
from missions.patterns.result import Pattern, bounded, photo_count
from missions.plan import SimpleItem
from missions.values import Altitude, Point

MAX_ROUNDS = 100
YAW_IN_VEHICLE_FRAME = 32.0
"""GIMBAL_MANAGER_FLAGS_YAW_IN_VEHICLE_FRAME."""
MITRE_LIMIT = 2.0
"""Sharper corners are cut off at twice the distance."""


def perimeter(outer: Sequence[Point], offset_m: float, altitude: Altitude, rounds: int = 1) -> Pattern:
    """Around an area, clockwise, at a distance from its edge: positive outside, negative inside.

    Raises:
        PlanError: The area is no area, nothing is left inside, or there are too many rounds.
    """
    chart = Map.about(outer, "the area")
    ring = _ring(chart.polygon(outer), offset_m)
    path = ring * _checked_rounds(rounds) + ring[:1]
    items = [chart.waypoint(place, altitude) for place in path]
    length_m = sum(math.dist(a, b) for a, b in pairwise(path))
    return Pattern(items=bounded(items), lines_length_m=length_m)


def orbit(
    center: Point,
    radius_m: float,
    altitude: Altitude,
    *,
    look_at: Altitude | None = None,
    rounds: int = 1,
    clockwise: bool = True,
    start_deg: float = 0.0,
    deviation_m: float = 0.5,
) -> Pattern:
    """Circles around a point, as corners so near that the sides stay within `deviation_m` of the circle.

    Starts at `start_deg` from the centre, clockwise from north. With `look_at` the camera looks at the centre
    at that altitude. The number of corners follows from the sagitta: n = π / acos(1 − deviation / radius).

    Raises:
        PlanError: The radius or the number of rounds cannot be.
    """
    if not 1.0 <= radius_m <= 10_000.0 or not 0.0 < deviation_m <= radius_m:
        raise PlanError(
            "field radius_m", f"{radius_m:g} m with {deviation_m:g} m is not possible", "Set 1 to 10,000 m."
        )
    corners = max(8, math.ceil(math.pi / math.acos(1.0 - deviation_m / radius_m)))
    chart = Map.about([center], "the centre")
    step = math.tau / corners * (1.0 if clockwise else -1.0)
    items: list[SimpleItem] = []
    if look_at is not None:
        items.append(RoiLocation(lat_deg=center.lat_deg, lon_deg=center.lon_deg, altitude=look_at))
    count = corners * _checked_rounds(rounds)
    for number in range(count + 1):
        angle = math.radians(start_deg) + number * step
        items.append(chart.waypoint((radius_m * math.sin(angle), radius_m * math.cos(angle)), altitude))
    if look_at is not None:
        items.append(RoiNone())
    side_m = 2.0 * radius_m * math.sin(math.pi / corners)
    return Pattern(items=bounded(items), lines_length_m=count * side_m)


@dataclass(frozen=True, slots=True)
class StructureScan:
    """What a scan of a structure's sides is made from."""

    outline: Sequence[Point]
    coverage: Coverage
    """`distance_m` is from the camera to the sides; side overlap is between layers."""
    base: Altitude
    """Of the structure's foot."""
    height_m: float
    """Of the structure above its foot."""
    lowest_m: float = 3.0
    """Of the lowest layer above the foot."""
    from_top: bool = False
    gimbal_pitch_deg: float = 0.0


def structure(scan: StructureScan) -> Pattern:
    """Rounds about a structure, clockwise, one above the other, nose and camera towards the side.

    Layers are `footprint · (1 − side overlap)` apart or nearer; the pictures of the highest reach the top.
    The camera is upright: the picture's width lies along the way.

    Raises:
        PlanError: The outline is no area, or a height cannot be.
    """
    if not 0.0 < scan.lowest_m <= 10_000.0 or not 0.0 < scan.height_m <= 10_000.0:
        raise PlanError(
            "field height_m", f"{scan.height_m:g} m with {scan.lowest_m:g} m is not possible", "Correct it."
        )
    chart = Map.about(scan.outline, "the outline")
    ring = _ring(chart.polygon(scan.outline), scan.coverage.distance_m)
    path = [*ring, ring[0]]
    heights, coverage = layer_heights(scan), _upright(scan.coverage)
    items: list[SimpleItem] = [
        GimbalPitchYaw(pitch_deg=scan.gimbal_pitch_deg, yaw_deg=0.0, flags=YAW_IN_VEHICLE_FRAME)
    ]
    for height_m in reversed(heights) if scan.from_top else heights:
        altitude = replace_value(scan.base, height_m)
        facing = [(heading_deg(a, b) + 90.0) % 360.0 for a, b in pairwise(path)]
        items.append(chart.waypoint(path[0], altitude, facing[0]))
        items.append(TriggerDistance(distance_m=coverage.trigger_m, at_once=1.0))
        items += [chart.waypoint(place, altitude, yaw) for place, yaw in zip(path[1:], facing, strict=True)]
        items.append(TriggerDistance(distance_m=0.0))
    around_m = sum(math.dist(a, b) for a, b in pairwise(path))
    return Pattern(
        items=bounded(items),
        lines_length_m=around_m * len(heights),
        photos=len(heights) * photo_count(around_m, coverage),
        spacing_m=heights[1] - heights[0] if len(heights) > 1 else 0.0,
        trigger_m=coverage.trigger_m,
        resolution_m_px=scan.coverage.camera.resolution_m_px(scan.coverage.distance_m),
    )


def layer_heights(scan: StructureScan) -> list[float]:
    """Of each layer above the foot [m], from below; evenly spread, the highest one shows the top."""
    coverage = _upright(scan.coverage)
    picture_m, spacing_m = coverage.camera.footprint_m(coverage.distance_m)[0], coverage.spacing_m
    highest_m = max(scan.lowest_m, scan.height_m - picture_m / 2.0)
    count = 1 + max(0, math.ceil((highest_m - scan.lowest_m) / spacing_m - 1e-9))
    if count > MAX_ROUNDS:
        raise PlanError(
            "the layers", f"there would be {count}, the maximum is {MAX_ROUNDS}", "Reduce the overlap."
        )
    step_m = (highest_m - scan.lowest_m) / max(1, count - 1)
    return [scan.lowest_m + number * step_m for number in range(count)]


def _upright(coverage: Coverage) -> Coverage:
    """Sideways flight: the picture's height lies across the way, its width along it."""
    return replace(coverage, camera=replace(coverage.camera, landscape=False))


def replace_value(base: Altitude, above_m: float) -> Altitude:
    """So many metres above an altitude, by the same reference."""
    resolved = base.resolved_amsl_m
    return Altitude(
        value_m=base.value_m + above_m,
        reference=base.reference,
        resolved_amsl_m=None if resolved is None else resolved + above_m,
    )


def _ring(area: Polygon, offset_m: float) -> list[East]:
    """The corners of the grown area's outline, clockwise, without the first again."""
    grown = area.buffer(offset_m, join_style="mitre", mitre_limit=MITRE_LIMIT)
    if grown.geom_type != "Polygon" or grown.is_empty:
        raise PlanError(
            "field offset_m", "at this distance the area is empty or in several parts", "Come nearer."
        )
    corners = [(float(x), float(y)) for x, y in grown.exterior.coords[:-1]]
    return corners if not grown.exterior.is_ccw else corners[::-1]


def _checked_rounds(rounds: int) -> int:
    if not 1 <= rounds <= MAX_ROUNDS:
        raise PlanError("field rounds", f"{rounds} is not between 1 and {MAX_ROUNDS}", "Correct this value.")
    return rounds
