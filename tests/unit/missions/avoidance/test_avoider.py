"""Flights over and around boxes, and a stop if there is no free path."""

import math

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from missions.avoidance.avoider import MAX_CLIMB_M
from missions.avoidance.values import AvoidanceWay, DetourLimits, WantedMotion
from missions.fence import Circle, Region
from missions.frames import Vector3
from tests.unit.missions.avoidance.obstacle_course import STEP_S, BoxObstacle, Course

BOX = BoxObstacle((4.25, 5.75), (-2.0, 2.0), 4.0)
GOAL = (10.0, 0.0, -1.0)
START = (0.0, 0.0, -1.0)


@pytest.mark.parametrize("all_directions", [True, False])
def test_the_vehicle_climbs_over_the_box_and_descends_behind(all_directions: bool):
    course = Course([BOX], start=START, all_directions=all_directions)
    course.fly(GOAL)
    assert course.states == ["over", "back", "clear"]
    assert course.reached(GOAL)
    assert course.nearest_m > 0.5
    assert 4.5 < course.highest_m < 6.0, "the vehicle did not fly closely above the box"


@pytest.mark.parametrize("drift_m_s", [-0.4, 0.4])
def test_the_vehicle_stays_on_its_track_while_its_velocity_estimate_is_wrong(drift_m_s: float):
    course = Course([BOX], start=START, drift_ned_m_s=(0.0, drift_m_s, 0.0))
    farthest_m = 0.0
    for _ in range(int(60 / STEP_S)):
        course.step(WantedMotion(GOAL, yaw_ned_rad=0.0))
        farthest_m = max(farthest_m, abs(float(course.position_ned_m[1])))
    assert course.states == ["over", "back", "clear"]
    assert farthest_m < 0.7


def test_the_vehicle_keeps_its_distance_from_an_obstacle_beside_its_track():
    beside = BoxObstacle((3.0, 9.0), (2.2, 4.0), 12.0)
    course = Course([BOX, beside], start=START, drift_ned_m_s=(0.0, 0.3, 0.0))
    course.fly(GOAL)
    assert course.nearest_m > 0.5


def test_the_vehicle_descends_behind_the_box_and_not_only_at_the_goal():
    course = Course([BOX], start=START)
    goal = (40.0, 0.0, -1.0)
    while course.adjusted.state != "back" or course.position_ned_m[2] < -1.5:
        course.step(WantedMotion(goal, yaw_ned_rad=0.0))
    assert 5.75 < course.position_ned_m[0] < 9.0


def test_avoidance_around_the_box_keeps_the_altitude():
    course = Course([BOX], start=START, way="around")
    course.fly(GOAL)
    assert course.reached(GOAL)
    assert course.nearest_m > 0.5
    assert course.highest_m < 1.3
    assert course.states == ["around", "back", "clear"]


def test_an_obstacle_too_high_to_climb_over_is_flown_around():
    course = Course([BoxObstacle((8.0, 9.0), (-6.0, 4.0), 60.0)], start=(0.0, 0.0, -2.0))
    course.fly((20.0, 0.0, -2.0), seconds=90.0)
    assert course.states[:2] == ["over", "around"]
    assert course.reached((20.0, 0.0, -2.0))
    assert course.highest_m < 2.0 + MAX_CLIMB_M + 1.0
    assert course.nearest_m > 0.5


def test_below_an_altitude_limit_the_vehicle_flies_around_the_box():
    course = Course([BOX], start=START, limits=DetourLimits(region=Region(down_min_m=-4.0)))
    course.fly(GOAL)
    assert course.reached(GOAL)
    assert course.highest_m < 4.0


def test_if_every_path_is_blocked_the_vehicle_stops_and_reports_the_reason():
    small_fence = Region(down_min_m=-4.0, circles=(Circle((0.0, 0.0), 6.0, "the fence"),))
    wall = BoxObstacle((3.0, 4.0), (-20.0, 20.0), 30.0)
    course = Course([wall], start=START, limits=DetourLimits(region=small_fence))
    course.fly(GOAL, seconds=60.0)
    assert course.adjusted.state == "stopped"
    assert "no clear way around" in course.adjusted.text
    assert course.nearest_m > 0.5
    assert small_fence.breach((course.position_ned_m[0], course.position_ned_m[1])) is None
    assert math.hypot(*course.velocity) < 0.1


def test_with_a_single_ray_ahead_the_vehicle_does_not_fly_around_an_obstacle():
    wall = BoxObstacle((8.0, 9.0), (-6.0, 4.0), 60.0)
    course = Course([wall], start=START, all_directions=False)
    course.fly((20.0, 0.0, -1.0), seconds=40.0)
    assert course.adjusted.state == "stopped"
    assert "too high to climb over" in course.adjusted.text


def test_without_a_downward_sensor_the_vehicle_stays_above_the_path():
    course = Course([BOX], start=START, down=False)
    course.fly(GOAL, seconds=30.0)
    assert course.adjusted.state == "back"
    assert "No sensor measures below" in course.adjusted.text
    assert -course.position_ned_m[2] > 4.0
    assert course.position_ned_m[0] == pytest.approx(10.0, abs=0.5)


def test_the_vehicle_yaws_into_the_direction_of_travel_if_the_sensor_measures_only_ahead():
    course = Course([BOX], start=(12.0, 0.0, -1.0), all_directions=False)  # the box is behind the vehicle
    course.step(WantedMotion(START, yaw_ned_rad=0.0))
    assert course.adjusted.state == "turning"
    course.fly(START)
    assert course.reached(START)
    assert abs(abs(course.yaw) - math.pi) < 0.3
    assert course.nearest_m > 0.5


def test_sensors_that_stop_sending_stop_the_vehicle_until_they_return():
    course = Course([BOX], start=START)
    for _ in range(round(3.0 / STEP_S)):
        course.step(WantedMotion(GOAL, yaw_ned_rad=0.0))
    course.blind = True
    for _ in range(round(6.0 / STEP_S)):
        course.step(WantedMotion(GOAL, yaw_ned_rad=0.0))
    assert course.adjusted.state == "stopped"
    assert "No obstacle measurement" in course.adjusted.text
    assert math.hypot(*course.velocity) < 0.1
    course.blind = False
    course.fly(GOAL)
    assert course.reached(GOAL)
    assert course.nearest_m > 0.5


def test_without_any_measurement_the_vehicle_does_not_start():
    course = Course([], start=START)
    course.blind = True
    course.fly(GOAL, seconds=3.0)
    assert course.adjusted.state == "stopped"
    assert math.dist(course.position_ned_m, START) < 0.01


def test_a_lower_goal_is_reached_by_descending_first():
    """On a direct sloping path no sensor would measure in the direction of travel."""
    hidden = BoxObstacle((6.0, 8.0), (-2.0, 2.0), 4.0)
    course = Course([hidden], start=(0.0, 0.0, -6.0))
    course.fly(GOAL)
    assert course.reached(GOAL)
    assert course.nearest_m > 0.5


def test_the_vehicle_does_not_descend_into_an_obstacle_under_the_goal():
    course = Course([BOX], start=START)
    course.fly((5.0, 0.0, -1.0), seconds=30.0)  # inside the box
    assert course.nearest_m > 0.5


def test_a_moving_path_is_rejoined_behind_the_obstacle():
    course = Course([BOX], start=START)
    speed, begin_s = 1.5, course.now_s

    def path_at(time_s: float) -> Vector3:
        return (min(speed * (time_s - begin_s), 40.0), 0.0, -1.0)

    for _ in range(round(40.0 / STEP_S)):
        target = path_at(course.now_s)
        feed_forward = (speed, 0.0, 0.0) if target[0] < 40.0 else (0.0, 0.0, 0.0)
        ahead = tuple(path_at(course.now_s + dt) for dt in (0.5, 1.0, 2.0, 3.0))
        course.step(WantedMotion(target, feed_forward, 0.0, ahead))
    assert course.states == ["over", "back", "clear"]
    assert course.reached((40.0, 0.0, -1.0))
    assert course.nearest_m > 0.5


def test_a_flight_past_a_wall_is_not_changed():
    course = Course([BoxObstacle((0.0, 30.0), (2.0, 3.0), 6.0)], start=START)
    course.fly((25.0, 0.0, -1.0))
    assert course.states == ["clear"]


@st.composite
def blocks(draw: st.DrawFn) -> BoxObstacle:
    north = draw(st.floats(5.0, 35.0))
    east = draw(st.floats(-8.0, 8.0))
    deep, left, right = draw(st.floats(1.0, 5.0)), draw(st.floats(1.0, 4.0)), draw(st.floats(1.0, 4.0))
    height = draw(st.sampled_from((2.0, 4.0, 8.0, 30.0)))
    return BoxObstacle((north, north + deep), (east - left, east + right), height)


@settings(
    max_examples=5, deadline=None, phases=[Phase.generate], suppress_health_check=[HealthCheck.too_slow]
)
@given(st.lists(blocks(), min_size=1, max_size=5), st.sampled_from(("over", "around")))
def test_among_any_boxes_the_vehicle_keeps_its_distance_and_returns_to_the_path(
    boxes: list[BoxObstacle], way: AvoidanceWay
):
    goal = (45.0, 0.0, -2.0)
    course = Course(boxes, start=(0.0, 0.0, -2.0), way=way)
    course.fly(goal, seconds=150.0)
    assert course.nearest_m > 0.4
    if course.adjusted.state != "stopped":
        assert course.reached(goal)
    assert len(course.states) <= 30, "the vehicle turned back and forth"
