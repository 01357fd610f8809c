"""Conversion between latitude and longitude and a local NED frame."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from missions.geodesy import EARTH_RADIUS_M, LocalOrigin, distance_m

ORIGIN = LocalOrigin(47.4, 8.5, 480.0)
metres = st.floats(-3000, 3000)
positions = st.tuples(metres, metres, st.floats(-500, 500))
latitudes, longitudes = st.floats(-80, 80), st.floats(-180, 180)


def test_a_degree_of_latitude_is_one_degree_of_arc_on_the_sphere():
    assert distance_m(47.0, 8.0, 48.0, 8.0) == pytest.approx(math.radians(1) * EARTH_RADIUS_M)
    assert ORIGIN.to_ned(48.4, 8.5, 480.0) == pytest.approx((math.radians(1) * EARTH_RADIUS_M, 0.0, 0.0))


@given(latitudes, longitudes, positions)
def test_a_position_converted_to_geodetic_and_back_is_unchanged(lat, lon, position):
    origin = LocalOrigin(lat, lon, 100.0)
    assert origin.to_ned(*origin.to_geodetic(position)) == pytest.approx(position, abs=1e-4)


@given(latitudes, longitudes, positions)
def test_the_origin_is_computed_from_a_position_in_both_frames(lat, lon, position):
    origin = LocalOrigin.from_position(lat, lon, 100.0, position)
    assert origin.to_ned(lat, lon, 100.0) == pytest.approx(position, abs=1e-4)


@given(positions)
def test_near_the_origin_the_flat_distance_equals_the_distance_on_the_sphere(position):
    lat, lon, _ = ORIGIN.to_geodetic(position)
    flat_m = math.hypot(position[0], position[1])
    assert distance_m(47.4, 8.5, lat, lon) == pytest.approx(flat_m, abs=0.001 * flat_m + 1e-3)


@given(positions)
def test_a_position_in_the_frame_of_another_origin_is_the_same_on_the_earth(position):
    other = LocalOrigin(47.401, 8.502, 500.0)
    lat, lon, alt = other.to_geodetic(ORIGIN.to_frame_of(other, position))
    expected = ORIGIN.to_geodetic(position)
    assert distance_m(lat, lon, *expected[:2]) < 0.2
    assert alt == pytest.approx(expected[2], abs=1e-6)


def test_positions_on_both_sides_of_the_date_line_have_their_short_distance():
    east_m = LocalOrigin(0.0, 179.9999, 0.0).to_ned(0.0, -179.9999, 0.0)[1]
    assert east_m == pytest.approx(math.radians(0.0002) * EARTH_RADIUS_M, rel=1e-6)
