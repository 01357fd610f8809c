"""The region of fences: inside or outside, distance to the edge, nearest position inside."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from missions.fence import Circle, CircleFence, Polygon, PolygonFence, Region
from missions.geodesy import LocalOrigin

L_SHAPE = ((-60.0, -60.0), (60.0, -60.0), (60.0, 0.0), (0.0, 0.0), (0.0, 60.0), (-60.0, 60.0))
FENCED_REGION = Region(-40.0, 0.0, (Circle((0.0, 0.0), 70.0, "70 m"),), (Polygon(L_SHAPE, "the fence"),))
ROUNDING_STEPS_M = [(n, e) for n in (-1e-6, 0.0, 1e-6) for e in (-1e-6, 0.0, 1e-6)]
metres = st.floats(-100, 100)
positions = st.tuples(metres, metres)
corners = st.lists(positions, min_size=3, max_size=8)
positions_inside = st.tuples(st.floats(-59, 59), st.floats(-59, 59)).filter(
    lambda position: FENCED_REGION.breach(position) is None
)


def is_inside(position, region=FENCED_REGION):
    """Whether the position is inside, on the edge, or at most 1 µm outside."""
    return any(region.breach((position[0] + n, position[1] + e)) is None for n, e in ROUNDING_STEPS_M)


@given(st.lists(positions, min_size=1, max_size=20), corners, st.floats(1, 100))
def test_checking_many_positions_at_once_equals_checking_each_position(many_positions, corners, radius_m):
    region = Region(
        circles=(Circle((3.0, -2.0), radius_m, "a circle"),), polygons=(Polygon(tuple(corners), "a fence"),)
    )
    each_outside = [region.breach(position) is not None for position in many_positions]
    assert region.are_outside(np.array(many_positions)).tolist() == each_outside


@given(positions_inside, positions)
def test_every_position_up_to_the_last_position_inside_is_inside(start, target):
    end = FENCED_REGION.last_position_inside(start, target)
    for fraction in (step / 20 for step in range(21)):
        assert is_inside(
            (start[0] + (end[0] - start[0]) * fraction, start[1] + (end[1] - start[1]) * fraction)
        )


@given(st.tuples(st.floats(-34, 34), st.floats(-34, 34)))
def test_a_target_inside_a_convex_region_is_left_unchanged(target):
    region = Region(circles=(Circle((0.0, 0.0), 50.0, "50 m"),))
    assert region.last_position_inside((0.0, 0.0), target) == target


@given(positions)
def test_the_nearest_position_inside_is_inside(position):
    nearest = FENCED_REGION.position_inside(position)
    assert nearest is not None
    assert is_inside(nearest)


def test_a_region_of_disjoint_fences_has_no_position_inside():
    region = Region(circles=(Circle((0.0, 0.0), 5.0, "one"), Circle((50.0, 0.0), 5.0, "other")))
    assert region.position_inside((0.0, 0.0)) is None


@given(positions_inside, st.floats(-math.pi, math.pi))
def test_a_position_at_the_reported_distance_is_on_the_edge(start, direction_rad):
    direction = (math.cos(direction_rad), math.sin(direction_rad))
    edge_m = FENCED_REGION.distance_to_edge_m(start, direction)
    for distance_m, expected_inside in ((edge_m - 0.01, True), (edge_m + 0.01, False)):
        if distance_m > 0.0:
            position = (start[0] + direction[0] * distance_m, start[1] + direction[1] * distance_m)
            assert (
                is_inside(position) == expected_inside
                or min(abs(edge) for edge, _ in FENCED_REGION.edges(position)) < 0.02
            )


def test_breach_returns_the_name_of_the_limit_that_the_position_exceeds():
    assert FENCED_REGION.breach((30.0, 30.0)) == "the fence"
    assert FENCED_REGION.breach((-60.0, 60.0)) == "70 m"
    assert FENCED_REGION.breach((-10.0, -10.0)) is None


def test_distances_to_edges_are_negative_outside():
    region = Region(circles=(Circle((0.0, 0.0), 50.0, "50 m"),))
    (inside_m, outward), (outside_m, _) = *region.edges((40.0, 0.0)), *region.edges((60.0, 0.0))
    assert (inside_m, outward, outside_m) == (10.0, (1.0, 0.0), -10.0)


@pytest.mark.parametrize(("down_m", "expected_m"), [(-50.0, -40.0), (-10.0, -10.0), (5.0, 0.0)])
def test_down_is_clamped_to_the_vertical_limits(down_m, expected_m):
    assert FENCED_REGION.clamp_down_m(down_m) == expected_m


def test_a_fence_in_geodetic_coordinates_is_the_same_in_a_local_frame():
    origin = LocalOrigin(47.4, 8.5, 480.0)
    corners = [origin.to_geodetic((n, e, 0.0))[:2] for n, e in L_SHAPE]
    polygon = PolygonFence(tuple(corners)).to_local(origin, "the fence")
    assert np.array(polygon.corners_ne_m) == pytest.approx(np.array(L_SHAPE), abs=1e-4)
    circle = CircleFence(*origin.to_geodetic((10.0, -20.0, 0.0))[:2], 30.0).to_local(origin, "a circle")
    assert circle.center_ne_m == pytest.approx((10.0, -20.0), abs=1e-4)
    assert (circle.radius_m, circle.name) == (30.0, "a circle")


def test_a_region_states_whether_it_has_horizontal_and_vertical_limits():
    assert not Region().is_limited_horizontally
    assert not Region().is_limited_vertically
    assert FENCED_REGION.is_limited_horizontally
    assert FENCED_REGION.is_limited_vertically
