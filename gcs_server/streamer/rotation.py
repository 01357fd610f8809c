"""Attitudes kept within a tilt and within a step: quaternions w, x, y, z of unit length."""

from __future__ import annotations

import math

from gcs_server.streamer.setpoints import Quaternion


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """First `b`, then `a`."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


def inverse(q: Quaternion) -> Quaternion:
    """The turn back."""
    return (q[0], -q[1], -q[2], -q[3])


def tilt_of(q: Quaternion) -> float:
    """Angle between the body's down and the earth's [rad]."""
    return math.acos(max(-1.0, min(1.0, 1.0 - 2.0 * (q[1] ** 2 + q[2] ** 2))))


def limited_tilt(q: Quaternion, most_rad: float) -> tuple[Quaternion, bool]:
    """Tilted into the same direction, by no more; the turn about the body's down stays. True: it was more."""
    tilt = tilt_of(q)
    if tilt <= most_rad:
        return q, False
    w, x, y, z = q
    down = (2 * (x * z + w * y), 2 * (y * z - w * x))  # the body's down, north and east of it
    size = math.hypot(*down)
    axis = (1.0, 0.0) if size < 1e-9 else (-down[1] / size, down[0] / size)
    whole = _about(axis, tilt)
    turn = product(inverse(whole), q)
    return _unit(product(_about(axis, most_rad), turn)), True


def limited_step(before: Quaternion, wanted: Quaternion, most_rad: float) -> tuple[Quaternion, bool]:
    """From `before` towards `wanted`, by no more than an angle. True: it does not arrive."""
    step = product(inverse(before), wanted)
    if step[0] < 0:
        step = (-step[0], -step[1], -step[2], -step[3])
    sine = math.hypot(step[1], step[2], step[3])
    angle = 2.0 * math.atan2(sine, step[0])
    if angle <= most_rad:
        return wanted, False
    half = most_rad / 2.0
    scale = math.sin(half) / sine
    part = (math.cos(half), step[1] * scale, step[2] * scale, step[3] * scale)
    return _unit(product(before, part)), True


def _about(axis: tuple[float, float], angle: float) -> Quaternion:
    """A turn about a level axis (north, east)."""
    s = math.sin(angle / 2)
    return (math.cos(angle / 2), axis[0] * s, axis[1] * s, 0.0)


def _unit(q: Quaternion) -> Quaternion:
    size = math.hypot(*q)
    return (q[0] / size, q[1] / size, q[2] / size, q[3] / size)
