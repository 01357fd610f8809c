"""Rotations and frames of the ground station: NED and FRD, unit quaternions `(w, x, y, z)`.

`q_ned_frd` transforms a vector from body FRD to NED. Vectors and quaternions are tuples of floats, which is
faster than NumPy for single values. Only `gcs_server/scene` uses ENU and FLU.
"""

from __future__ import annotations

import math

Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

IDENTITY: Quaternion = (1.0, 0.0, 0.0, 0.0)


def wrap_pi(angle_rad: float) -> float:
    """The same angle in [-π, π]."""
    return math.remainder(angle_rad, math.tau)


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Hamilton product: the rotation `b` followed by the rotation `a`."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def conjugate(q: Quaternion) -> Quaternion:
    """The inverse rotation."""
    return (q[0], -q[1], -q[2], -q[3])


def rotate(q: Quaternion, v: Vector3) -> Vector3:
    """The vector rotated by `q`."""
    _, x, y, z = multiply(multiply(q, (0.0, *v)), conjugate(q))
    return (x, y, z)


def normalized(q: Quaternion) -> Quaternion | None:
    """The quaternion scaled to unit length; None: the quaternion is zero or not finite."""
    length = math.hypot(*q)
    if not math.isfinite(length) or length < 1e-6:
        return None
    return (q[0] / length, q[1] / length, q[2] / length, q[3] / length)


def q_from_yaw(yaw_rad: float) -> Quaternion:
    """A rotation about the third axis (z down: clockwise seen from above; z up: anticlockwise)."""
    return (math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2))


def yaw_from_q(q: Quaternion) -> float:
    """The rotation about the third axis [rad], in [-π, π]."""
    w, x, y, z = q
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def q_from_euler(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Quaternion:
    """`q_ned_frd` of roll, pitch and yaw (rotations in the order yaw, pitch, roll)."""
    cr, sr = math.cos(roll_rad / 2), math.sin(roll_rad / 2)
    cp, sp = math.cos(pitch_rad / 2), math.sin(pitch_rad / 2)
    cy, sy = math.cos(yaw_rad / 2), math.sin(yaw_rad / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def euler_from_q(q: Quaternion) -> Vector3:
    """Roll, pitch, yaw [rad]; the inverse of `q_from_euler`."""
    w, x, y, z = q
    return (
        math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x)))),
        yaw_from_q(q),
    )


def ned_from_heading(vector_frd: Vector3, yaw_ned_rad: float) -> Vector3:
    """Rotates a vector from the level heading frame (forward, right, down) to NED; `-yaw_ned_rad`
    inverts the rotation."""
    c, s = math.cos(yaw_ned_rad), math.sin(yaw_ned_rad)
    return (c * vector_frd[0] - s * vector_frd[1], s * vector_frd[0] + c * vector_frd[1], vector_frd[2])


def tilt_from_q(q_ned_frd: Quaternion) -> float:
    """Angle between the body's down axis and the vertical [rad]."""
    return math.acos(max(-1.0, min(1.0, 1.0 - 2.0 * (q_ned_frd[1] ** 2 + q_ned_frd[2] ** 2))))


def limit_tilt(q_ned_frd: Quaternion, max_rad: float) -> tuple[Quaternion, bool]:
    """Reduces the tilt to `max_rad`; keeps the direction of the tilt and the rotation about the body's down
    axis.

    Returns:
        The attitude, and whether the tilt was reduced.
    """
    tilt = tilt_from_q(q_ned_frd)
    if tilt <= max_rad:
        return q_ned_frd, False
    w, x, y, z = q_ned_frd
    # horizontal part of the body's down axis
    down_north, down_east = 2 * (x * z + w * y), 2 * (y * z - w * x)
    size = math.hypot(down_north, down_east)
    axis = (1.0, 0.0) if size < 1e-9 else (-down_east / size, down_north / size)
    about_down = multiply(conjugate(_about_level_axis(axis, tilt)), q_ned_frd)
    limited = multiply(_about_level_axis(axis, max_rad), about_down)
    return normalized(limited) or limited, True


def limit_rotation(start: Quaternion, target: Quaternion, max_rad: float) -> tuple[Quaternion, bool]:
    """Rotates from `start` towards `target` by at most `max_rad`.

    Returns:
        The attitude, and whether the rotation was limited.
    """
    step = multiply(conjugate(start), target)
    if step[0] < 0:  # the shorter direction
        step = (-step[0], -step[1], -step[2], -step[3])
    sine = math.hypot(step[1], step[2], step[3])
    if 2.0 * math.atan2(sine, step[0]) <= max_rad:
        return target, False
    scale = math.sin(max_rad / 2.0) / sine
    part = (math.cos(max_rad / 2.0), step[1] * scale, step[2] * scale, step[3] * scale)
    limited = multiply(start, part)
    return normalized(limited) or limited, True


def _about_level_axis(axis_ne: tuple[float, float], angle_rad: float) -> Quaternion:
    s = math.sin(angle_rad / 2)
    return (math.cos(angle_rad / 2), axis_ne[0] * s, axis_ne[1] * s, 0.0)
