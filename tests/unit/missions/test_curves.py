"""A path as a curve: it passes through its points, is at rest at both ends, and is continuous."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from missions.curves import PathCurve
from missions.setpoints import Path, PathPoint

metres = st.floats(-100, 100)
positions = st.tuples(metres, metres, metres)
steps = st.lists(st.tuples(st.floats(0.1, 20), positions), min_size=1, max_size=8)


def path_of(steps):
    t_s, points = 0.0, [PathPoint(0.0, (0.0, 0.0, -5.0))]
    for wait_s, position in steps:
        t_s += wait_s
        points.append(PathPoint(t_s, position))
    return Path(tuple(points))


@given(steps)
def test_the_curve_passes_through_its_points_at_their_times(steps):
    path = path_of(steps)
    curve = PathCurve.of(path, None)
    for point in path.points:
        assert curve.at(point.t_s).position_ned_m == pytest.approx(point.position_ned_m, abs=1e-6)
    assert curve.duration_s == path.duration_s


@given(steps)
def test_a_path_starts_and_ends_at_rest_and_keeps_the_last_point(steps):
    curve = PathCurve.of(path_of(steps), 0.5)
    for t_s in (-1.0, 0.0, curve.duration_s, curve.duration_s + 100.0):
        assert curve.at(t_s).velocity_ned_m_s == (0.0, 0.0, 0.0)
        assert curve.at(t_s).yaw_ned_rad == 0.5


@given(steps, st.floats(0.001, 0.999))
def test_velocity_and_acceleration_are_the_derivatives_of_position(steps, fraction):
    curve = PathCurve.of(path_of(steps), None)
    t_s, dt_s = fraction * curve.duration_s, 1e-4
    if min(abs(t_s - point_s) for point_s in curve.times_s) < 2 * dt_s:
        return  # the acceleration may change stepwise at a point
    before, sample, after = (curve.at(t_s + offset) for offset in (-dt_s, 0.0, dt_s))
    for field, derivative in (
        ("position_ned_m", sample.velocity_ned_m_s),
        ("velocity_ned_m_s", sample.acceleration_ned_m_s2),
    ):
        difference = np.array(getattr(after, field)) - np.array(getattr(before, field))
        assert difference / (2 * dt_s) == pytest.approx(np.array(derivative), rel=1e-3, abs=0.05)


@given(steps, st.lists(st.floats(0, 1), min_size=1, max_size=20))
def test_samples_of_a_list_of_times_equal_the_samples_of_each_time(steps, fractions):
    curve = PathCurve.of(path_of(steps), None)
    times = np.array([fraction * curve.duration_s for fraction in fractions])
    positions, velocities = curve.sample(times)
    for t_s, position, velocity in zip(times, positions, velocities, strict=True):
        sample = curve.at(float(t_s))
        assert position == pytest.approx(np.array(sample.position_ned_m), abs=1e-6)
        assert velocity == pytest.approx(np.array(sample.velocity_ned_m_s), abs=1e-6, rel=1e-6)


def test_between_two_points_yaw_turns_in_the_shorter_direction():
    points = (PathPoint(0.0, (0.0, 0.0, 0.0), 3.0), PathPoint(2.0, (1.0, 0.0, 0.0), -3.0))
    yaw = PathCurve.of(Path(points), None).at(1.0).yaw_ned_rad
    assert abs(yaw) == pytest.approx(math.pi)
