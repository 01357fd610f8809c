"""Obstacle brake: setpoints are limited so that the vehicle stops before a measured obstacle."""

import math
from random import Random

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from gcs_server.streamer.limits.brake import SCAN_VALID_S, BrakeMemory
from gcs_server.streamer.limits.limiter import apply_limits
from gcs_server.streamer.limits.region import MARGIN_M, VehicleMotion
from gcs_server.streamer.values.limit_values import Bounds
from missions.avoidance.scans import Scan
from missions.geodesy import LocalOrigin
from missions.setpoints import (
    Acceleration,
    Attitude,
    Position,
    PositionGlobal,
    Rates,
    Trajectory,
    Velocity,
    VelocityBody,
)

NOW_S = 50.0
STILL = (0.0, 0.0, 0.0)
STEP_S = 0.05
"""Time step of the simulated flights; a scan every four steps."""
POSITION_GAIN = 0.95
"""Default of PX4's MPC_XY_P [1/s]."""
HOVERING = VehicleMotion((0.0, 0.0, -5.0), STILL, 0.0)


def obstacle_at(distance_m, direction=(1.0, 0.0, 0.0), *, range_m=20.0, velocity=STILL, age_s=0.0):
    scan = Scan(NOW_S - age_s, (direction,), (distance_m,), range_m)
    return BrakeMemory().update(NOW_S, (scan,), HOVERING.position_ned_m, velocity)


UNLIMITED = Bounds()


def stopping_distance_m(speed_m_s):
    """Distance with a delay of 0.8 s and a deceleration of 1.2 m/s²."""
    return 0.8 * speed_m_s + speed_m_s**2 / 2.4


def brake(requested, surroundings, motion=HOVERING, bounds=UNLIMITED):
    return apply_limits(requested, bounds, motion, surroundings=surroundings)


def test_a_velocity_towards_an_obstacle_is_limited_to_the_braking_speed():
    result = brake(Velocity((8.0, 0.0, 0.0)), obstacle_at(6.0))
    speed = result.setpoint.velocity_ned_m_s[0]
    assert stopping_distance_m(speed) == pytest.approx(6.0 - MARGIN_M)
    assert result.notes == ("speed reduced to stop before an obstacle",)
    setpoint_at_the_margin = brake(Velocity((8.0, 0.0, 0.0)), obstacle_at(1.0)).setpoint
    assert setpoint_at_the_margin.velocity_ned_m_s == pytest.approx((0.0, 0.0, 0.0))


def test_body_velocities_are_limited_and_slow_velocities_or_other_directions_are_not():
    body_velocity = brake(VelocityBody((8.0, 0.0, 0.0)), obstacle_at(6.0)).setpoint.velocity_frd_m_s
    assert body_velocity[0] == pytest.approx(
        brake(Velocity((8.0, 0.0, 0.0)), obstacle_at(6.0)).setpoint.velocity_ned_m_s[0]
    )
    for allowed in (Velocity((1.0, 0.0, 0.0)), Velocity((-5.0, 0.0, 0.0)), Velocity((0.0, 5.0, 0.0))):
        result = brake(allowed, obstacle_at(6.0))
        assert (result.setpoint, result.notes) == (allowed, ())


def test_a_position_setpoint_behind_an_obstacle_is_moved_in_front_of_it():
    result = brake(Position((30.0, 0.0, -5.0)), obstacle_at(4.0))
    north, east, down = result.setpoint.position_ned_m
    assert 0.0 < north <= 4.0 - MARGIN_M
    assert (east, down) == (0.0, -5.0)
    assert POSITION_GAIN * north <= 2.0
    assert result.notes == ("position limited to stop before an obstacle",)


def test_within_the_margin_the_vehicle_is_moved_back_unless_an_obstacle_is_behind_it():
    assert brake(Position((30.0, 0.0, -5.0)), obstacle_at(0.8)).setpoint.position_ned_m == pytest.approx(
        (-0.4 / POSITION_GAIN, 0.0, -5.0)
    )
    assert brake(Velocity((8.0, 0.0, 1.0)), obstacle_at(0.8)).setpoint.velocity_ned_m_s == pytest.approx(
        (-0.4, 0.0, 1.0)
    )
    front_and_back_scan = Scan(NOW_S, ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)), (0.8, 0.9), 20.0)
    surroundings = BrakeMemory().update(NOW_S, (front_and_back_scan,), HOVERING.position_ned_m, STILL)
    assert brake(Velocity((8.0, 0.0, 0.0)), surroundings).setpoint.velocity_ned_m_s == (0.0, 0.0, 0.0)
    assert brake(Position((30.0, 0.0, -5.0)), surroundings).setpoint.position_ned_m == (0.0, 0.0, -5.0)


def test_a_limited_global_position_becomes_a_local_position():
    origin = LocalOrigin(47.4, 8.5, 480.0)
    result = brake(
        PositionGlobal(47.4 + 30.0 / 111_195.0, 8.5, 485.0), obstacle_at(4.0), bounds=Bounds(origin=origin)
    )
    assert isinstance(result.setpoint, Position)
    assert result.setpoint.position_ned_m[0] < 3.0


def test_a_trajectory_is_slowed_with_its_feed_forward():
    result = brake(Trajectory((2.0, 0.0, -5.0), (5.0, 0.0, 0.0)), obstacle_at(5.0))
    north, speed = result.setpoint.position_ned_m[0], result.setpoint.velocity_ned_m_s[0]
    assert POSITION_GAIN * north + speed <= 2.5
    assert north > 0.0
    assert speed > 0.0


def test_the_sensor_range_counts_as_an_obstacle():
    result = brake(Velocity((12.0, 0.0, 0.0)), obstacle_at(None, range_m=10.0))
    speed = result.setpoint.velocity_ned_m_s[0]
    assert stopping_distance_m(speed) == pytest.approx(10.0 - MARGIN_M)
    assert result.notes == ("speed reduced to the range of the obstacle sensor",)
    sideways = Velocity((0.0, 12.0, 0.0))
    assert brake(sideways, obstacle_at(None, range_m=10.0)).setpoint == sideways, (
        "limited in a direction without sensor"
    )


def test_measured_ground_stops_neither_landing_nor_take_off():
    ground_below = obstacle_at(0.3, (0.0, 0.0, 1.0))
    for requested in (
        Velocity((0.0, 0.0, 1.0)),
        Velocity((0.0, 0.0, -2.0)),
        Velocity((3.0, 0.0, 0.5)),
        Position((0.0, 0.0, 0.0)),
        Position((0.0, 0.0, -20.0)),
    ):
        result = brake(requested, ground_below)
        assert (result.setpoint, result.notes) == (requested, ())


def test_a_wall_is_detected_while_the_vehicle_pitches_forward():
    tilt = math.radians(15.0)
    foot_of_wall = obstacle_at(6.0 / math.cos(tilt), (math.cos(tilt), 0.0, math.sin(tilt)))
    level_speed = brake(Velocity((8.0, 0.0, 0.0)), obstacle_at(6.0)).setpoint.velocity_ned_m_s[0]
    assert brake(Velocity((8.0, 0.0, 0.0)), foot_of_wall).setpoint.velocity_ned_m_s[0] == pytest.approx(
        level_speed
    )
    ground = obstacle_at(1.0 / math.sin(tilt), (math.cos(tilt), 0.0, math.sin(tilt)))
    assert brake(Velocity((8.0, 0.0, 0.0)), ground).setpoint.velocity_ned_m_s[0] > 1.5, (
        "the ground was taken for a wall"
    )


def test_measurements_are_used_for_two_seconds_at_the_same_altitude():
    ahead, above = ((1.0, 0.0, 0.0),), ((math.cos(0.5), 0.0, -math.sin(0.5)),)
    for age_s, climbed_m, is_used in ((1.0, 0.0, True), (2.5, 0.0, False), (1.0, 1.5, False)):
        memory = BrakeMemory()
        memory.update(NOW_S, (Scan(NOW_S, ahead, (4.0,), 20.0),), HOVERING.position_ned_m, STILL)
        later_s, position = NOW_S + age_s, (0.5, 0.0, -5.0 - climbed_m)
        surroundings = memory.update(later_s, (Scan(later_s, above, (None,), 20.0),), position, STILL)
        assert surroundings.points_ne_m.tolist() == ([[3.5, 0.0]] if is_used else [])


def test_without_a_position_only_the_newest_measurements_are_used():
    scan = Scan(NOW_S - 0.5, ((1.0, 0.0, 0.0),), (4.0,), 20.0)
    surroundings = BrakeMemory().update(NOW_S, (scan,), None, (2.0, 0.0, 0.0))
    assert surroundings.points_ne_m.tolist() == [[3.0, 0.0]]


def test_a_climb_stops_below_an_obstacle_measured_above():
    obstacle_above = obstacle_at(3.0, (0.0, 0.0, -1.0))
    assert -1.8 < brake(Velocity((0.0, 0.0, -5.0)), obstacle_above).setpoint.velocity_ned_m_s[2] < -1.0
    assert brake(Position((0.0, 0.0, -20.0)), obstacle_above).setpoint.position_ned_m[2] == pytest.approx(
        -7.5
    )
    assert brake(Position((0.0, 0.0, -2.0)), obstacle_above).notes == ()


def test_an_old_measurement_is_moved_by_the_vehicles_motion_and_is_finally_discarded():
    velocity = (4.0, 0.0, 0.0)
    speed_with_new_scan = brake(
        Velocity(velocity), obstacle_at(8.0, velocity=velocity)
    ).setpoint.velocity_ned_m_s[0]
    speed_with_old_scan = brake(
        Velocity(velocity), obstacle_at(8.0, velocity=velocity, age_s=1.0)
    ).setpoint.velocity_ned_m_s[0]
    assert speed_with_old_scan == pytest.approx(
        brake(Velocity(velocity), obstacle_at(4.0)).setpoint.velocity_ned_m_s[0]
    )
    assert speed_with_old_scan < speed_with_new_scan
    assert brake(Velocity(velocity), obstacle_at(1.0, age_s=SCAN_VALID_S + 0.1)).notes == ()


@pytest.mark.parametrize(
    "requested", [Attitude((1.0, 0.0, 0.0, 0.0), 0.5), Rates(STILL, 0.5), Acceleration((0.0, 0.0, 0.0))]
)
def test_streams_without_position_control_are_stopped_before_an_obstacle(requested):
    motion = VehicleMotion((0.0, 0.0, -5.0), (4.0, 0.0, 0.0), 0.0)
    near_obstacle = obstacle_at(5.0, velocity=motion.velocity_ned_m_s)
    assert "hit an obstacle" in brake(requested, near_obstacle, motion).stop_reason
    assert brake(requested, obstacle_at(15.0, velocity=motion.velocity_ned_m_s), motion).stop_reason is None
    assert brake(requested, obstacle_at(0.5)).stop_reason is None, "the vehicle had already stopped"
    assert brake(requested, None, motion).stop_reason is None


def test_flight_along_a_near_wall_is_allowed():
    headings = [math.radians(5.0 * k) for k in range(72)]
    rays = tuple((math.cos(a), math.sin(a), 0.0) for a in headings)
    wall_distances_m = tuple(0.6 / ray[1] if ray[1] > 0.05 else None for ray in rays)  # 0.6 m to the east
    surroundings = BrakeMemory().update(
        NOW_S, (Scan(NOW_S, rays, wall_distances_m, 20.0),), HOVERING.position_ned_m, STILL
    )
    assert brake(Velocity((1.0, 0.0, 0.0)), surroundings).setpoint.velocity_ned_m_s[0] > 0.0
    assert brake(Velocity((0.0, 1.0, 0.0)), surroundings).setpoint.velocity_ned_m_s[1] < 0.0
    velocity_away = Velocity((0.0, -1.0, 0.0))
    assert brake(velocity_away, surroundings).setpoint == velocity_away


def nearest_to_the_wall_m(wall_m, speed, course=0.0, by_position=False, error_m_s=0.0):
    """Flies towards a wall; returns the smallest distance from it. The vehicle follows the setpoints with
    PX4's lag, and flies `error_m_s` faster than its velocity estimate; the sensor measures at 5 Hz."""
    rays = tuple((math.cos(a), math.sin(a), 0.0) for a in (math.radians(5.0 * k) for k in range(72)))
    n, e, vn, ve = 0.0, 0.0, 0.0, 0.0
    requested = Velocity((speed * math.cos(course), speed * math.sin(course), 0.0))
    if by_position:
        requested = Position((100.0 * math.cos(course), 100.0 * math.sin(course), -5.0))
    scan, memory, nearest_m = Scan(0.0, rays, (None,) * 72, 20.0), BrakeMemory(), wall_m
    for step in range(300):
        now_s = step * STEP_S
        if step % 4 == 0:
            distances_m = tuple(
                d if ray[0] > 0.05 and (d := (wall_m - n) / ray[0]) < 20.0 else None for ray in rays
            )
            scan = Scan(now_s, rays, distances_m, 20.0)
        motion = VehicleMotion((n, e, -5.0), (vn, ve, 0.0), 0.0)
        surroundings = memory.update(now_s, (scan,), motion.position_ned_m, motion.velocity_ned_m_s)
        sent_setpoint = apply_limits(requested, Bounds(), motion, surroundings=surroundings).setpoint
        if isinstance(sent_setpoint, Position):
            velocity_ne_m_s = (
                POSITION_GAIN * (sent_setpoint.position_ned_m[0] - n),
                POSITION_GAIN * (sent_setpoint.position_ned_m[1] - e),
            )
        else:
            velocity_ne_m_s = sent_setpoint.velocity_ned_m_s
        vn += max(-3.0, min(3.0, (velocity_ne_m_s[0] - vn) / 0.5)) * STEP_S
        ve += max(-3.0, min(3.0, (velocity_ne_m_s[1] - ve) / 0.5)) * STEP_S
        n, e = n + (vn + error_m_s) * STEP_S, e + ve * STEP_S
        nearest_m = min(nearest_m, wall_m - n)
    return nearest_m


@settings(max_examples=25, deadline=None, phases=[Phase.generate])
@given(st.floats(3.0, 18.0), st.floats(1.0, 12.0), st.floats(-0.6, 0.6), st.booleans())
def test_the_braked_vehicle_always_stops_before_a_wall(wall_m, speed, course, by_position):
    assert nearest_to_the_wall_m(wall_m, speed, course, by_position) > 0.5


@pytest.mark.parametrize("by_position", [True, False])
def test_the_brake_keeps_its_distance_if_the_velocity_estimate_is_wrong(by_position):
    assert nearest_to_the_wall_m(6.0, 2.0, by_position=by_position, error_m_s=0.35) > 0.65


BOX_NORTH_M, BOX_HALF_WIDTH_M = 6.0, 1.5
RAYS = tuple((math.cos(a), math.sin(a), 0.0) for a in (math.radians(5.0 * k) for k in range(72)))


def distance_to_the_box(ray, north_m, east_m):
    """Distance along a ray to the front of the box; None: the ray misses the box."""
    to_front_m = (BOX_NORTH_M - north_m) / ray[0] if ray[0] > 0.05 else math.inf
    return to_front_m if to_front_m < 20.0 and abs(east_m + to_front_m * ray[1]) < BOX_HALF_WIDTH_M else None


def fly_braked(requested, seed, wind_m_s, seconds=60.0):
    """Flies towards a box with side wind and a drifting position estimate; yields the true (north, east) [m].

    PX4's position controller is approximated: a velocity proportional to the distance, reached with a lag.
    The wind moves the vehicle, as it does until PX4's integrator compensates it.
    """
    random = Random(seed)
    n = e = vn = ve = drift_n = drift_e = 0.0
    scan, memory = Scan(0.0, RAYS, (None,) * 72, 20.0), BrakeMemory()
    for step in range(int(seconds / STEP_S)):
        now_s = step * STEP_S
        drift_n += STEP_S * (random.gauss(0.0, 0.4) - drift_n / 4.0)
        drift_e += STEP_S * (random.gauss(0.0, 0.4) - drift_e / 4.0)
        if step % 4 == 0:
            scan = Scan(now_s, RAYS, tuple(distance_to_the_box(ray, n, e) for ray in RAYS), 20.0)
        motion = VehicleMotion((n + drift_n, e + drift_e, -5.0), (vn, ve, 0.0), 0.0)
        surroundings = memory.update(now_s, (scan,), motion.position_ned_m, motion.velocity_ned_m_s)
        result = brake(requested, surroundings, motion)
        memory.track_point_ne_m = result.track_point_ne_m
        target_n, target_e = result.setpoint.position_ned_m[:2]
        feed_n, feed_e, _ = getattr(result.setpoint, "velocity_ned_m_s", STILL)
        setpoint_n, setpoint_e = (
            feed_n + POSITION_GAIN * (target_n - n - drift_n),
            feed_e + POSITION_GAIN * (target_e - e - drift_e),
        )
        vn += max(-3.0, min(3.0, (setpoint_n - vn) / 0.5)) * STEP_S
        ve += max(-3.0, min(3.0, (setpoint_e + wind_m_s - ve) / 0.5)) * STEP_S
        n, e = n + vn * STEP_S, e + ve * STEP_S
        yield n, e


@pytest.mark.parametrize(("seed", "wind_m_s"), [(1, 0.0), (2, 0.0), (3, 0.2), (4, -0.4)])
@pytest.mark.parametrize(
    "requested", [Position((9.0, 0.0, -5.0)), Trajectory((30.0, 0.0, -5.0), (1.0, 0.0, 0.0))]
)
def test_a_braked_vehicle_stays_in_front_of_the_obstacle_and_does_not_drift_around_it(
    requested, seed, wind_m_s
):
    track = list(fly_braked(requested, seed, wind_m_s))
    assert max(n for n, _ in track) < BOX_NORTH_M - 0.5
    assert max(abs(e) for _, e in track) < 1.0
    assert min(n for n, _ in track[len(track) // 2 :]) > BOX_NORTH_M - 2.5


def second_limited_position(first_target, second_target, moved_east_m, surroundings=None):
    """The limited position of the second setpoint; the vehicle was braked and then moved to the east."""
    memory, scan = BrakeMemory(), Scan(NOW_S, ((1.0, 0.0, 0.0),), (4.0,), 20.0)
    memory.track_point_ne_m = brake(
        Position(first_target), memory.update(NOW_S, (scan,), HOVERING.position_ned_m, STILL)
    ).track_point_ne_m
    moved_vehicle = VehicleMotion((0.0, moved_east_m, -5.0), STILL, 0.0)
    later_surroundings = memory.update(NOW_S, surroundings or (scan,), moved_vehicle.position_ned_m, STILL)
    return brake(Position(second_target), later_surroundings, moved_vehicle).setpoint.position_ned_m


def test_a_braked_vehicle_returns_to_its_track_without_going_nearer_to_an_obstacle_at_its_side():
    ahead = (30.0, 0.0, -5.0)
    north, east, _ = second_limited_position(ahead, ahead, 0.6)
    assert 0.0 < north < 3.0
    assert east == pytest.approx(0.0)
    scan_with_wall_in_the_west = Scan(NOW_S, ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0)), (4.0, 1.2), 20.0)
    _, east, _ = second_limited_position(ahead, ahead, 0.6, (scan_with_wall_in_the_west,))
    assert 0.4 - 1e-9 <= east < 0.6, "the vehicle was moved into the margin of the wall"


def test_the_track_follows_a_new_target_and_ends_when_the_brake_does_not_act():
    north, east, _ = second_limited_position((30.0, 0.0, -5.0), (30.0, 30.0, -5.0), 0.3)
    assert (north > 0.0, east > 0.3) == (True, True)
    free_target = (-10.0, 5.0, -5.0)
    assert second_limited_position((30.0, 0.0, -5.0), free_target, 0.3) == free_target
    assert brake(Position(free_target), obstacle_at(4.0)).track_point_ne_m is None


def test_a_vehicle_that_was_moved_far_away_is_kept_on_a_new_track():
    wall_scan = Scan(NOW_S, ((1.0, 0.0, 0.0),), (4.0,), 10.0)
    north, east, _ = second_limited_position((30.0, 0.0, -5.0), (30.0, 0.0, -5.0), 5.0, (wall_scan,))
    assert (5.0 - east) / north == pytest.approx(5.0 / 30.0), "not on the line from the new position"


def test_the_speed_limit_does_not_release_the_vehicle_from_its_track():
    slow_bounds = Bounds(approach_m_s=1.0)
    memory, scan = BrakeMemory(), Scan(NOW_S, ((1.0, 0.0, 0.0),), (1.6,), 20.0)
    for moved_east_m in (0.0, 0.5):
        motion = VehicleMotion((0.0, moved_east_m, -5.0), STILL, 0.0)
        surroundings = memory.update(NOW_S, (scan,), motion.position_ned_m, STILL)
        result = brake(Position((30.0, 0.0, -5.0)), surroundings, motion, slow_bounds)
        memory.track_point_ne_m = result.track_point_ne_m
    north, east, _ = result.setpoint.position_ned_m
    assert east == pytest.approx(0.0, abs=1e-6)
    assert slow_bounds.position_gain * math.hypot(north, east - 0.5) <= 1.0 + 1e-9
