"""Patterns: coverage, overlap, and length compared with the minimum."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import LineString, Polygon

from missions.camera_items import GimbalPitchYaw, TriggerDistance
from missions.checks import CheckLimits, check
from missions.errors import PlanError
from missions.items import ChangeSpeed, RoiLocation, RoiNone, Takeoff, Waypoint
from missions.patterns.camera import Camera, Coverage
from missions.patterns.corridor import corridor
from missions.patterns.ground import Map, heading_deg
from missions.patterns.result import Pattern
from missions.patterns.rounds import StructureScan, orbit, perimeter, round_heights, structure
from missions.patterns.survey import Survey, make
from missions.plan import Plan
from missions.values import Altitude, HomePosition, Point

CAMERA = Camera(13.2, 8.8, 8.8, 5472, 3648)
ALTITUDE = Altitude(value_m=60.0, reference="home")
COVERAGE = Coverage(CAMERA, distance_m=60.0)
LOCAL_MAP = Map.centred_on([Point(lat_deg=47.4, lon_deg=8.5)], "the test", "outer")


def points(corners: list[tuple[float, float]]) -> list[Point]:
    return [LOCAL_MAP.point(corner) for corner in corners]


def star(radii: list[float], start_rad: float = 0.0) -> list[tuple[float, float]]:
    """A polygon around the centre, convex or not, whose sides never cross."""
    step = math.tau / len(radii)
    return [
        (r * math.sin(start_rad + n * step), r * math.cos(start_rad + n * step)) for n, r in enumerate(radii)
    ]


@st.composite
def areas(draw: st.DrawFn) -> tuple[list[tuple[float, float]], list[list[tuple[float, float]]]]:
    """An outline with radii of 100 to 500 m, with or without a hole with radii of at most 60 m."""
    outer = star(draw(st.lists(st.floats(100.0, 500.0), min_size=4, max_size=12)), draw(st.floats(0.0, 1.0)))
    hole = star(draw(st.lists(st.floats(10.0, 60.0), min_size=3, max_size=8)), draw(st.floats(0.0, 1.0)))
    return outer, [hole] if draw(st.booleans()) else []


def local_lines(pattern: Pattern) -> list[LineString]:
    return [LineString([LOCAL_MAP.local(start), LOCAL_MAP.local(end)]) for start, end in pattern.lines]


def pictures(line: LineString, coverage: Coverage) -> list[Polygon]:
    """The ground area of each picture of a line."""
    across, along = coverage.camera.footprint_m(coverage.distance_m)
    (x, y), (x_end, y_end) = line.coords
    length = math.dist((x, y), (x_end, y_end))
    ahead = np.array([x_end - x, y_end - y]) / length
    left = np.array([-ahead[1], ahead[0]])
    corners = np.array([[-along, -across], [along, -across], [along, across], [-along, across]]) / 2.0
    count = 1 + int((length + coverage.lead_out_m) / coverage.trigger_m + 1e-9)
    centers = [np.array([x, y]) + ahead * n * coverage.trigger_m for n in range(count)]
    return [Polygon(center + corners[:, :1] * ahead + corners[:, 1:] * left) for center in centers]


@settings(deadline=None, max_examples=40)
@given(
    area=areas(),
    side=st.floats(0.0, 0.8),
    front=st.floats(0.0, 0.8),
    heading=st.none() | st.floats(0.0, 360.0),
    distance=st.floats(30.0, 80.0),
)
def test_a_survey_covers_any_area_with_the_requested_overlap(
    area: tuple[list[tuple[float, float]], list[list[tuple[float, float]]]],
    side: float,
    front: float,
    heading: float | None,
    distance: float,
) -> None:
    outer, holes = area
    coverage = Coverage(CAMERA, distance, front, side)
    pattern = make(Survey(points(outer), coverage, ALTITUDE, [points(hole) for hole in holes], heading))
    shape = Polygon(outer, holes)
    lines = local_lines(pattern)

    photo_areas = [picture for line in lines for picture in pictures(line, coverage)]
    ground = shapely.union_all(photo_areas, grid_size=1e-3)
    assert shape.intersection(ground).area / shape.area >= 0.995

    across_m, along_m = CAMERA.footprint_m(distance)
    assert pattern.spacing_m == pytest.approx(across_m * (1.0 - side))
    assert pattern.trigger_m == pytest.approx(along_m * (1.0 - front))
    assert pattern.heading_deg is not None
    angle = math.radians(pattern.heading_deg)
    offsets = np.array(
        [line.coords[0][0] * math.cos(angle) - line.coords[0][1] * math.sin(angle) for line in lines]
    )
    line_numbers = (offsets - offsets[0]) / pattern.spacing_m
    assert np.abs(line_numbers - np.round(line_numbers)).max() < 0.01

    outline_m = shape.length
    assert pattern.lower_bound_m == pytest.approx(shape.area / pattern.spacing_m, rel=1e-3)
    assert (
        pattern.lower_bound_m * 0.999 <= pattern.lines_length_m <= (pattern.lower_bound_m + outline_m) * 1.001
    )


def test_the_lines_of_a_survey_without_a_heading_are_along_the_long_side() -> None:
    rectangle = [(0.0, 0.0), (400.0, 300.0), (340.0, 380.0), (-60.0, 80.0)]
    pattern = make(Survey(points(rectangle), COVERAGE, ALTITUDE))
    assert pattern.heading_deg == pytest.approx(heading_deg((0.0, 0.0), (400.0, 300.0)), abs=0.1)
    assert pattern.lines_length_m == pytest.approx(500.0 * math.ceil(100.0 / pattern.spacing_m), rel=0.01)


def test_neighbouring_lines_of_a_rectangular_field_are_flown_one_after_the_other() -> None:
    pattern = make(
        Survey(points([(0, 0), (300, 0), (300, 200), (0, 200)]), COVERAGE, ALTITUDE, heading_deg=90.0)
    )
    lines = local_lines(pattern)
    for before, after in pairwise(lines):
        assert math.dist(before.coords[1], after.coords[0]) == pytest.approx(pattern.spacing_m, rel=0.01)


def test_pictures_are_taken_on_the_lines_and_not_in_the_turns() -> None:
    square = points([(0, 0), (200, 0), (200, 20), (0, 20)])
    pattern = make(Survey(square, COVERAGE, ALTITUDE, heading_deg=90.0, turnaround_m=15.0, speed_m_s=6.0))
    speed, *items = pattern.items
    assert speed == ChangeSpeed(speed_m_s=6.0)
    start_trigger = TriggerDistance(distance_m=pattern.trigger_m, at_once=1.0)
    stop_trigger = TriggerDistance(distance_m=0.0)
    assert [item if isinstance(item, TriggerDistance) else None for item in items] == [
        None,
        None,
        start_trigger,
        None,
        stop_trigger,
        None,
    ]
    east = [
        LOCAL_MAP.local(Point(lat_deg=item.lat_deg, lon_deg=item.lon_deg))[0]
        for item in items
        if isinstance(item, Waypoint)
    ]
    assert sorted(east) == pytest.approx([-15.0, 0.0, 200.0, 215.0], abs=0.01)
    assert pattern.photos == 1 + int(200.0 / pattern.trigger_m)


def test_a_crosshatch_adds_the_same_lines_at_right_angles() -> None:
    field = points([(0, 0), (300, 0), (300, 200), (0, 200)])
    simple, crosshatch = (
        make(Survey(field, COVERAGE, ALTITUDE, heading_deg=90.0, crosshatch=each)) for each in (False, True)
    )
    added_headings_deg = [
        heading_deg(*line.coords) % 180.0 for line in local_lines(crosshatch)[len(simple.lines) :]
    ]
    assert added_headings_deg
    assert all(min(heading, 180.0 - heading) < 0.1 for heading in added_headings_deg)
    assert crosshatch.lower_bound_m == pytest.approx(2.0 * simple.lower_bound_m)


def test_a_plan_with_a_survey_has_no_findings() -> None:
    home = LOCAL_MAP.point((0.0, 0.0))
    takeoff = Takeoff(lat_deg=home.lat_deg, lon_deg=home.lon_deg, altitude=ALTITUDE)
    items = make(Survey(points([(0, 0), (300, 0), (300, 200), (0, 200)]), COVERAGE, ALTITUDE)).items
    planned_home = HomePosition(lat_deg=home.lat_deg, lon_deg=home.lon_deg, alt_amsl_m=400.0)
    assert check(Plan(items=(takeoff, *items), planned_home=planned_home), CheckLimits()) == ()


def covered_strip(line: LineString, across_m: float, beyond_m: float) -> Polygon:
    """The strip that the pictures of a line cover; it extends by `beyond_m` beyond both ends of the line."""
    start, end = np.array(line.coords)
    ahead = (end - start) / line.length * beyond_m
    return LineString([start - ahead, end + ahead]).buffer(across_m / 2.0, cap_style="flat")


@settings(deadline=None, max_examples=25)
@given(
    bends_deg=st.lists(st.floats(-30.0, 30.0), min_size=1, max_size=5),
    width=st.floats(10.0, 150.0),
    side=st.floats(0.0, 0.8),
)
def test_the_whole_width_of_a_corridor_is_covered(bends_deg: list[float], width: float, side: float) -> None:
    path, heading = [(0.0, 0.0)], 0.0
    for bend_deg in bends_deg:
        heading += math.radians(bend_deg)
        path.append((path[-1][0] + 300.0 * math.sin(heading), path[-1][1] + 300.0 * math.cos(heading)))
    coverage = Coverage(CAMERA, 60.0, 0.7, side)
    pattern = corridor(points(path), width, coverage, ALTITUDE)
    across_m, along_m = CAMERA.footprint_m(60.0)
    beyond_m = along_m / 2.0 - pattern.trigger_m
    strips = shapely.union_all(
        [covered_strip(line, across_m, beyond_m) for line in local_lines(pattern)], grid_size=1e-3
    )
    corridor_area = LineString(path).buffer(width / 2.0, cap_style="flat", join_style="mitre")
    assert corridor_area.intersection(strips).area / corridor_area.area >= 0.995
    assert pattern.spacing_m <= coverage.spacing_m * 1.001
    assert pattern.lines_length_m >= 0.99 * LineString(path).length * width / across_m


def positions(pattern: Pattern) -> list[tuple[float, float]]:
    return [
        LOCAL_MAP.local(Point(lat_deg=item.lat_deg, lon_deg=item.lon_deg))
        for item in pattern.items
        if isinstance(item, Waypoint)
    ]


@settings(deadline=None, max_examples=30)
@given(area=areas(), offset=st.floats(5.0, 50.0))
def test_a_perimeter_has_its_offset_from_the_area_and_is_flown_clockwise(
    area: tuple[list[tuple[float, float]], list[list[tuple[float, float]]]], offset: float
) -> None:
    ring = positions(perimeter(points(area[0]), offset, ALTITUDE))
    assert ring[0] == pytest.approx(ring[-1])
    assert Polygon(area[0]).distance(LineString(ring)) == pytest.approx(offset, rel=0.02)
    assert not Polygon(ring).exterior.is_ccw


@pytest.mark.parametrize("clockwise", [True, False])
def test_an_orbit_is_flown_on_its_circle_with_the_camera_towards_the_centre(clockwise: bool) -> None:
    center = LOCAL_MAP.point((0.0, 0.0))
    target_altitude = Altitude(value_m=5.0, reference="home")
    pattern = orbit(
        center,
        50.0,
        ALTITUDE,
        look_at=target_altitude,
        rounds=2,
        clockwise=clockwise,
        start_deg=90.0,
        deviation_m=0.5,
    )
    ring = positions(pattern)
    assert ring[0] == pytest.approx((50.0, 0.0), abs=0.01)
    assert {round(math.hypot(*position), 2) for position in ring} == {50.0}
    assert LineString(ring).distance(shapely.Point(0, 0)) >= 49.49
    assert Polygon(ring[: len(ring) // 2]).exterior.is_ccw is not clockwise
    assert pattern.items[0] == RoiLocation(
        lat_deg=center.lat_deg, lon_deg=center.lon_deg, altitude=target_altitude
    )
    assert pattern.items[-1] == RoiNone()
    assert pattern.lines_length_m == pytest.approx(2 * math.tau * 50.0, rel=0.01)


def test_a_structure_scan_covers_its_sides_from_bottom_to_top() -> None:
    tower = points([(-10, -10), (10, -10), (10, 10), (-10, 10)])
    coverage = Coverage(CAMERA, 12.0, front_overlap=0.7, side_overlap=0.5)
    scan = StructureScan(
        tower, coverage, Altitude(value_m=0.0, reference="home"), height_m=40.0, lowest_m=4.0
    )
    pattern = structure(scan)
    heights = round_heights(scan)
    picture_m = 8.8 * 12.0 / 8.8  # sensor height * distance / focal length
    assert np.diff(heights).max() <= picture_m * 0.5 + 1e-9
    assert heights[0] == 4.0
    assert heights[-1] + picture_m / 2.0 == pytest.approx(40.0)
    assert pattern.trigger_m == pytest.approx(13.2 * 12.0 / 8.8 * 0.3)  # picture width without its overlap
    assert isinstance(pattern.items[0], GimbalPitchYaw)
    ring = positions(pattern)[:5]
    assert Polygon(ring).exterior.distance(shapely.box(-10, -10, 10, 10)) == pytest.approx(12.0, abs=0.01)
    waypoints = [item for item in pattern.items if isinstance(item, Waypoint)][:5]
    for (start, end), waypoint in zip(pairwise(ring), waypoints[1:], strict=True):
        middle = ((start[0] + end[0]) / 2.0, (start[1] + end[1]) / 2.0)
        assert waypoint.yaw_ned_deg is not None
        error_rad = math.radians(waypoint.yaw_ned_deg - heading_deg(middle, (0.0, 0.0)))
        assert abs(math.remainder(error_rad, math.tau)) < 0.01
    from_top = structure(replace(scan, from_top=True))
    first_waypoint = next(item for item in from_top.items if isinstance(item, Waypoint))
    assert first_waypoint.altitude.value_m == heights[-1]


SELF_INTERSECTING = points([(0, 0), (100, 100), (100, 0), (0, 100)])
FIELD = points([(0, 0), (300, 0), (300, 200), (0, 200)])


@pytest.mark.parametrize(
    ("make_pattern", "message"),
    [
        (lambda: make(Survey(SELF_INTERSECTING, COVERAGE, ALTITUDE)), "the area: its sides cross or touch"),
        (lambda: make(Survey(FIELD[:2], COVERAGE, ALTITUDE)), "fewer than 3 corners"),
        (lambda: make(Survey(FIELD, Coverage(CAMERA, 0.1), ALTITUDE)), "lines are needed"),
        (
            lambda: make(Survey([*FIELD[:3], Point(lat_deg=0, lon_deg=0)], COVERAGE, ALTITUDE)),
            "the area: it extends",
        ),
        (lambda: Coverage(CAMERA, 60.0, side_overlap=1.0), "field side_overlap: 1 is not between"),
        (lambda: Coverage(CAMERA, math.nan), "a size or the distance is not above 0"),
        (lambda: perimeter(FIELD, -120.0, ALTITUDE), "field offset_m: at this distance the area is"),
        (lambda: perimeter(FIELD, 5.0, ALTITUDE, rounds=0), "field rounds: 0 is not between"),
        (lambda: orbit(FIELD[0], math.nan, ALTITUDE), "field radius_m"),
        (lambda: corridor(FIELD[:1], 50.0, COVERAGE, ALTITUDE), "the line: it has fewer than 2 points"),
        (lambda: corridor(FIELD, 0.0, COVERAGE, ALTITUDE), "field width_m: 0 m is not above 0"),
    ],
)
def test_impossible_patterns_are_refused_with_a_reason(make_pattern: object, message: str) -> None:
    with pytest.raises(PlanError, match=message):
        make_pattern()  # type: ignore[operator]
