"""Ground altitudes from elevation files: interpolation, following, and clearance."""

from __future__ import annotations

import itertools
import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_server.plans.work import ELEVATION_SUFFIXES, elevation_files
from missions.errors import PlanError
from missions.formats.mavlink_items import mission_items
from missions.geodesy import LocalOrigin, distance_m
from missions.items import Jump, Land, ReturnHome, Takeoff, Waypoint
from missions.offboard.samples import Leg
from missions.plan import Plan
from missions.terrain.clearance import mission_findings, plan_findings
from missions.terrain.files import DRIVERS, BoundingBox, Elevation, inspect
from missions.terrain.follow import follow_ground
from missions.terrain.ground import Ground, line_positions
from missions.terrain.profile import mission_profile, plan_profile
from missions.values import Altitude, HomePosition, RallyPoint
from tests.support.elevation_files import (
    LAT_DEG,
    LON_DEG,
    flat_elevation,
    hill_elevation,
    write_elevation_file,
)

HOME = HomePosition(lat_deg=LAT_DEG - 0.01, lon_deg=LON_DEG, alt_amsl_m=500.0)


def above_terrain(value_m: float) -> Altitude:
    return Altitude(value_m=value_m, reference="terrain")


def waypoint_at(north_deg: float, altitude: Altitude, east_deg: float = 0.0) -> Waypoint:
    return Waypoint(lat_deg=LAT_DEG + north_deg, lon_deg=LON_DEG + east_deg, altitude=altitude)


def ground_of(*files: Path, margin_m: float = 3000.0) -> Ground:
    area = BoundingBox.around_positions([(LAT_DEG, LON_DEG)], margin_m)
    assert area is not None
    elevation = Elevation.from_files(files)
    assert elevation.problems == ()
    ground = elevation.ground(area)
    assert ground is not None
    return ground


@pytest.fixture(scope="module")
def hill_ground(tmp_path_factory: pytest.TempPathFactory) -> Ground:
    return ground_of(
        write_elevation_file(tmp_path_factory.mktemp("elevation") / "hill.tif", hill_elevation(500.0, 80.0))
    )


def test_a_slope_is_interpolated_between_cells(tmp_path: Path) -> None:
    def slope(lat: np.ndarray, lon: np.ndarray) -> np.ndarray:
        return 500.0 + 2000.0 * (lat - LAT_DEG) + 1000.0 * (lon - LON_DEG)

    ground = ground_of(write_elevation_file(tmp_path / "slope.tif", slope))
    rng = np.random.default_rng(1)
    lat, lon = LAT_DEG + rng.uniform(-0.02, 0.02, 200), LON_DEG + rng.uniform(-0.02, 0.02, 200)
    # GDAL rounds positions to an eighth of a cell, which is 0.075 m of altitude on this slope.
    np.testing.assert_allclose(ground.altitudes_amsl_m(lat, lon), slope(lat, lon), atol=0.1)


def test_a_file_in_utm_coordinates_has_the_correct_position(tmp_path: Path) -> None:
    # UTM zone 32: 47.4 N 8.5 E lies at 462 260 E, 5 249 780 N (within 100 m).
    path = write_elevation_file(
        tmp_path / "utm.tif",
        flat_elevation(432.0),
        west_deg=462_260.0 - 2000.0,
        north_deg=5_249_780.0 + 2000.0,
        step_deg=20.0,
        crs="EPSG:32632",
    )
    box = inspect(path)
    assert box.south_deg < LAT_DEG < box.north_deg
    assert box.west_deg < LON_DEG < box.east_deg
    assert ground_of(path, margin_m=500.0).altitude_amsl_m(LAT_DEG, LON_DEG) == pytest.approx(432.0)


def test_the_position_of_an_hgt_file_comes_from_its_name(tmp_path: Path) -> None:
    heights = np.full((1201, 1201), 321, dtype=">i2")
    heights[:600] = 654
    (tmp_path / "N47E008.hgt").write_bytes(heights.tobytes())
    ground = ground_of(tmp_path / "N47E008.hgt")
    assert ground.altitude_amsl_m(LAT_DEG, LON_DEG) == pytest.approx(321.0)
    assert 85.0 < ground.spacing_m < 100.0


def test_the_finest_file_is_used_and_a_coarser_file_fills_its_gaps(tmp_path: Path) -> None:
    def altitude_with_hole(lat: np.ndarray, lon: np.ndarray) -> np.ndarray:
        return np.where(lon > LON_DEG, -9999.0, 100.0)

    fine = write_elevation_file(tmp_path / "fine.tif", altitude_with_hole)
    coarse = write_elevation_file(tmp_path / "coarse.tif", flat_elevation(200.0), step_deg=0.001)
    for files in ((fine, coarse), (coarse, fine)):
        ground = ground_of(*files, margin_m=1000.0)
        assert ground.altitude_amsl_m(LAT_DEG, LON_DEG - 0.005) == pytest.approx(100.0)
        assert ground.altitude_amsl_m(LAT_DEG, LON_DEG + 0.005) == pytest.approx(200.0)


def test_outside_all_files_the_ground_is_unknown(hill_ground: Ground) -> None:
    assert hill_ground.altitude_amsl_m(LAT_DEG + 1.0, LON_DEG) is None
    assert hill_ground.altitude_amsl_m(LAT_DEG, LON_DEG - 1.0) is None
    assert hill_ground.altitude_amsl_m(-LAT_DEG, LON_DEG) is None


def test_a_file_at_the_date_line_is_used_from_both_sides(tmp_path: Path) -> None:
    write_elevation_file(tmp_path / "east.tif", flat_elevation(12.0), west_deg=180.0 - 0.05, north_deg=0.03)
    for lon_deg in (179.99, -180.01):
        area = BoundingBox.around_positions([(0.0, lon_deg)], 200.0)
        assert area is not None
        ground = Elevation.from_files([tmp_path / "east.tif"]).ground(area)
        assert ground is not None
        assert ground.altitude_amsl_m(0.0, 179.99) == pytest.approx(12.0)


def test_a_large_area_is_read_with_a_wider_grid(tmp_path: Path) -> None:
    path = write_elevation_file(tmp_path / "country.tif", flat_elevation(300.0), cells=100, step_deg=0.0001)
    area = BoundingBox(LON_DEG - 2.0, LAT_DEG - 2.0, LON_DEG + 2.0, LAT_DEG + 2.0)
    ground = Elevation.from_files([path]).ground(area)
    assert ground is not None
    assert ground.amsl_m.size < 4_100_000


@pytest.mark.parametrize("name", ["text.tif", "empty.hgt", "N99E999.hgt"])
def test_files_that_are_not_elevation_files_are_reported_by_name_and_ignored(
    tmp_path: Path, name: str
) -> None:
    (tmp_path / name).write_bytes(b"no picture at all")
    (tmp_path / "notes.txt").write_text("not an elevation file")
    valid = write_elevation_file(tmp_path / "valid.tif", flat_elevation(10.0))
    listed_files = [Path(each) for each in elevation_files(tmp_path)]
    assert {each.name for each in listed_files} == {name, "valid.tif"}
    assert tuple(DRIVERS) == ELEVATION_SUFFIXES
    elevation = Elevation.from_files(listed_files)
    assert [path for path, _ in elevation.files] == [valid]
    (problem,) = elevation.problems
    assert name in problem
    assert "Use a GeoTIFF or HGT file" in problem


def test_files_with_two_bands_or_without_a_coordinate_system_are_refused(tmp_path: Path) -> None:
    for options, reason in (({"crs": None}, "no coordinate system"), ({"count": 2}, "2 bands")):
        path = write_elevation_file(tmp_path / "refused.tif", flat_elevation(1.0), **options)
        with pytest.raises(PlanError, match=reason):
            inspect(path)


def test_altitudes_above_terrain_are_resolved(hill_ground: Ground) -> None:
    plan = Plan(
        planned_home=HOME,
        items=(
            waypoint_at(0.0, above_terrain(30.0)),
            waypoint_at(0.0, Altitude(value_m=50.0, reference="home")),
        ),
        rally_points=(RallyPoint(lat_deg=LAT_DEG, lon_deg=LON_DEG, altitude=above_terrain(20.0)),),
    )
    result = follow_ground(plan, hill_ground)
    assert (result.resolved, result.unknown, result.added) == (2, 0, 0)
    first, second = result.plan.items
    assert isinstance(first, Waypoint)
    assert first.altitude.resolved_amsl_m == pytest.approx(610.0, abs=1.0)
    assert second == plan.items[1]
    assert result.plan.rally_points[0].altitude.resolved_amsl_m == pytest.approx(600.0, abs=1.0)
    assert len(mission_items(result.plan)) == 2


def test_altitudes_without_ground_data_stay_unresolved(hill_ground: Ground) -> None:
    plan = Plan(
        items=(
            waypoint_at(0.0, above_terrain(30.0).model_copy(update={"resolved_amsl_m": 1.0})),
            waypoint_at(1.0, above_terrain(30.0)),
        )
    )
    for ground, unknown in ((hill_ground, 1), (None, 2)):
        result = follow_ground(plan, ground)
        assert result.unknown == unknown
        last_item = result.plan.items[-1]
        assert isinstance(last_item, Waypoint)
        assert last_item.altitude.resolved_amsl_m is None


@given(st.floats(1.0, 30.0), st.floats(5.0, 100.0), st.floats(-0.004, 0.004))
def test_a_line_that_follows_the_ground_keeps_its_height_within_the_tolerance(
    hill_ground: Ground, tolerance_m: float, height_m: float, east_deg: float
) -> None:
    plan = Plan(
        planned_home=HOME,
        items=(
            waypoint_at(-0.009, above_terrain(height_m)),
            waypoint_at(0.009, above_terrain(height_m), east_deg),
        ),
    )
    result = follow_ground(plan, hill_ground, tolerance_m)
    items = [each for each in result.plan.items if isinstance(each, Waypoint)]
    assert len(items) == 2 + result.added
    for start, end in itertools.pairwise(items):
        line = line_positions(
            (start.lat_deg, start.lon_deg), (end.lat_deg, end.lon_deg), hill_ground.spacing_m
        )
        start_amsl_m, end_amsl_m = start.altitude.resolved_amsl_m, end.altitude.resolved_amsl_m
        assert start_amsl_m is not None
        assert end_amsl_m is not None
        height_above_ground_m = (
            start_amsl_m
            + (end_amsl_m - start_amsl_m) * line[:, 2]
            - hill_ground.altitudes_amsl_m(line[:, 0], line[:, 1])
        )
        # `follow_ground` checks other points; between them the ground differs by 1 or 2 m.
        assert np.abs(height_above_ground_m - height_m).max() < tolerance_m + 2.0
    assert not list(plan_findings(result.plan, hill_ground, 30.0)) or height_m < 10.0 + tolerance_m + 2.0


def test_added_waypoints_keep_the_target_of_a_jump(hill_ground: Ground) -> None:
    plan = Plan(
        items=(
            waypoint_at(-0.009, above_terrain(30.0)),
            waypoint_at(0.009, above_terrain(30.0)),
            Jump(target_index=1, repeat=1),
        )
    )
    result = follow_ground(plan, hill_ground, 5.0)
    assert result.added > 0
    jump = result.plan.items[-1]
    assert isinstance(jump, Jump)
    assert result.plan.items[jump.target_index] == follow_ground(plan, hill_ground).plan.items[1]


def test_too_many_added_waypoints_are_refused(hill_ground: Ground) -> None:
    items = tuple(waypoint_at(0.009 * (-1) ** i, above_terrain(30.0)) for i in range(400))
    with pytest.raises(PlanError, match="Increase the tolerance"):
        follow_ground(Plan(items=items), hill_ground, 0.01)


def finding_codes(plan: Plan, ground: Ground, return_alt_m: float = 30.0) -> list[tuple[str, int | None]]:
    return [(each.code, each.row) for each in plan_findings(plan, ground, return_alt_m)]


def test_a_line_causes_a_finding_only_if_it_passes_through_or_near_the_hill(
    hill_ground: Ground,
) -> None:
    for height_m, expected in ((40.0, [("terrain_hit", 1)]), (86.0, [("terrain_near", 1)]), (120.0, [])):
        altitude = Altitude(value_m=height_m, reference="home")
        plan = Plan(planned_home=HOME, items=(waypoint_at(-0.01, altitude), waypoint_at(0.01, altitude)))
        assert finding_codes(plan, hill_ground) == expected


def test_the_return_path_is_checked_at_the_return_altitude(hill_ground: Ground) -> None:
    beside_hill = [
        waypoint_at(-0.01, Altitude(value_m=20.0, reference="home"), 0.01),
        waypoint_at(0.01, Altitude(value_m=20.0, reference="home"), 0.01),
    ]
    plan = Plan(
        planned_home=HOME,
        items=(*beside_hill, waypoint_at(0.01, Altitude(value_m=20.0, reference="home")), ReturnHome()),
    )
    assert finding_codes(plan, hill_ground, return_alt_m=30.0) == [("terrain_hit", 3)]
    assert finding_codes(plan, hill_ground, return_alt_m=100.0) == []


def test_take_off_and_landing_may_be_near_the_ground(hill_ground: Ground) -> None:
    altitude = Altitude(value_m=20.0, reference="home")
    takeoff = Takeoff(lat_deg=HOME.lat_deg, lon_deg=HOME.lon_deg, altitude=altitude)
    land = Land(
        lat_deg=HOME.lat_deg, lon_deg=HOME.lon_deg + 0.001, altitude=Altitude(value_m=0.0, reference="home")
    )
    assert finding_codes(Plan(planned_home=HOME, items=(takeoff, land)), hill_ground) == []


def test_a_moved_item_and_a_wrong_home_cause_findings(hill_ground: Ground) -> None:
    resolved_plan = follow_ground(
        Plan(planned_home=HOME, items=(waypoint_at(0.0, above_terrain(30.0)),)), hill_ground
    ).plan
    item = resolved_plan.items[0]
    assert isinstance(item, Waypoint)
    moved_item = item.model_copy(update={"lat_deg": LAT_DEG + 0.005})
    moved = resolved_plan.model_copy(update={"items": (moved_item,)})
    assert ("terrain_outdated", 0) in finding_codes(moved, hill_ground)
    high_home = HOME.model_copy(update={"alt_amsl_m": 540.0})
    plan_with_high_home = resolved_plan.model_copy(update={"planned_home": high_home})
    assert finding_codes(plan_with_high_home, hill_ground) == [("home_off_ground", None)]


def leg(place: str, *points: tuple[float, float, float]) -> Leg:
    rows = tuple((float(i), *point) for i, point in enumerate(points))
    return Leg(place, "fly", 0.0, float(len(points)), main=True, points=rows)


def test_a_finding_about_a_mission_into_the_hill_names_the_step(hill_ground: Ground) -> None:
    origin = LocalOrigin(HOME.lat_deg, HOME.lon_deg, HOME.alt_amsl_m)
    north_m = distance_m(HOME.lat_deg, HOME.lon_deg, LAT_DEG, LON_DEG)
    climb = leg("step 1", (0.0, 0.0, 0.0), (0.0, 0.0, -30.0))
    outward = leg("step 2", (0.0, 0.0, -30.0), (north_m / 2, 0.0, -30.0))
    into_hill = leg("step 3", (north_m / 2, 0.0, -30.0), (north_m, 0.0, -30.0))
    findings = list(mission_findings([climb, outward, into_hill], origin, hill_ground))
    assert [(each.code, each.step) for each in findings] == [("terrain_hit", "step 3")]
    profile = mission_profile([climb, outward, into_hill], origin, 0.0, hill_ground)
    assert profile[0][1] == pytest.approx(0.0, abs=1.0)
    assert profile[-1] == (pytest.approx(north_m, abs=1.0), pytest.approx(80.0, abs=2.0))


def test_the_profile_of_a_plan_has_its_length_and_the_hill(hill_ground: Ground) -> None:
    plan = Plan(
        planned_home=HOME,
        items=tuple(waypoint_at(north, above_terrain(30.0)) for north in (-0.009, 0.009, -0.009)),
    )
    profile = plan_profile(plan, hill_ground)
    assert len(profile) <= 600
    assert profile[-1][0] == pytest.approx(math.radians(0.001 + 2 * 0.018) * 6_371_000.0, rel=0.01)
    assert max(height or 0.0 for _, height in profile) == pytest.approx(80.0, abs=2.0)
    assert json.dumps(profile)
    assert plan_profile(plan.model_copy(update={"planned_home": None}), hill_ground) == ()
