"""Obstacles of plans and missions: their distance from paths, their findings, and how files store them."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from missions import plan as plan_document
from missions.checks import check
from missions.errors import PlanError
from missions.formats import qgc_plan
from missions.geodesy import LocalOrigin
from missions.items import Land, ReturnHome, Takeoff, Waypoint
from missions.obstacles import ObstacleShapes
from missions.offboard.compiler import compile_mission
from missions.offboard.from_plan import from_plan
from missions.offboard.reader import read
from missions.offboard.timeline import Timeline
from missions.offboard.writer import write_yaml
from missions.plan import Plan
from missions.values import Altitude, HomePosition, Obstacle, Point
from tests.support.obstacles import box_obstacle
from tests.support.offboard_missions import finding_codes, flight_steps, mission

HOME = HomePosition(lat_deg=47.0, lon_deg=8.0, alt_amsl_m=480.0)
ORIGIN = LocalOrigin(HOME.lat_deg, HOME.lon_deg, HOME.alt_amsl_m)
BARN = box_obstacle(ORIGIN, (20.0, 30.0), (-5.0, 5.0), 8.0, name="Barn")


def shapes(*obstacles: Obstacle) -> ObstacleShapes:
    return ObstacleShapes(obstacles, ORIGIN, HOME.alt_amsl_m)


@pytest.mark.parametrize(
    ("path", "distance_m"),
    [
        ([(0, 0, -5), (40, 0, -5)], 0.0),
        ([(0, 0, -9.5), (40, 0, -9.5)], 1.5),
        ([(0, 0, -10.1), (40, 0, -10.1)], None),
        ([(0, 6, -5), (2000, 6, -5)], 1.0),
        ([(0, 7.1, -5), (40, 7.1, -5)], None),
        ([(25, 0, -20), (25, 0, -9)], 1.0),
        ([(25, 0, 0), (25, 0, -3)], 0.0),
        ([(19, 0, -9)], math.sqrt(2)),
    ],
)
def test_the_distance_of_a_path_is_measured_to_the_nearest_side_or_the_top(path, distance_m) -> None:
    clearances = list(shapes(BARN).clearances(np.array(path, dtype=float)))
    assert [each.name for each in clearances] == ([] if distance_m is None else ["Barn"])
    if distance_m is not None:
        assert clearances[0].distance_m == pytest.approx(distance_m, abs=0.06)
        assert clearances[0].passes_through == (distance_m == 0.0)


@given(
    start=st.tuples(st.floats(0, 60), st.floats(-40, 40), st.floats(-20, -1)),
    end=st.tuples(st.floats(0, 60), st.floats(-40, 40), st.floats(-20, -1)),
)
def test_the_distance_of_a_path_equals_the_minimum_over_many_of_its_positions(start, end) -> None:
    line = np.linspace(start, end, 4001)
    horizontal_m = np.hypot(
        np.maximum(np.abs(line[:, 0] - 25.0) - 5.0, 0.0), np.maximum(np.abs(line[:, 1]) - 5.0, 0.0)
    )
    least_m = float(np.hypot(horizontal_m, np.maximum(-line[:, 2] - 8.0, 0.0)).min())
    clearances = list(shapes(BARN).clearances(np.array([start, end])))
    assert bool(clearances) == (least_m < 2.0) or least_m == pytest.approx(2.0, abs=0.1)
    for each in clearances:
        assert each.distance_m == pytest.approx(least_m, abs=0.1)


@pytest.mark.parametrize("length_m", [1e4, 4e6, 2e7])
def test_the_number_of_compared_positions_is_limited_for_legs_and_obstacles_of_any_size(length_m) -> None:
    """Distances are as exact as the limited number of positions allows: a 2000th of the leg, in 20 steps."""
    long_path = np.array([(-length_m, 6.0, -5.0), (length_m, 6.0, -5.0)])
    (beside_barn,) = shapes(BARN).clearances(long_path)
    assert beside_barn.distance_m == pytest.approx(1.0, abs=0.06)
    half_deg = min(40.0, length_m / 111e3)
    corners = [(-half_deg, -half_deg), (-half_deg, half_deg), (half_deg, half_deg), (half_deg, -half_deg)]
    points = tuple(Point(lat_deg=HOME.lat_deg + n, lon_deg=HOME.lon_deg + e) for n, e in corners)
    continent = Obstacle(polygon=points, top=BARN.top)
    (in_continent,) = shapes(continent).clearances(long_path)
    assert in_continent.passes_through


def test_a_top_above_sea_level_is_converted_with_the_altitude_of_home() -> None:
    amsl_obstacle = box_obstacle(ORIGIN, (20.0, 30.0), (-5.0, 5.0), 488.0, reference="amsl")
    path = np.array([(0.0, 0.0, -9.0), (40.0, 0.0, -9.0)])
    (home_clearance,), (amsl_clearance,) = (
        list(shapes(each).clearances(path)) for each in (BARN, amsl_obstacle)
    )
    assert home_clearance.distance_m == pytest.approx(amsl_clearance.distance_m, abs=1e-6)
    assert amsl_clearance.name == "obstacle 1"  # an obstacle without a name gets its number


# --- waypoint plans -----------------------------------------------------------------------------------


def item_at(item_class, north_m: float, alt_home_m: float):
    lat_deg, lon_deg, _ = ORIGIN.to_geodetic((north_m, 0.0, 0.0))
    return item_class(
        lat_deg=lat_deg, lon_deg=lon_deg, altitude=Altitude(value_m=alt_home_m, reference="home")
    )


def findings_of(*items, obstacle: Obstacle = BARN) -> list[tuple[str, int | None]]:
    plan = Plan(planned_home=HOME, items=items, obstacles=(obstacle,))
    return [(each.code, each.row) for each in check(plan) if each.obstacle == 0]


@pytest.mark.parametrize(
    ("items", "findings"),
    [
        ((item_at(Takeoff, 0, 5), item_at(Waypoint, 50, 5)), [("obstacle_hit", 1)]),
        ((item_at(Takeoff, 0, 9.5), item_at(Waypoint, 50, 9.5)), [("obstacle_near", 1)]),
        ((item_at(Takeoff, 0, 20), item_at(Waypoint, 50, 20)), []),
        ((item_at(Takeoff, 0, 20), item_at(Waypoint, 50, 20), item_at(Land, 25, 0)), [("obstacle_hit", 2)]),
        ((item_at(Takeoff, 25, 20), item_at(Waypoint, 50, 20)), []),
        ((item_at(Takeoff, 0, 20), item_at(Waypoint, 50, 20), ReturnHome()), []),
    ],
)
def test_the_paths_of_a_plan_are_checked_including_climb_and_landing(items, findings) -> None:
    assert findings_of(*items) == findings


def test_a_return_and_the_take_off_at_home_are_checked() -> None:
    tower = box_obstacle(ORIGIN, (20.0, 30.0), (-5.0, 5.0), 60.0)
    outward_items = (item_at(Takeoff, 0, 70), item_at(Waypoint, 50, 70), item_at(Waypoint, 60, 10))
    assert findings_of(*outward_items, ReturnHome(), obstacle=tower) == [("obstacle_hit", 3)]
    roof = box_obstacle(ORIGIN, (1.0, 5.0), (-5.0, 5.0), 10.0)
    assert findings_of(item_at(Takeoff, 0, 30), obstacle=roof) == [("obstacle_near", 0)]


# --- offboard missions --------------------------------------------------------------------------------

FLY_NORTH = "step: fly, points: [{offset_ned_m: [50, 0, %s]}]"


def compile_step(step: str, **rest) -> Timeline:
    return compile_mission(mission(flight_steps(step), **{"home": HOME, "obstacles": (BARN,), **rest}))


def test_the_compiled_path_of_a_mission_is_checked_with_step_and_position() -> None:
    (finding,) = compile_step(FLY_NORTH % -5).findings
    assert (finding.code, finding.severity, finding.step, finding.obstacle) == (
        "obstacle_hit", "error", "step 2", 0,
    )  # fmt: skip
    assert "passes through Barn near north 2" in finding.message
    assert finding_codes(compile_step(FLY_NORTH % -9.5)) == {"obstacle_near"}
    assert finding_codes(compile_step(FLY_NORTH % -10.5)) == set()


def test_a_step_with_avoidance_that_passes_through_an_obstacle_is_a_warning() -> None:
    (finding,) = compile_step(FLY_NORTH % -5 + ", avoidance: over").findings
    assert (finding.code, finding.severity) == ("obstacle_avoided", "warning")
    assert "only the obstacle sensor" in finding.message


def test_avoidance_does_not_apply_to_landings_and_velocities() -> None:
    step_over_barn = "step: fly, points: [{offset_ned_m: [25, 0, -12]}]"
    assert finding_codes(compile_step(step_over_barn, avoidance="over")) == {"obstacle_hit"}
    velocity_step = "step: velocity, velocity_ned_m_s: [3, 0, 0], duration_s: 15"
    low_mission = mission(
        "- {step: take_off, height_m: 5}\n- {" + velocity_step + "}\n- {step: land}\n",
        home=HOME, obstacles=(BARN,), avoidance="over",
    )  # fmt: skip
    assert "obstacle_hit" in finding_codes(compile_mission(low_mission))


def test_obstacles_without_a_global_position_are_an_error() -> None:
    assert finding_codes(compile_step(FLY_NORTH % -5, home=None)) == {"obstacles_unknown"}


def test_an_obstacle_whose_sides_cross_is_an_error_in_plans_and_missions() -> None:
    a, b, c, d = BARN.polygon
    crossed_barn = BARN.model_copy(update={"polygon": (a, c, b, d)})
    assert "obstacle_invalid" in finding_codes(compile_step(FLY_NORTH % -30, obstacles=(crossed_barn,)))
    assert ("obstacle_invalid", None) in findings_of(item_at(Takeoff, 0, 30), obstacle=crossed_barn)


# --- files --------------------------------------------------------------------------------------------

PLAN = Plan(planned_home=HOME, items=(item_at(Takeoff, 0, 30),), obstacles=(BARN,))


def test_obstacles_are_unchanged_after_writing_reading_and_conversion() -> None:
    assert plan_document.read(plan_document.write(PLAN)) == PLAN
    with_waypoint = PLAN.model_copy(update={"items": (*PLAN.items, item_at(Waypoint, 9, 30))})
    converted = from_plan(with_waypoint, "North").mission
    assert converted.obstacles == (BARN,)
    assert read(write_yaml(converted)) == converted


def test_a_qgroundcontrol_file_contains_the_obstacles_under_an_additional_key() -> None:
    written = qgc_plan.write(PLAN).data
    assert qgc_plan.read(written).plan.obstacles == (BARN,)
    assert qgc_plan.write(qgc_plan.read(written).plan).data == written
    without_obstacles = qgc_plan.read(written).plan.model_copy(update={"obstacles": ()})
    assert qgc_plan.read(qgc_plan.write(without_obstacles).data).plan.obstacles == ()
    document = json.loads(written)
    document["offboardGcsObstacles"][0]["top"]["value_m"] = "high"
    with pytest.raises(PlanError, match=r"obstacle 1, field top\.value_m"):
        qgc_plan.read(json.dumps(document))


def test_a_top_with_a_height_above_the_ground_is_refused() -> None:
    document = json.loads(plan_document.write(PLAN))
    document["obstacles"][0]["top"]["reference"] = "terrain"
    with pytest.raises(PlanError, match=r"obstacle 1, field top: .*above home or AMSL"):
        plan_document.read(json.dumps(document))
