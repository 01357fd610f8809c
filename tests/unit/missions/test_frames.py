"""Rotations, and limits of tilt and rotation."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from missions import frames

angles = st.floats(-math.pi, math.pi)
pitches = st.floats(-1.5, 1.5)
numbers = st.floats(-1e3, 1e3)
vectors = st.tuples(numbers, numbers, numbers)
attitudes = st.builds(frames.q_from_euler, angles, pitches, angles)


def angle_between(a, b):
    return 2 * math.acos(min(1.0, abs(sum(x * y for x, y in zip(a, b, strict=True)))))


@given(angles, pitches, angles)
def test_euler_angles_are_unchanged_after_conversion_to_a_quaternion_and_back(roll, pitch, yaw):
    converted_back = frames.euler_from_q(frames.q_from_euler(roll, pitch, yaw))
    for before, after in zip((roll, pitch, yaw), converted_back, strict=True):
        assert math.cos(before - after) == pytest.approx(1.0, abs=1e-9)


@given(attitudes, attitudes, vectors)
def test_a_product_rotates_by_its_second_factor_first(a, b, v):
    by_product = frames.rotate(frames.multiply(a, b), v)
    assert by_product == pytest.approx(frames.rotate(a, frames.rotate(b, v)), abs=1e-6)


@given(attitudes, vectors)
def test_the_conjugate_rotates_back(q, v):
    assert frames.rotate(frames.conjugate(q), frames.rotate(q, v)) == pytest.approx(v, abs=1e-6)


def test_roll_right_puts_the_right_side_down():
    q = frames.q_from_euler(math.pi / 2, 0.0, 0.0)
    assert frames.rotate(q, (0.0, 1.0, 0.0)) == pytest.approx((0.0, 0.0, 1.0), abs=1e-9)


@given(angles, vectors)
def test_the_heading_frame_is_a_rotation_about_down(yaw, v):
    assert frames.ned_from_heading(v, yaw) == pytest.approx(
        frames.rotate(frames.q_from_yaw(yaw), v), abs=1e-6
    )


@given(st.floats(-100, 100))
def test_wrap_pi_returns_the_same_direction_within_plus_or_minus_pi(angle):
    wrapped = frames.wrap_pi(angle)
    assert -math.pi <= wrapped <= math.pi
    assert math.cos(wrapped - angle) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("q", [(0.0, 0.0, 0.0, 0.0), (math.nan, 0.0, 0.0, 1.0), (math.inf, 0.0, 0.0, 1.0)])
def test_an_invalid_quaternion_cannot_be_normalized(q):
    assert frames.normalized(q) is None


@given(attitudes, st.floats(0.05, 3.0))
def test_limit_tilt_keeps_the_direction_of_the_tilt(q, max_rad):
    limited, is_limited = frames.limit_tilt(q, max_rad)
    assert is_limited == (frames.tilt_from_q(q) > max_rad)
    assert frames.tilt_from_q(limited) == pytest.approx(min(max_rad, frames.tilt_from_q(q)), abs=1e-6)
    if 0.01 < frames.tilt_from_q(q) < math.pi - 0.01:
        before, after = (frames.rotate(each, (0.0, 0.0, 1.0)) for each in (q, limited))
        turn_rad = math.atan2(after[1], after[0]) - math.atan2(before[1], before[0])
        assert math.remainder(turn_rad, math.tau) == pytest.approx(0.0, abs=1e-5)


@given(attitudes, attitudes, st.floats(0.01, 1.0))
def test_limit_rotation_rotates_in_the_shorter_direction_by_at_most_the_limit(start, target, max_rad):
    limited, is_limited = frames.limit_rotation(start, target, max_rad)
    angle = angle_between(start, target)
    assert angle_between(start, limited) <= min(angle, max_rad) + 1e-5
    if is_limited:
        assert angle_between(limited, target) == pytest.approx(angle - max_rad, abs=1e-4)
    else:
        assert limited == target
