"""Frame conversions compared with the textbook formulas."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vehicle_sim import frames
from vehicle_sim.geodesy import to_global, to_local

angle = st.floats(-3.1, 3.1)
tilt = st.floats(-1.5, 1.5)


@given(angle, tilt, angle)
@settings(max_examples=50, deadline=None)
def test_euler_angles_quaternions_and_matrices_agree(roll, pitch, yaw):
    q = frames.quaternion_from_euler(roll, pitch, yaw)[None, :]
    assert frames.euler_of(q)[0] == pytest.approx([roll, pitch, yaw], abs=1e-9)
    cr, sr, cp, sp, cy, sy = (f(a) for a in (roll, pitch, yaw) for f in (math.cos, math.sin))
    expected = [
        [cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy],
        [cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy],
        [-sp, sr * cp, cr * cp],
    ]
    matrix = frames.rotation_matrix(q)
    assert matrix[0] == pytest.approx(np.array(expected), abs=1e-12)
    converted_back = frames.quaternion_from_matrix(matrix)
    assert abs(float(converted_back[0] @ q[0])) == pytest.approx(1.0, abs=1e-6)


@given(st.lists(st.floats(-5, 5), min_size=6, max_size=6), angle, tilt, angle)
@settings(max_examples=50, deadline=None)
def test_vector_and_quaternion_products_agree_with_numpy(values, roll, pitch, yaw):
    a, b = np.array([values[:3]]), np.array([values[3:]])
    assert frames.cross(a, b)[0] == pytest.approx(np.cross(a[0], b[0]), abs=1e-12)
    q = frames.quaternion_from_euler(roll, pitch, yaw)[None, :]
    p = frames.quaternion_from_euler(yaw, pitch / 2, roll)[None, :]
    product = frames.rotation_matrix(frames.quaternion_product(q, p))
    assert product[0] == pytest.approx(frames.rotation_matrix(q)[0] @ frames.rotation_matrix(p)[0], abs=1e-12)
    matrix = frames.rotation_matrix(q)
    assert frames.rotate_back(matrix, frames.rotate(matrix, a))[0] == pytest.approx(a[0], abs=1e-12)


def test_a_positive_yaw_rate_turns_the_nose_east():
    q = np.array([[1.0, 0.0, 0.0, 0.0]])
    for _ in range(1000):
        q = frames.normalized(q + 0.001 * frames.quaternion_rate(q, np.array([[0.0, 0.0, 0.5]])))
    assert frames.yaw_of(q)[0] == pytest.approx(0.5, abs=1e-3)
    nose = frames.rotate(frames.rotation_matrix(q), np.array([[1.0, 0.0, 0.0]]))[0]
    assert nose[1] > 0.4


def test_angles_are_wrapped_to_plus_or_minus_pi():
    assert frames.wrap_pi(np.array([3.5, -3.5, 0.1])) == pytest.approx(
        [3.5 - 2 * math.pi, 2 * math.pi - 3.5, 0.1]
    )


@given(st.floats(-20000, 20000), st.floats(-20000, 20000), st.floats(-60, 60))
@settings(max_examples=60, deadline=None)
def test_a_projected_position_is_converted_back_unchanged(north, east, lat0):
    lat, lon = to_global(np.array(north), np.array(east), np.array(lat0), np.array(8.5))
    converted_back = to_local(lat, lon, np.array(lat0), np.array(8.5))
    assert float(converted_back[0]) == pytest.approx(north, abs=1e-5)
    assert float(converted_back[1]) == pytest.approx(east, abs=1e-5)


def test_a_degree_north_is_111_km():
    north, east = to_local(np.array(48.0), np.array(8.0), np.array(47.0), np.array(8.0))
    assert float(north) == pytest.approx(6371000.0 * math.pi / 180.0, rel=1e-9)
    assert float(east) == pytest.approx(0.0, abs=1e-9)
