"""A path is looked through all at once, with the same verdict as moment by moment, and in milliseconds."""

import math
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_server.errors import Refused
from gcs_server.streamer.bounds import Bounds
from gcs_server.streamer.door import _check_path
from gcs_server.streamer.path import Curve
from gcs_server.streamer.region import Disc, Polygon, Region
from gcs_server.streamer.setpoints import Path, PathPoint

metres = st.floats(-100, 100)
places = st.tuples(metres, metres, metres)
steps = st.lists(st.tuples(st.floats(0.01, 20), places), min_size=1, max_size=8)
corners = st.lists(st.tuples(metres, metres), min_size=3, max_size=8)


def path_of(steps):
    t_s, points = 0.0, [PathPoint(0.0, (0.0, 0.0, -5.0))]
    for wait_s, place in steps:
        t_s += wait_s
        points.append(PathPoint(t_s, place))
    return Path(tuple(points))


@given(steps, st.lists(st.floats(0, 1), min_size=1, max_size=20))
def test_many_moments_are_the_same_as_each_by_itself(steps, shares):
    curve = Curve(path_of(steps), None)
    times = np.array([share * curve.duration_s for share in shares])
    positions, velocities = curve.many(times)
    for t_s, position, velocity in zip(times, positions, velocities, strict=True):
        one = curve.at(float(t_s))
        assert position == pytest.approx(np.array(one.position_ned_m), abs=1e-6)
        assert velocity == pytest.approx(np.array(one.velocity_ned_m_s), abs=1e-6, rel=1e-6)


@given(st.lists(st.tuples(metres, metres), min_size=1, max_size=20), corners, st.floats(1, 100))
def test_many_places_are_judged_as_each_by_itself(places, corners, radius_m):
    region = Region(
        discs=(Disc((3.0, -2.0), radius_m, "a disc"),), polygons=(Polygon(tuple(corners), "a fence"),)
    )
    alone = [region.ground_breach(place) is not None for place in places]
    assert region.ground_breaches(np.array(places)).tolist() == alone


def the_longest():
    """5000 points in an hour, inside a fence of 200 corners."""
    turn = [2 * math.pi * k / 5000 for k in range(5000)]
    points = [PathPoint(k * 0.72, (40 * math.cos(a), 40 * math.sin(a), -10.0)) for k, a in enumerate(turn)]
    fence = [(60 * math.cos(a), 60 * math.sin(a)) for a in (2 * math.pi * k / 200 for k in range(200))]
    bounds = Bounds(speed_m_s=12.0, region=Region(polygons=(Polygon(tuple(fence), "the operator's fence"),)))
    return points, bounds


def test_the_longest_path_inside_the_largest_fence_costs_milliseconds():
    points, bounds = the_longest()
    took_s = []
    for _ in range(3):
        began_s = time.process_time()
        _check_path(Path(tuple(points)), points[0].position_ned_m, bounds)
        took_s.append(time.process_time() - began_s)
    assert min(took_s) < 0.2  # 2 s moment by moment, on the same machine


def test_its_one_bad_moment_is_found_and_named():
    points, bounds = the_longest()
    points[4000] = PathPoint(points[4000].t_s, (0.0, 80.0, -10.0))
    with pytest.raises(Refused, match=r"After 287\d\.\d s the path"):
        _check_path(Path(tuple(points)), points[0].position_ned_m, bounds)
