"""Conversion of positions and attitudes between NED/FRD and the ENU frame of the 3D view."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_server.scene import frames
from missions.frames import rotate, yaw_from_q
from tests.unit.gcs_server.scene.scene_fakes import q_from_euler

angles = st.floats(-math.pi, math.pi)
pitches = st.floats(-1.5, 1.5)
coordinates = st.floats(-1e3, 1e3)
vectors = st.tuples(coordinates, coordinates, coordinates)


def test_in_the_enu_frame_north_is_y_and_down_is_negative_z():
    assert frames.enu_from_ned((1.0, 2.0, 3.0)) == (2.0, 1.0, -3.0)


@given(angles, pitches, angles, vectors)
def test_attitude_and_vector_conversion_agree(roll, pitch, yaw, v_frd):
    q_ned_frd = q_from_euler(roll, pitch, yaw)
    from_vector = frames.enu_from_ned(rotate(q_ned_frd, v_frd))
    v_flu = (v_frd[0], -v_frd[1], -v_frd[2])
    from_quaternion = rotate(frames.q_enu_flu_from_q_ned_frd(q_ned_frd), v_flu)
    assert from_quaternion == pytest.approx(from_vector, abs=1e-6)


def test_a_level_vehicle_heading_east_points_along_x():
    q = frames.q_enu_flu_from_q_ned_frd(q_from_euler(0.0, 0.0, math.pi / 2))
    assert rotate(q, (1, 0, 0)) == pytest.approx((1, 0, 0), abs=1e-9)
    assert rotate(q, (0, 0, 1)) == pytest.approx((0, 0, 1), abs=1e-9)


def test_a_positive_pitch_points_the_nose_up():
    q = frames.q_enu_flu_from_q_ned_frd(q_from_euler(0.0, math.radians(30), 0.0))
    assert rotate(q, (1, 0, 0)) == pytest.approx((0, math.cos(math.radians(30)), 0.5), abs=1e-9)


@given(angles)
def test_the_yaw_of_a_converted_attitude_equals_the_converted_yaw(yaw):
    q = frames.q_enu_flu_from_q_ned_frd(q_from_euler(0.0, 0.0, yaw))
    difference = yaw_from_q(q) - frames.yaw_enu_from_ned(yaw)
    assert math.cos(difference) == pytest.approx(1.0, abs=1e-9)


def test_the_vehicles_heading_is_added_to_a_gimbal_yaw_relative_to_the_vehicle():
    q = q_from_euler(0.0, -0.5, 0.3)
    q_ned_camera = frames.q_ned_camera(q, yaw_in_earth_frame=False, vehicle_yaw_ned_rad=1.0)
    assert q_ned_camera == pytest.approx(q_from_euler(0.0, -0.5, 1.3), abs=1e-9)
    assert frames.q_ned_camera(q, yaw_in_earth_frame=True, vehicle_yaw_ned_rad=1.0) == q


def test_a_thousandth_of_a_degree_of_latitude_is_111_m():
    origin = (47.0, 8.0, 400.0)
    east, north, up = frames.enu_from_geodetic(47.001, 8.0, 410.0, origin_deg_m=origin)
    assert (east, up) == (0.0, 10.0)
    assert north == pytest.approx(111.17, abs=0.05)


def test_positions_are_continuous_across_180_degrees_of_longitude():
    east, _, _ = frames.enu_from_geodetic(0.0, -179.9999, 0.0, origin_deg_m=(0.0, 179.9999, 0.0))
    assert east == pytest.approx(22.26, abs=0.05)
