"""Smooth motion of one axis: a velocity is reached as fast as acceleration and jerk limits allow.

The change of velocity has three parts (jerk, constant acceleration, opposite jerk), as in PX4's smoothing.
Axes that move together take as long as the slowest axis, so that they follow one curve. An axis is a row of
numbers for the compiled functions; `Axis` gives names to the row's numbers.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.kernels import Column, Rows, formula, kernel

(
    POSITION, VELOCITY, ACCELERATION, JERK, ACCELERATION_LIMIT, VELOCITY_CHANGE, FIRST_S, MIDDLE_S, LAST_S,
    HAS_PLAN, SIZE,
) = range(11)  # fmt: skip
"""Columns of an axis: position [m], velocity [m/s], acceleration [m/s²], signed jerk of the first part
[m/s³] (the last part has the opposite jerk), limit of the acceleration, planned change of velocity [m/s],
durations of the three parts [s] (PX4's T1, T2, T3), and whether a plan exists since the reset. Without a plan
the acceleration is kept."""

_NEGLIGIBLE = 1e-6
"""Smaller accelerations [m/s²] and velocity changes [m/s] count as zero."""


@kernel
def max_speed_for_distance(
    jerk_m_s3: float, acceleration_m_s2: float, distance_m: float, final_speed_m_s: float
) -> float:
    """The highest speed from which the final speed can be reached within `distance_m` and both limits."""
    jerk_m_s3 = max(jerk_m_s3, 0.1)
    distance_m = max(distance_m, 0.0)
    b = 4.0 * acceleration_m_s2 * acceleration_m_s2 / jerk_m_s3
    c = -2.0 * acceleration_m_s2 * distance_m - final_speed_m_s * final_speed_m_s
    discriminant = b * b - 4.0 * c
    speed_m_s = 0.5 * (-b + (math.sqrt(discriminant) if discriminant > 0.0 else 0.0))
    return max(final_speed_m_s, speed_m_s)


@formula
def _integrate(axis: Column, dt_s: float, jerk: float) -> None:
    a, v = axis[ACCELERATION], axis[VELOCITY]
    axis[POSITION] += v * dt_s + 0.5 * a * dt_s * dt_s + jerk * dt_s**3 / 6.0
    axis[VELOCITY] += a * dt_s + 0.5 * jerk * dt_s * dt_s
    axis[ACCELERATION] += jerk * dt_s


@formula
def _limit_first_s(axis: Column, first_s: float) -> float:
    a, jerk, limit = axis[ACCELERATION], axis[JERK], axis[ACCELERATION_LIMIT]
    peak = a + jerk * first_s
    if abs(peak) > limit:
        first_s = (math.copysign(limit, peak) - a) / jerk
    return max(first_s, 0.0)


@formula
def _middle_s(axis: Column, first_s: float, last_s: float) -> float:
    a, jerk = axis[ACCELERATION], axis[JERK]
    peak = a + jerk * first_s
    if abs(peak) < _NEGLIGIBLE:
        return 0.0
    first_m_s = (a + 0.5 * jerk * first_s) * first_s
    last_m_s = (peak - 0.5 * jerk * last_s) * last_s
    return max((axis[VELOCITY_CHANGE] - first_m_s - last_m_s) / peak, 0.0)


@kernel
def plan(axis: Column, velocity_m_s: float, acceleration_limit_m_s2: float, jerk_limit_m_s3: float) -> None:
    """Plans the fastest change to a velocity."""
    a, limit = axis[ACCELERATION], max(jerk_limit_m_s3, 0.1)
    remaining_m_s = velocity_m_s - (axis[VELOCITY] + 0.5 * a * abs(a) / limit)
    jerk = math.copysign(limit, remaining_m_s if abs(remaining_m_s) > _NEGLIGIBLE else a)
    change = velocity_m_s - axis[VELOCITY]
    axis[JERK], axis[ACCELERATION_LIMIT], axis[VELOCITY_CHANGE] = jerk, acceleration_limit_m_s2, change
    square = 0.5 * a * a + change * jerk
    root = math.sqrt(square) if square > 0.0 else 0.0
    first_s = _limit_first_s(axis, max((root - abs(a) * math.copysign(1.0, a * jerk)) / abs(jerk), 0.0))
    last_s = max(a / jerk + first_s, 0.0)
    axis[FIRST_S], axis[MIDDLE_S], axis[LAST_S] = first_s, _middle_s(axis, first_s, last_s), last_s
    axis[HAS_PLAN] = 1.0


@formula
def _stretch(axis: Column, total_s: float) -> None:
    """Stretches the planned change to a longer duration."""
    a, jerk, change = axis[ACCELERATION], axis[JERK], axis[VELOCITY_CHANGE]
    b = jerk * total_s - a
    discriminant = jerk * jerk * total_s * total_s + 2.0 * total_s * a * jerk - a * a - 4.0 * jerk * change
    first_s = 0.0
    if discriminant > 0.0:
        root = math.sqrt(discriminant)
        shorter_s, longer_s = max(0.0, (b - root) / (2.0 * jerk)), max(0.0, (b + root) / (2.0 * jerk))
        if 2.0 * shorter_s + a / jerk <= total_s + 1e-9:
            first_s = shorter_s
        elif 2.0 * longer_s + a / jerk <= total_s + 1e-9:
            first_s = longer_s
    first_s = _limit_first_s(axis, first_s)
    last_s = max(0.0, a / jerk + first_s)
    axis[FIRST_S], axis[MIDDLE_S], axis[LAST_S] = first_s, max(0.0, total_s - first_s - last_s), last_s


@kernel
def advance_axis(axis: Column, dt_s: float) -> None:
    """Advances along the plan; after the end of the plan the velocity is constant."""
    remaining_s = dt_s
    for part in range(3):
        part_s = axis[FIRST_S + part]
        if part_s > 0.0 and remaining_s > 0.0:
            step_s = min(remaining_s, part_s)
            _integrate(axis, step_s, (1 - part) * axis[JERK])
            remaining_s -= step_s
            axis[FIRST_S + part] = part_s - step_s
    if remaining_s > 0.0:
        if axis[HAS_PLAN] != 0.0:
            axis[ACCELERATION] = 0.0
        _integrate(axis, remaining_s, 0.0)


@kernel
def synchronise(axes: Rows, count: int) -> None:
    """Stretches the plans of the first `count` axes to the duration of the slowest axis."""
    longest_s = 0.0
    for k in range(count):
        longest_s = max(longest_s, axes[k, FIRST_S] + axes[k, MIDDLE_S] + axes[k, LAST_S])
    for k in range(count):
        if axes[k, FIRST_S] + axes[k, MIDDLE_S] + axes[k, LAST_S] < longest_s:
            _stretch(axes[k], longest_s)


def _number_property(index: int) -> property:
    """Property for one column of an axis or a heading."""

    def read(axis: Axis | YawRamp) -> float:
        return axis.values[index]

    def write(axis: Axis | YawRamp, value: float) -> None:
        axis.values[index] = value

    return property(read, write)


class Axis:
    """One axis.

    Args:
        row: the axis's numbers; default: a new row, at rest at zero.
    """

    position_m = _number_property(POSITION)
    velocity_m_s = _number_property(VELOCITY)
    acceleration_m_s2 = _number_property(ACCELERATION)

    def __init__(self, row: NDArray[np.float64] | None = None) -> None:
        self.row = np.zeros(SIZE) if row is None else row
        self.values: memoryview[float] = self.row.data.cast("B").cast("d")
        """The numbers of `row`; access to one of them is several times as fast as in `row`."""

    def reset(self, position_m: float, velocity_m_s: float = 0.0) -> None:
        """Sets position and velocity, without acceleration."""
        self.row[:] = 0.0
        self.values[POSITION], self.values[VELOCITY] = position_m, velocity_m_s


YAW_RATE_TIME_CONSTANT_S = 0.2
"""Time constant of the low-pass on the fed-forward yaw rate (recorded turns: 63 % after 0.2 s)."""
YAW, YAW_RATE, YAW_TARGET, YAW_LOCKED, _YAW_AXIS = range(5)
YAW_SIZE = _YAW_AXIS + SIZE
"""Columns of a heading: the heading [rad], its rate [rad/s], its target [rad], the heading at the start of
the flight task [rad], and an axis for its smoothing."""


@formula
def _wrapped(angle_rad: float) -> float:
    """Same as `frames.wrap_angle`."""
    if abs(angle_rad) <= math.pi:
        return angle_rad
    if abs(angle_rad) <= 3.0 * math.pi:
        return angle_rad - math.copysign(math.tau, angle_rad)
    return angle_rad - math.tau * np.rint(angle_rad / math.tau)


@kernel
def turn(yaw: Column, dt_s: float, rate_max_rad_s: float, acceleration_rad_s2: float) -> None:
    """Turns a heading towards its target for `dt_s`, no faster than this rate.

    With an acceleration (not 0) the rate changes no faster than by it; otherwise the fed-forward rate is that
    of the heading through a low-pass.
    """
    error = _wrapped(yaw[YAW_TARGET] - yaw[YAW])
    if acceleration_rad_s2 > 0.0:
        axis = yaw[_YAW_AXIS:]  # PX4 smooths it like a velocity: the rate is its acceleration
        axis[VELOCITY], axis[ACCELERATION] = 0.0, yaw[YAW_RATE]
        plan(axis, error, rate_max_rad_s, acceleration_rad_s2)
        advance_axis(axis, dt_s)
        yaw[YAW], yaw[YAW_RATE] = _wrapped(yaw[YAW] + axis[VELOCITY]), axis[ACCELERATION]
        return
    step = max(-rate_max_rad_s * dt_s, min(rate_max_rad_s * dt_s, error))
    yaw[YAW_RATE] += (step / dt_s - yaw[YAW_RATE]) * dt_s / (dt_s + YAW_RATE_TIME_CONSTANT_S)
    yaw[YAW] = _wrapped(yaw[YAW] + step)


@kernel
def follow_heading(yaw: Column, heading_rad: float) -> None:
    """Sets a heading that is not controlled to the estimated heading. Also sets its target, if the target has
    not changed since the start of the flight task."""
    yaw[YAW], yaw[YAW_RATE] = heading_rad, 0.0
    if yaw[YAW_TARGET] == yaw[YAW_LOCKED]:
        yaw[YAW_TARGET] = yaw[YAW_LOCKED] = heading_rad


class YawRamp:
    """A heading with the limits MPC_YAWRAUTO_MAX and MPC_YAWRAUTO_ACC (`turn`); its rate is fed forward.

    Args:
        row: the heading's numbers.
    """

    yaw_ned_rad = _number_property(YAW)
    rate_rad_s = _number_property(YAW_RATE)
    target_rad = _number_property(YAW_TARGET)
    locked_rad = _number_property(YAW_LOCKED)

    def __init__(self, row: NDArray[np.float64]) -> None:
        self.row = row
        self.values: memoryview[float] = row.data.cast("B").cast("d")

    def reset(self, yaw_ned_rad: float) -> None:
        """Sets the heading, with zero rate."""
        self.values[YAW], self.values[YAW_RATE] = yaw_ned_rad, 0.0

    def follow(self, heading_rad: float) -> None:
        """Follows the estimated heading (`follow_heading`)."""
        follow_heading(self.row, heading_rad)

    def advance(self, dt_s: float, rate_max_rad_s: float, acceleration_rad_s2: float) -> None:
        """Turns towards the target for `dt_s` (`turn`)."""
        turn(self.row, dt_s, rate_max_rad_s, acceleration_rad_s2)
