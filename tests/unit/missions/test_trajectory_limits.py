"""Trajectories stay within all limits and are continuous."""

from __future__ import annotations

import math

import numpy as np
import pytest

from missions.trajectory import headings, lines
from missions.trajectory.curve import TimedCurve
from missions.trajectory.headings import AlongPath, LookAt
from missions.trajectory.limits import MotionLimits
from missions.trajectory.pieces import Pieces
from missions.trajectory.points import merge_equal_positions
from missions.trajectory.shapes import arc, figure_eight
from missions.trajectory.solve import curve_along_path, curve_through_points
from missions.vehicle import GRAVITY_M_S2
from tests.support.random_paths import random_limits, random_points

BATCHES, MISSIONS_PER_BATCH = 20, 100
"""All missions of a batch have the same limits and are solved as one path; a stop separates two missions."""
TOLERANCE_FACTOR = 1.0 + 1e-6


def random_path(rng: np.random.Generator) -> Pieces:
    """The path of one random mission, with its yaw."""
    kind = rng.random()
    if kind < 0.1:
        end_m, climb_m = rng.uniform(1.0, 40.0), rng.uniform(-20.0, 20.0)
        path = arc(
            (0, 0, -9), rng.uniform(1.0, 40.0), rng.uniform(0.1, 4.0), climb_m=climb_m, end_radius_m=end_m
        )
        return headings.with_yaw_towards(path, LookAt((1.0, 2.0, 0.0)))
    if kind < 0.15:
        path = figure_eight(
            (0, 0, -9), rng.uniform(2.0, 100.0), rng.uniform(2.0, 50.0), rng.uniform(0.1, 3.0)
        )
        return headings.with_yaw_along_path(path, AlongPath())
    points: list = []
    while len(points) < 2:
        points, _ = merge_equal_positions(random_points(rng, int(rng.integers(2, 9)), yaws=kind < 0.5))
    path = lines.smooth_curve(points) if rng.random() < 0.4 else lines.straight_legs(points)
    yaws = [point.yaw_ned_rad for point in points]
    if any(yaw is not None for yaw in yaws):
        return headings.with_point_yaws(path, yaws)
    if kind < 0.7:
        return headings.with_yaw_towards(path, LookAt((3.0, 4.0, 0.0)))
    return headings.with_yaw_along_path(path, AlongPath())


def join_paths(paths: list[Pieces]) -> Pieces:
    """One path that consists of these paths in order, with a stop at the end of each."""
    return Pieces(
        np.concatenate([path.points for path in paths]),
        np.concatenate([path.spans for path in paths]),
        np.concatenate([path.stops[:-1] for path in paths] + [[True]]),
        np.array([0]),
    )


def assert_within_limits(curve: TimedCurve, limits: MotionLimits, samples: int) -> None:
    times = np.linspace(0.0, curve.duration_s, samples)
    states = curve.sample(times)
    v, a = states.velocity_ned_m_s, states.acceleration_ned_m_s2
    horizontal = np.hypot(a[:, 0], a[:, 1])
    assert np.hypot(v[:, 0], v[:, 1]).max() <= limits.speed_m_s * TOLERANCE_FACTOR
    assert -v[:, 2].min() <= limits.climb_m_s * TOLERANCE_FACTOR
    assert v[:, 2].max() <= limits.descent_m_s * TOLERANCE_FACTOR
    assert horizontal.max() <= limits.acceleration_m_s2 * TOLERANCE_FACTOR
    assert -a[:, 2].min() <= limits.acceleration_up_m_s2 * TOLERANCE_FACTOR
    assert a[:, 2].max() <= limits.acceleration_down_m_s2 * TOLERANCE_FACTOR
    assert np.arctan2(horizontal, GRAVITY_M_S2 - a[:, 2]).max() <= limits.tilt_rad * TOLERANCE_FACTOR
    assert np.abs(states.yaw_rate_ned_rad_s).max() <= limits.yaw_rate_rad_s * TOLERANCE_FACTOR
    step_s = times[1]
    jerk = np.sqrt((np.diff(a, axis=0) ** 2).sum(axis=1)) / step_s
    assert jerk.max() <= limits.jerk_m_s3 * (1.0 + 1e-4)
    yaw_acceleration = np.abs(np.diff(states.yaw_rate_ned_rad_s)) / step_s
    assert yaw_acceleration.max() <= limits.yaw_acceleration_rad_s2 * (1.0 + 1e-4)


@pytest.mark.parametrize("seed", range(BATCHES))
def test_thousands_of_random_missions_stay_within_all_limits(seed: int) -> None:
    rng = np.random.default_rng(seed)
    limits = random_limits(rng)
    path = join_paths([random_path(rng) for _ in range(MISSIONS_PER_BATCH)])
    curve = curve_along_path(path, limits, has_yaw=True)
    assert math.isfinite(curve.duration_s)
    assert_within_limits(curve, limits, 40_000)


@pytest.mark.parametrize("seed", range(40))
def test_position_velocity_and_acceleration_are_continuous(seed: int) -> None:
    rng = np.random.default_rng(1000 + seed)
    limits = random_limits(rng)
    points = random_points(rng, 8, yaws=seed % 2 == 0)
    heading = None if any(p.yaw_ned_rad is not None for p in points) else AlongPath()
    curve = curve_through_points(points, limits, exact=seed % 3 == 0, heading=heading)
    assert_within_limits(curve, limits, 4000)
    step_s = 1e-4
    boundaries_s = np.concatenate((curve.phase_start_s, [curve.time_at(u) for u in curve.starts.tolist()]))
    times = np.unique(np.concatenate((boundaries_s - step_s / 2.0, boundaries_s - step_s / 3.0)))
    before, after = curve.sample(times), curve.sample(times + step_s)
    jump_m = after.position_ned_m - before.position_ned_m - step_s * before.velocity_ned_m_s
    jump_m_s = after.velocity_ned_m_s - before.velocity_ned_m_s - step_s * before.acceleration_ned_m_s2
    jump_m_s2 = after.acceleration_ned_m_s2 - before.acceleration_ned_m_s2
    assert np.abs(jump_m).max() <= 15.0 * step_s**2 + 1e-7
    assert np.abs(jump_m_s).max() <= limits.jerk_m_s3 * step_s**2 + 1e-6
    assert np.abs(jump_m_s2).max() <= limits.jerk_m_s3 * step_s + 1e-4
    jump_rad = after.yaw_ned_rad - before.yaw_ned_rad - step_s * before.yaw_rate_ned_rad_s
    assert np.abs(jump_rad).max() <= limits.yaw_acceleration_rad_s2 * step_s**2 + 1e-7


def test_limits_are_read_from_the_vehicles_parameters() -> None:
    limits = MotionLimits.from_parameters(
        {"MPC_XY_VEL_MAX": 8.0, "MPC_TILTMAX_AIR": 30.0, "MPC_JERK_AUTO": math.nan, "MPC_YAWRAUTO_MAX": 90.0}
    )
    assert limits.speed_m_s == 8.0
    assert limits.tilt_rad == pytest.approx(math.radians(30.0))
    assert limits.yaw_rate_rad_s == pytest.approx(math.pi / 2)
    assert limits.jerk_m_s3 == MotionLimits().jerk_m_s3
