"""Closed paths: perimeter of an area, orbit around a point, and rounds at several heights around a
structure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from shapely.geometry import Polygon

from missions.camera_items import GimbalPitchYaw
from missions.errors import PlanError
from missions.items import RoiLocation, RoiNone
from missions.pattern_settings import MAX_ROUNDS
from missions.patterns.camera import AnyCoverage
from missions.patterns.ground import EastNorth, Map, heading_deg
from missions.patterns.result import Pattern, photo_count, with_photos, within_item_limit
from missions.plan import SimpleItem
from missions.values import Altitude, Point

YAW_IN_VEHICLE_FRAME = 32.0
"""GIMBAL_MANAGER_FLAGS_YAW_IN_VEHICLE_FRAME."""
MITRE_LIMIT = 2.0
"""A corner is cut off if it would be farther from the area than this multiple of the offset."""


def perimeter(outer: Sequence[Point], offset_m: float, altitude: Altitude, rounds: int = 1) -> Pattern:
    """A path around an area, clockwise, at a distance from its edge: positive outside, negative inside.

    Raises:
        PlanError: The area is invalid, the path inside it is empty, or there are too many rounds.
    """
    flat_map = Map.centred_on(outer, "the area", "outer")
    area = flat_map.polygon(outer)
    ring = _offset_outline(area, offset_m, "offset_m")
    path = ring * _valid_rounds(rounds) + ring[:1]
    items = [flat_map.waypoint(position, altitude) for position in path]
    length_m = sum(math.dist(a, b) for a, b in pairwise(path))
    return Pattern(items=within_item_limit(items), lines_length_m=length_m)


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
    """Circles around a point, as polygons that deviate from the circle by at most `deviation_m`.

    The path starts at the bearing `start_deg` from the centre, clockwise from north. With `look_at` the
    camera points at the centre at that altitude. The number n of corners follows from the
    deviation (sagitta): n = π / acos(1 − deviation / radius).

    Raises:
        PlanError: The radius or the number of rounds is invalid.
    """
    if not 1.0 <= radius_m <= 10_000.0 or not 0.0 < deviation_m <= radius_m:
        raise PlanError(
            "field radius_m",
            f"{radius_m:g} m is not possible with a deviation of {deviation_m:g} m from the circle",
            "Set 1 to 10,000 m.",
            field="radius_m",
        )
    corners = max(8, math.ceil(math.pi / math.acos(1.0 - deviation_m / radius_m)))
    flat_map = Map.centred_on([center], "the centre", "center")
    step = math.tau / corners * (1.0 if clockwise else -1.0)
    items: list[SimpleItem] = []
    if look_at is not None:
        items.append(RoiLocation(lat_deg=center.lat_deg, lon_deg=center.lon_deg, altitude=look_at))
    count = corners * _valid_rounds(rounds)
    for number in range(count + 1):
        angle = math.radians(start_deg) + number * step
        items.append(flat_map.waypoint((radius_m * math.sin(angle), radius_m * math.cos(angle)), altitude))
    if look_at is not None:
        items.append(RoiNone())
    side_m = 2.0 * radius_m * math.sin(math.pi / corners)
    return Pattern(items=within_item_limit(items), lines_length_m=count * side_m)


@dataclass(frozen=True, slots=True)
class StructureScan:
    """Settings of a scan of a structure's sides."""

    outline: Sequence[Point]
    coverage: AnyCoverage
    """`distance_m` is the distance from the camera to the sides; `side_overlap` is the overlap between
    two rounds."""
    base: Altitude
    """Altitude of the structure's base."""
    height_m: float
    """Height of the structure above its base."""
    lowest_m: float = 3.0
    """Height of the lowest round above the base."""
    from_top: bool = False
    """Whether to fly the highest round first."""
    gimbal_pitch_deg: float = 0.0
    layers: int | None = None
    """Number of rounds, one spacing apart; None: as many as cover the height, evenly spaced."""
    entrance: Altitude | None = None
    """Altitude at which the vehicle comes and leaves, above the start of the rounds; None: it does not."""


def structure(scan: StructureScan) -> Pattern:
    """Clockwise rounds around a structure at several heights, with the nose and the camera towards the sides.

    Rounds are at most `footprint · (1 − side overlap)` apart; the photos of the highest round show the top.
    The width of a landscape photo is along the path.

    Raises:
        PlanError: The outline or a height is invalid.
    """
    for name, height_m in (("height_m", scan.height_m), ("lowest_m", scan.lowest_m)):
        if not 0.0 < height_m <= 10_000.0:
            reason = f"{height_m:g} m is not above 0 and at most 10,000 m"
            raise PlanError(f"field {name}", reason, "Correct this value.", field=name)
    flat_map = Map.centred_on(scan.outline, "the outline", "outline")
    outline = flat_map.polygon(scan.outline, field="outline")
    ring = _offset_outline(outline, scan.coverage.distance_m, "coverage.distance_m")
    path = [*ring, ring[0]]
    heights, coverage = round_heights(scan), scan.coverage.sideways()
    passage = [] if scan.entrance is None else [flat_map.waypoint(path[0], scan.entrance)]
    items: list[SimpleItem] = [
        *passage,
        GimbalPitchYaw(pitch_deg=scan.gimbal_pitch_deg, yaw_deg=0.0, flags=YAW_IN_VEHICLE_FRAME),
    ]
    for height_m in reversed(heights) if scan.from_top else heights:
        altitude = altitude_above(scan.base, height_m)
        yaws_deg = [(heading_deg(a, b) + 90.0) % 360.0 for a, b in pairwise(path)]
        items.append(flat_map.waypoint(path[0], altitude, yaws_deg[0]))
        sides = zip(path[1:], yaws_deg, strict=True)
        corners: list[SimpleItem] = [flat_map.waypoint(corner, altitude, yaw) for corner, yaw in sides]
        items += with_photos(corners, coverage)
    items += passage
    perimeter_m = sum(math.dist(a, b) for a, b in pairwise(path))
    return Pattern(
        items=within_item_limit(items),
        lines_length_m=perimeter_m * len(heights),
        photos=len(heights) * photo_count(perimeter_m, coverage),
        spacing_m=abs(heights[1] - heights[0]) if len(heights) > 1 else 0.0,
        trigger_m=coverage.trigger_m,
        resolution_m_px=scan.coverage.resolution_m_px,
        area_m2=outline.exterior.length * scan.height_m,
    )


def round_heights(scan: StructureScan) -> list[float]:
    """Height of each round above the base [m], from the lowest to the highest; evenly spaced. The photos of
    the highest round show the top."""
    coverage = scan.coverage.sideways()
    spacing_m = coverage.spacing_m
    if scan.layers is not None:
        return _given_rounds(scan, scan.layers, spacing_m)
    highest_m = max(scan.lowest_m, scan.height_m - coverage.across_m / 2.0)
    count = 1 + max(0, math.ceil((highest_m - scan.lowest_m) / spacing_m - 1e-9))
    if count > MAX_ROUNDS:
        raise PlanError(
            "the rounds",
            f"{count} rounds are needed, the maximum is {MAX_ROUNDS}",
            "Reduce the overlap.",
            field="coverage.side_overlap",
        )
    step_m = (highest_m - scan.lowest_m) / max(1, count - 1)
    return [scan.lowest_m + number * step_m for number in range(count)]


def _given_rounds(scan: StructureScan, count: int, spacing_m: float) -> list[float]:
    """Heights of this number of rounds, one spacing apart, from the lowest to the highest [m]."""
    lowest_m = scan.lowest_m
    if scan.from_top:
        lowest_m = scan.height_m - spacing_m / 2.0 - (count - 1) * spacing_m
    if lowest_m <= 0.0:
        reason = f"the lowest of {count} rounds is {lowest_m:.1f} m above the base"
        raise PlanError("field layers", reason, "Reduce the number of rounds.", field="layers")
    return [lowest_m + number * spacing_m for number in range(count)]


def altitude_above(base: Altitude, above_m: float) -> Altitude:
    """An altitude `above_m` higher than `base`, with the same reference."""
    resolved = base.resolved_amsl_m
    return Altitude(
        value_m=base.value_m + above_m,
        reference=base.reference,
        resolved_amsl_m=None if resolved is None else resolved + above_m,
    )


def _offset_outline(area: Polygon, offset_m: float, field: str) -> list[EastNorth]:
    """The corners of the outline at a distance from an area, clockwise; the first corner is not repeated.

    `field` is the name of the distance's field in errors.
    """
    offset_area = area.buffer(offset_m, join_style="mitre", mitre_limit=MITRE_LIMIT)
    if offset_area.geom_type != "Polygon" or offset_area.is_empty:
        raise PlanError(
            f"field {field}",
            "at this distance the area is empty or in several parts",
            "Reduce the distance.",
            field=field,
        )
    corners = [(float(x), float(y)) for x, y in offset_area.exterior.coords[:-1]]
    return corners if not offset_area.exterior.is_ccw else corners[::-1]


def _valid_rounds(rounds: int) -> int:
    if not 1 <= rounds <= MAX_ROUNDS:
        reason = f"{rounds} is not between 1 and {MAX_ROUNDS}"
        raise PlanError("field rounds", reason, "Correct this value.", field="rounds")
    return rounds
