"""Trajectories pass their points, take the shortest time on straight legs, and refuse invalid points."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest

from missions.errors import PlanError
from missions.trajectory.headings import AlongPath, LookAt
from missions.trajectory.limits import MotionLimits
from missions.trajectory.points import PassPoint
from missions.trajectory.shapes import arc, figure_eight
from missions.trajectory.solve import curve_along_path, curve_through_points

LIMITS = MotionLimits()
EAST = math.pi / 2


def points(*positions: tuple[float, float, float], **fields: object) -> list[PassPoint]:
    return [PassPoint(position, **fields) for position in positions]  # type: ignore[arg-type]


def shortest_s(length_m: float, speed: float, acceleration: float, jerk: float) -> float:
    """Shortest time from rest to rest on a straight line: maximum jerk in either direction until acceleration
    or speed reaches its limit."""
    jerk_s = (length_m / (2.0 * jerk)) ** (1.0 / 3.0)
    if jerk * jerk_s <= acceleration and jerk * jerk_s**2 <= speed:
        return 4.0 * jerk_s
    if speed * jerk >= acceleration**2:
        ramp_s = acceleration / jerk
        full_acceleration_s = (-3.0 * ramp_s + math.sqrt(ramp_s**2 + 4.0 * length_m / acceleration)) / 2.0
        if acceleration * (ramp_s + full_acceleration_s) <= speed:
            return 4.0 * ramp_s + 2.0 * full_acceleration_s
        return length_m / speed + speed / acceleration + ramp_s
    return length_m / speed + 2.0 * math.sqrt(speed / jerk)


@pytest.mark.parametrize("seed", range(60))
def test_a_straight_leg_takes_the_shortest_possible_time(seed: int) -> None:
    rng = np.random.default_rng(seed)
    direction = rng.normal(0.0, 1.0, 3) * rng.choice([0.0, 1.0], 3, p=[0.2, 0.8])
    direction = direction / (np.linalg.norm(direction) or 1.0) if direction.any() else np.array([0, 0, -1.0])
    horizontal, down = float(np.hypot(direction[0], direction[1])), float(direction[2])
    length_m = 10.0 ** rng.uniform(-1.5, 4.0)
    vertical_m_s = LIMITS.descent_m_s if down > 0.0 else LIMITS.climb_m_s
    with np.errstate(divide="ignore"):
        speed = min(np.divide(LIMITS.speed_m_s, horizontal), np.divide(vertical_m_s, abs(down)))
        acceleration = min(
            np.divide(LIMITS.acceleration_m_s2, horizontal),
            np.divide(min(LIMITS.acceleration_up_m_s2, LIMITS.acceleration_down_m_s2), abs(down)),
        )
    n, e, d = (float(axis) for axis in direction * length_m)
    found_s = curve_through_points(points((0, 0, 0), (n, e, d))).duration_s
    bound_s = shortest_s(length_m, float(speed), float(acceleration), LIMITS.jerk_m_s3)
    assert bound_s * (1.0 - 1e-6) <= found_s <= bound_s * (1.0 + 1e-6)


def test_the_times_of_legs_between_stops_add_up() -> None:
    one_leg_s = curve_through_points(points((0, 0, 0), (30, 0, 0))).duration_s
    two_legs = curve_through_points(points((0, 0, 0), (30, 0, 0), (0, 0, 0), stop=True))
    assert two_legs.duration_s == pytest.approx(2.0 * one_leg_s)
    assert two_legs.point_times_s == pytest.approx((0.0, one_leg_s, 2.0 * one_leg_s))


def test_curves_pass_within_the_corner_distance_and_are_faster_than_stops() -> None:
    square = ((0, 0, -5), (40, 0, -5), (40, 40, -5), (0, 40, -5))
    times = []
    for corner_m in (0.0, 0.2, 2.0, 3.0):
        curve = curve_through_points(points(*square, corner_m=corner_m))
        times.append(curve.duration_s)
        path = curve.sample(np.linspace(0.0, curve.duration_s, 20_000)).position_ned_m
        for corner in square[1:3]:
            nearest_m = np.sqrt(((path - np.array(corner)) ** 2).sum(axis=1)).min()
            assert nearest_m <= corner_m + 1e-3
            if corner_m >= 2.0:
                assert nearest_m == pytest.approx(corner_m, abs=0.01)
    assert times == sorted(times, reverse=True)


def test_an_exact_curve_passes_each_point_at_its_point_time() -> None:
    rng = np.random.default_rng(7)
    positions = np.cumsum(rng.normal(0.0, 20.0, (30, 3)), axis=0)
    curve = curve_through_points([PassPoint(tuple(position)) for position in positions.tolist()], exact=True)
    passed_positions = [curve.at(t).position_ned_m for t in curve.point_times_s]
    assert np.array(passed_positions) == pytest.approx(positions, abs=1e-6)
    assert curve.point_times_s == tuple(sorted(curve.point_times_s))


def test_a_trajectory_stops_only_at_requested_stops() -> None:
    route = points((0, 0, 0), (20, 0, 0), (20, 20, 0), (40, 20, 0))
    route[2] = PassPoint((20, 20, 0), stop=True)
    curve = curve_through_points(route)
    speeds = [math.hypot(*curve.at(t).velocity_ned_m_s) for t in curve.point_times_s]  # type: ignore[arg-type]
    assert speeds[1] > 1.0
    assert speeds[2] == pytest.approx(0.0, abs=1e-4)
    assert curve.at(curve.point_times_s[2]).position_ned_m == pytest.approx((20, 20, 0), abs=1e-6)


def test_a_straight_path_with_many_points_is_as_fast_as_with_two() -> None:
    few_points_s, many_points_s = (
        curve_through_points(
            points(*[(x, 0.0, -5.0) for x in np.linspace(0.0, 200.0, count).tolist()])
        ).duration_s
        for count in (2, 201)
    )
    assert many_points_s == pytest.approx(few_points_s, rel=1e-6)


def test_yaws_are_reached_at_their_points_by_the_shorter_rotation() -> None:
    route = [PassPoint((0, 0, 0), 3.0), PassPoint((30, 0, 0)), PassPoint((60, 0, 0), -3.0)]
    curve = curve_through_points(route)
    yaws = [curve.at(t).yaw_ned_rad for t in curve.point_times_s]
    assert yaws[0] == pytest.approx(3.0)
    assert abs(yaws[1]) == pytest.approx(math.pi)  # type: ignore[arg-type]
    assert yaws[2] == pytest.approx(-3.0)
    assert curve.at(curve.duration_s).yaw_rate_ned_rad_s == 0.0


def test_a_trajectory_may_turn_without_moving() -> None:
    curve = curve_through_points([PassPoint((1, 2, -3), 0.0), PassPoint((1, 2, -3), EAST)])
    assert curve.duration_s > EAST / LIMITS.yaw_rate_rad_s
    assert curve.at(curve.duration_s / 2).position_ned_m == pytest.approx((1, 2, -3))
    assert curve.at(curve.duration_s / 2).yaw_ned_rad == pytest.approx(EAST / 2)


def test_the_heading_follows_the_path_and_turns_at_stops() -> None:
    curve = curve_through_points(points((0, 0, 0), (30, 0, 0), (30, 30, 0), stop=True), heading=AlongPath())
    assert curve.at(1.0).yaw_ned_rad == pytest.approx(0.0)
    assert curve.at(curve.duration_s - 1.0).yaw_ned_rad == pytest.approx(EAST)
    curve = curve_along_path(figure_eight((0, 0, -9), 60.0, 30.0, 1.0), LIMITS, AlongPath())
    for t in np.linspace(0.5, curve.duration_s - 0.5, 200).tolist():
        sample = curve.at(t)
        north, east, _ = sample.velocity_ned_m_s
        error_rad = math.remainder(
            math.atan2(east or 0.0, north or 0.0) - (sample.yaw_ned_rad or 0.0), math.tau
        )
        assert abs(error_rad) < math.radians(0.5)


def test_a_look_at_heading_turns_by_180_deg_above_its_point() -> None:
    curve = curve_through_points(points((-200, 0, -5), (200, 0, -5)), heading=LookAt((0.0, 0.0, 0.0)))
    samples = curve.sample(np.linspace(0.0, curve.duration_s, 20_000))
    turning = np.abs(samples.yaw_rate_ned_rad_s) > 1e-3
    assert np.abs(samples.position_ned_m[turning, 0]).max() < 2.0
    assert np.abs(np.diff(samples.yaw_ned_rad)).max() < 0.01
    assert abs(math.remainder(samples.yaw_ned_rad[0] - samples.yaw_ned_rad[-1], math.tau)) == pytest.approx(
        math.pi
    )


def test_an_orbit_keeps_its_radius_and_points_at_its_centre() -> None:
    curve = curve_along_path(arc((10, 20, -30), 15.0, 2.0), LIMITS, LookAt((10.0, 20.0, 0.0)))
    assert curve.length_m == pytest.approx(math.tau * 15.0 * 2.0, rel=1e-6)
    for t in np.linspace(0.0, curve.duration_s, 300).tolist():
        sample = curve.at(t)
        north, east = (sample.position_ned_m[0] or 0.0) - 10.0, (sample.position_ned_m[1] or 0.0) - 20.0
        assert math.hypot(north, east) == pytest.approx(15.0, abs=1e-3)
        error_rad = math.remainder(math.atan2(-east, -north) - (sample.yaw_ned_rad or 0.0), math.tau)
        assert abs(error_rad) < 1e-3


def test_a_spiral_climbs_and_widens_to_its_end_radius() -> None:
    curve = curve_along_path(
        arc((0, 0, -10), 10.0, 2.0, climb_m=20.0, end_radius_m=30.0, clockwise=False), LIMITS
    )
    start, end = curve.at(0.0).position_ned_m, curve.at(curve.duration_s).position_ned_m
    assert start == pytest.approx((10.0, 0.0, -10.0))
    assert end == pytest.approx((30.0, 0.0, -30.0))
    assert (curve.at(2.0).velocity_ned_m_s[1] or 0.0) < 0.0


def test_a_figure_eight_crosses_its_centre_and_reaches_its_ends() -> None:
    curve = curve_along_path(figure_eight((5, 5, -9), 40.0, 12.0, 1.0, heading_ned_rad=EAST), LIMITS)
    path = curve.sample(np.linspace(0.0, curve.duration_s, 20_000)).position_ned_m
    assert path[:, 1].max() == pytest.approx(25.0, abs=1e-3)
    assert path[:, 0].max() == pytest.approx(11.0, abs=1e-3)
    assert path[-1] == pytest.approx(path[0], abs=1e-9)


def test_single_and_multiple_samples_agree_also_after_pickling() -> None:
    curve = curve_through_points(points((0, 0, 0), (9, 3, -4), (20, -5, -6)), heading=AlongPath(), exact=True)
    copy = pickle.loads(pickle.dumps(curve))
    times = np.linspace(-1.0, curve.duration_s + 1.0, 97)
    samples = copy.sample(times)
    for index, t in enumerate(times.tolist()):
        sample = curve.at(t)
        assert sample.position_ned_m == pytest.approx(tuple(samples.position_ned_m[index]))
        assert sample.velocity_ned_m_s == pytest.approx(tuple(samples.velocity_ned_m_s[index]))
        assert sample.acceleration_ned_m_s2 == pytest.approx(tuple(samples.acceleration_ned_m_s2[index]))
        assert sample.yaw_rate_ned_rad_s == pytest.approx(samples.yaw_rate_ned_rad_s[index])
    assert curve.at(-5.0).velocity_ned_m_s == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("exact", [False, True])
def test_unusual_valid_input_gives_a_trajectory(exact: bool) -> None:
    single = curve_through_points(points((1, 2, -3)), exact=exact)
    assert (single.duration_s, single.at(5.0).position_ned_m) == (0.0, (1.0, 2.0, -3.0))
    assert single.sample(np.array([0.0, 1.0])).position_ned_m.tolist() == [[1, 2, -3], [1, 2, -3]]
    repeated = curve_through_points(points((1, 2, -3), (1, 2, -3), (1, 2, -3)), exact=exact)
    assert (repeated.duration_s, repeated.point_times_s) == (0.0, (0.0, 0.0, 0.0))
    reversing = curve_through_points(points((0, 0, 0), (50, 0, 0), (0, 0, 0), (50, 0, 0)), exact=exact)
    assert reversing.at(reversing.duration_s).position_ned_m == pytest.approx((50, 0, 0))
    tiny = curve_through_points(points((0, 0, 0), (0.002, 0, 0), (0.002, 0.002, 0)), exact=exact)
    assert 0.0 < tiny.duration_s < 2.0
    huge = curve_through_points(points((0, 0, 0), (9e5, 0, 0), (9e5, 9e5, 0)), exact=exact)
    assert math.isfinite(huge.duration_s)
    assert huge.duration_s > 1.5e5
    long = curve_through_points(points(*[(10.0 * k, 3.0 * (k % 7), -5.0) for k in range(2000)]), exact=exact)
    assert len(long.point_times_s) == 2000
    assert math.isfinite(long.duration_s)


@pytest.mark.parametrize(
    ("route", "place", "fix"),
    [
        ([], "the trajectory", "Add at least one point"),
        (points((0, 0, 0), (math.nan, 0, 0)), "point 2", "metres from the local origin"),
        (points((0, 0, 0), (0, 0, math.inf)), "point 2", "metres from the local origin"),
        (points((0, 0, 2e6)), "point 1", "metres from the local origin"),
        ([PassPoint((0, 0, 0), math.nan)], "point 1", "radians"),
        (points((0, 0, 0), (1, 0, 0), corner_m=-1.0), "point 1", "0 or more"),
        ([PassPoint((0, 0, 0))] * 10_001, "the trajectory", "Split the trajectory"),
    ],
)
def test_invalid_points_are_refused_with_the_field_and_a_fix(
    route: list[PassPoint], place: str, fix: str
) -> None:
    with pytest.raises(PlanError) as caught:
        curve_through_points(route)
    assert caught.value.place == place
    assert fix in caught.value.fix


def test_a_yaw_and_a_heading_together_are_refused() -> None:
    with pytest.raises(PlanError, match="point 2"):
        curve_through_points([PassPoint((0, 0, 0)), PassPoint((9, 0, 0), 1.0)], heading=AlongPath())


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: arc((0, 0, 0), 0.0, 1.0), "radius_m"),
        (lambda: arc((0, 0, 0), 5.0, math.nan), "turns"),
        (lambda: arc((0, math.nan, 0), 5.0, 1.0), "center_ned_m"),
        (lambda: figure_eight((0, 0, 0), 5.0, -1.0, 1.0), "width_m"),
        (lambda: figure_eight((0, 0, 0), 5.0, 1.0, 1e9), "rounds"),
        (lambda: MotionLimits(jerk_m_s3=0.0), "jerk_m_s3"),
        (lambda: MotionLimits(tilt_rad=1.57), "tilt_rad"),
    ],
)
def test_errors_for_invalid_shapes_and_limits_name_the_field(make: object, field: str) -> None:
    with pytest.raises(PlanError, match=field):
        make()  # type: ignore[operator]
