"""Flights over and around boxes, and a stop if there is no free path."""

import math

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from missions.avoidance.avoider import MAX_CLIMB_M
from missions.avoidance.values import AvoidanceWay, DetourLimits, WantedMotion
from missions.fence import Circle, Region
from missions.frames import Vector3
from tests.unit.missions.avoidance.obstacle_course import STEP_S, BoxObstacle, ObstacleFlight

BOX = BoxObstacle((4.25, 5.75), (-2.0, 2.0), 4.0)
GOAL = (10.0, 0.0, -1.0)
START = (0.0, 0.0, -1.0)


@pytest.mark.parametrize("all_directions", [True, False])
def test_the_vehicle_climbs_over_the_box_and_descends_behind_it(all_directions: bool):
    flight = ObstacleFlight([BOX], start=START, all_directions=all_directions)
    flight.fly(GOAL)
    assert flight.states == ["over", "back", "clear"]
    assert flight.reached(GOAL)
    assert flight.nearest_m > 0.5
    assert 4.5 < flight.highest_m < 6.0, "the vehicle did not fly closely above the box"


@pytest.mark.parametrize("drift_m_s", [-0.4, 0.4])
def test_the_vehicle_stays_on_its_track_while_its_velocity_estimate_is_wrong(drift_m_s: float):
    flight = ObstacleFlight([BOX], start=START, drift_ned_m_s=(0.0, drift_m_s, 0.0))
    farthest_m = 0.0
    for _ in range(int(60 / STEP_S)):
        flight.step(WantedMotion(GOAL, yaw_ned_rad=0.0))
        farthest_m = max(farthest_m, abs(float(flight.position_ned_m[1])))
    assert flight.states == ["over", "back", "clear"]
    assert farthest_m < 0.7


def test_the_vehicle_keeps_its_distance_from_an_obstacle_beside_its_track():
    box_beside_track = BoxObstacle((3.0, 9.0), (2.2, 4.0), 12.0)
    flight = ObstacleFlight([BOX, box_beside_track], start=START, drift_ned_m_s=(0.0, 0.3, 0.0))
    flight.fly(GOAL)
    assert flight.nearest_m > 0.5


def test_the_vehicle_descends_behind_the_box_and_not_only_at_the_goal():
    flight = ObstacleFlight([BOX], start=START)
    goal = (40.0, 0.0, -1.0)
    while flight.adjusted.state != "back" or flight.position_ned_m[2] < -1.5:
        flight.step(WantedMotion(goal, yaw_ned_rad=0.0))
    assert 5.75 < flight.position_ned_m[0] < 9.0


@pytest.mark.parametrize("gap_m", [3.0, 4.0, 6.0])
@pytest.mark.parametrize("height_m", [2.0, 8.0])
def test_a_second_box_is_seen_before_the_vehicle_flies_on_to_it(height_m: float, gap_m: float):
    """Above the first box a level sensor measures nothing of the second one, which is equally high."""
    start, goal = (0.0, 0.0, -2.0), (28.0, 0.0, -2.0)
    boxes = [
        BoxObstacle((4.0, 8.0), (-3.0, 3.0), height_m),
        BoxObstacle((8.0 + gap_m, 12.0 + gap_m), (-3.0, 3.0), height_m),
    ]
    flight = ObstacleFlight(boxes, start=start)
    flight.fly(goal)
    assert flight.reached(goal)
    assert flight.nearest_m > 0.5


def test_a_vehicle_that_drifts_back_to_the_box_leaves_it_once():
    boxes = [BoxObstacle((6.0, 8.0), (-3.0, 3.0), 2.0), BoxObstacle((15.0, 17.0), (-3.0, 3.0), 9.0)]
    goal = (30.0, 0.0, -2.0)
    flight = ObstacleFlight(boxes, start=(0.0, 0.0, -2.0), drift_ned_m_s=(-0.2, 0.0, 0.0))
    flight.fly(goal)
    assert flight.reached(goal)
    assert flight.nearest_m > 0.5
    assert flight.states == ["over", "back", "clear"]


def test_avoidance_around_the_box_keeps_the_altitude():
    flight = ObstacleFlight([BOX], start=START, way="around")
    flight.fly(GOAL)
    assert flight.reached(GOAL)
    assert flight.nearest_m > 0.5
    assert flight.highest_m < 1.3
    assert flight.states == ["around", "back", "clear"]


def test_an_obstacle_too_high_to_climb_over_is_flown_around():
    flight = ObstacleFlight([BoxObstacle((8.0, 9.0), (-6.0, 4.0), 60.0)], start=(0.0, 0.0, -2.0))
    flight.fly((20.0, 0.0, -2.0), seconds=90.0)
    assert flight.states[:2] == ["over", "around"]
    assert flight.reached((20.0, 0.0, -2.0))
    assert flight.highest_m < 2.0 + MAX_CLIMB_M + 1.0
    assert flight.nearest_m > 0.5


def test_below_an_altitude_limit_the_vehicle_flies_around_the_box():
    flight = ObstacleFlight([BOX], start=START, limits=DetourLimits(region=Region(down_min_m=-4.0)))
    flight.fly(GOAL)
    assert flight.reached(GOAL)
    assert flight.highest_m < 4.0


def test_if_every_path_is_blocked_the_vehicle_stops_and_reports_the_reason():
    small_fence = Region(down_min_m=-4.0, circles=(Circle((0.0, 0.0), 6.0, "the fence"),))
    wall = BoxObstacle((3.0, 4.0), (-20.0, 20.0), 30.0)
    flight = ObstacleFlight([wall], start=START, limits=DetourLimits(region=small_fence))
    flight.fly(GOAL, seconds=60.0)
    assert flight.adjusted.state == "stopped"
    assert "no clear way around" in flight.adjusted.text
    assert flight.nearest_m > 0.5
    assert small_fence.breach((flight.position_ned_m[0], flight.position_ned_m[1])) is None
    assert math.hypot(*flight.velocity) < 0.1


def test_with_a_single_ray_ahead_the_vehicle_does_not_fly_around_an_obstacle():
    wall = BoxObstacle((8.0, 9.0), (-6.0, 4.0), 60.0)
    flight = ObstacleFlight([wall], start=START, all_directions=False)
    flight.fly((20.0, 0.0, -1.0), seconds=40.0)
    assert flight.adjusted.state == "stopped"
    assert "too high to climb over" in flight.adjusted.text


def test_without_a_downward_sensor_the_vehicle_stays_above_the_path():
    flight = ObstacleFlight([BOX], start=START, down=False)
    flight.fly(GOAL, seconds=30.0)
    assert flight.adjusted.state == "back"
    assert "No sensor measures below" in flight.adjusted.text
    assert -flight.position_ned_m[2] > 4.0
    assert flight.position_ned_m[0] == pytest.approx(10.0, abs=0.5)


def test_the_vehicle_yaws_into_the_direction_of_travel_if_the_sensor_measures_only_ahead():
    # The box is behind the vehicle.
    flight = ObstacleFlight([BOX], start=(12.0, 0.0, -1.0), all_directions=False)
    flight.step(WantedMotion(START, yaw_ned_rad=0.0))
    assert flight.adjusted.state == "turning"
    flight.fly(START)
    assert flight.reached(START)
    assert abs(abs(flight.yaw) - math.pi) < 0.3
    assert flight.nearest_m > 0.5


def test_while_the_sensors_send_nothing_the_vehicle_is_stopped_and_then_it_flies_on():
    flight = ObstacleFlight([BOX], start=START)
    for _ in range(round(3.0 / STEP_S)):
        flight.step(WantedMotion(GOAL, yaw_ned_rad=0.0))
    flight.sensors_are_off = True
    for _ in range(round(6.0 / STEP_S)):
        flight.step(WantedMotion(GOAL, yaw_ned_rad=0.0))
    assert flight.adjusted.state == "stopped"
    assert "No obstacle measurement" in flight.adjusted.text
    assert math.hypot(*flight.velocity) < 0.1
    flight.sensors_are_off = False
    flight.fly(GOAL)
    assert flight.reached(GOAL)
    assert flight.nearest_m > 0.5


def test_without_any_measurement_the_vehicle_does_not_start():
    flight = ObstacleFlight([], start=START)
    flight.sensors_are_off = True
    flight.fly(GOAL, seconds=3.0)
    assert flight.adjusted.state == "stopped"
    assert math.dist(flight.position_ned_m, START) < 0.01


def test_to_reach_a_lower_goal_the_vehicle_descends_before_it_flies_towards_the_goal():
    """On a direct sloping path no sensor would measure in the direction of travel."""
    hidden_box = BoxObstacle((6.0, 8.0), (-2.0, 2.0), 4.0)
    flight = ObstacleFlight([hidden_box], start=(0.0, 0.0, -6.0))
    flight.fly(GOAL)
    assert flight.reached(GOAL)
    assert flight.nearest_m > 0.5


def test_the_vehicle_does_not_descend_into_an_obstacle_under_the_goal():
    flight = ObstacleFlight([BOX], start=START)
    flight.fly((5.0, 0.0, -1.0), seconds=30.0)  # inside the box
    assert flight.nearest_m > 0.5


@pytest.mark.parametrize("vertical_noise_m_s", [0.0, 0.5])
def test_a_moving_path_is_rejoined_behind_the_obstacle(vertical_noise_m_s: float):
    flight = ObstacleFlight([BOX], start=START, vertical_noise_m_s=vertical_noise_m_s)
    speed, begin_s = 1.5, flight.now_s

    def path_at(time_s: float) -> Vector3:
        return (min(speed * (time_s - begin_s), 40.0), 0.0, -1.0)

    for _ in range(round(40.0 / STEP_S)):
        target = path_at(flight.now_s)
        feed_forward = (speed, 0.0, 0.0) if target[0] < 40.0 else (0.0, 0.0, 0.0)
        next_positions = tuple(path_at(flight.now_s + dt) for dt in (0.5, 1.0, 2.0, 3.0))
        flight.step(WantedMotion(target, feed_forward, 0.0, next_positions))
    assert flight.states == ["over", "back", "clear"]
    assert flight.reached((40.0, 0.0, -1.0))
    assert flight.nearest_m > 0.5


def test_a_descending_path_is_rejoined_behind_the_obstacle():
    flight = ObstacleFlight([BoxObstacle((4.25, 5.75), (-2.0, 2.0), 9.0)], start=(0.0, 0.0, -6.0))
    begin_s, duration_s = flight.now_s, 50.0

    def path_at(time_s: float) -> Vector3:
        flown_s = min(time_s - begin_s, duration_s)
        return (0.5 * flown_s, 0.0, -6.0 + 0.1 * flown_s)

    while flight.adjusted.state != "clear" or flight.now_s < begin_s + 10.0:
        next_positions = tuple(path_at(flight.now_s + dt) for dt in (0.5, 1.0, 2.0, 3.0))
        flight.step(WantedMotion(path_at(flight.now_s), (0.5, 0.0, 0.1), 0.0, next_positions))
        assert flight.now_s < begin_s + duration_s, "the path has ended and the vehicle has not rejoined it"
    assert flight.states == ["clear", "over", "back", "clear"]
    assert math.dist(flight.position_ned_m, path_at(flight.now_s)) < 1.1
    assert flight.nearest_m > 0.5


def test_a_flight_past_a_wall_is_not_changed():
    flight = ObstacleFlight([BoxObstacle((0.0, 30.0), (2.0, 3.0), 6.0)], start=START)
    flight.fly((25.0, 0.0, -1.0))
    assert flight.states == ["clear"]


@st.composite
def box_obstacles(draw: st.DrawFn) -> BoxObstacle:
    north_m = draw(st.floats(5.0, 35.0))
    center_m = draw(st.floats(-8.0, 8.0))
    length_m, west_m, east_m = draw(st.floats(1.0, 5.0)), draw(st.floats(1.0, 4.0)), draw(st.floats(1.0, 4.0))
    # A level sensor does not see tops below the path, which is at 2 m.
    height_m = draw(st.sampled_from((2.2, 4.0, 8.0, 30.0)))
    return BoxObstacle((north_m, north_m + length_m), (center_m - west_m, center_m + east_m), height_m)


@settings(
    max_examples=5, deadline=None, phases=[Phase.generate], suppress_health_check=[HealthCheck.too_slow]
)
@given(st.lists(box_obstacles(), min_size=1, max_size=5), st.sampled_from(("over", "around")))
def test_among_any_boxes_the_vehicle_keeps_its_distance_and_returns_to_the_path(
    boxes: list[BoxObstacle], way: AvoidanceWay
):
    goal = (45.0, 0.0, -2.0)
    flight = ObstacleFlight(boxes, start=(0.0, 0.0, -2.0), way=way)
    flight.fly(goal, seconds=150.0)
    assert flight.nearest_m > 0.4
    if flight.adjusted.state != "stopped":
        assert flight.reached(goal)
    assert len(flight.states) <= 30, "the vehicle turned back and forth"
