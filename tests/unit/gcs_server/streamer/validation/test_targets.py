"""The check of a whole path takes milliseconds and finds an invalid sample."""

import math
import time

import pytest

from gcs_server.errors import Refused
from gcs_server.streamer.validation import check_path
from gcs_server.streamer.values.limit_values import Bounds
from missions.fence import Polygon, Region
from missions.setpoints import Path, PathPoint


def longest_path_and_bounds():
    """A path of 5000 points in one hour, and bounds with a fence of 200 corners around it."""
    angles_rad = [2 * math.pi * k / 5000 for k in range(5000)]
    points = [
        PathPoint(k * 0.72, (40 * math.cos(a), 40 * math.sin(a), -10.0)) for k, a in enumerate(angles_rad)
    ]
    corners = [(60 * math.cos(a), 60 * math.sin(a)) for a in (2 * math.pi * k / 200 for k in range(200))]
    bounds = Bounds(
        speed_m_s=12.0, region=Region(polygons=(Polygon(tuple(corners), "the operator's fence"),))
    )
    return points, bounds


def test_the_longest_path_inside_the_largest_fence_is_checked_in_milliseconds():
    points, bounds = longest_path_and_bounds()
    durations_s = []
    for _ in range(3):
        began_s = time.process_time()
        check_path(Path(tuple(points)), points[0].position_ned_m, bounds)
        durations_s.append(time.process_time() - began_s)
    assert min(durations_s) < 0.2  # checking each sample separately takes 2 s on the same machine


def test_the_refusal_of_a_path_names_the_time_of_its_invalid_sample():
    points, bounds = longest_path_and_bounds()
    points[4000] = PathPoint(points[4000].t_s, (0.0, 80.0, -10.0))
    with pytest.raises(Refused, match=r"After 287\d\.\d s the path"):
        check_path(Path(tuple(points)), points[0].position_ned_m, bounds)
