"""Smooth motion of one direction: a velocity reached as fast as acceleration and jerk allow.

The change of velocity has three parts (jerk, constant acceleration, jerk back), as in PX4's smoothing. Axes
that move together are given the time of the slowest, so that they bend along one curve.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from vehicle_sim.frames import wrap_angle


def max_speed_for_distance(
    jerk_m_s3: float, acceleration_m_s2: float, distance_m: float, final_speed_m_s: float = 0.0
) -> float:
    """The highest speed from which the vehicle can stop within `distance_m` under both limits."""
    # Comparisons are faster than max(); a fleet of a hundred vehicles calls this 20,000 times a second.
    jerk_m_s3 = jerk_m_s3 if jerk_m_s3 > 0.1 else 0.1
    distance_m = distance_m if distance_m > 0.0 else 0.0
    b = 4.0 * acceleration_m_s2 * acceleration_m_s2 / jerk_m_s3
    c = -2.0 * acceleration_m_s2 * distance_m - final_speed_m_s * final_speed_m_s
    square = b * b - 4.0 * c
    speed_m_s = 0.5 * (-b + (math.sqrt(square) if square > 0.0 else 0.0))
    return final_speed_m_s if final_speed_m_s > speed_m_s else speed_m_s


_NEGLIGIBLE = 1e-6
"""Accelerations [m/s²] and changes [m/s] below this count as zero."""


@dataclass(slots=True)
class Axis:
    """Position, velocity and acceleration of one direction, and the planned change of velocity."""

    position_m: float = 0.0
    velocity_m_s: float = 0.0
    acceleration_m_s2: float = 0.0
    _jerk_m_s3: float = 0.0
    """Signed jerk of the first part; the last part has the opposite sign."""
    _acceleration_limit_m_s2: float = 0.0
    _change_m_s: float = 0.0
    _parts_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    _planned: bool = False
    """Whether a change was planned since the reset; before that, the initial acceleration continues."""

    def reset(self, position_m: float, velocity_m_s: float = 0.0) -> None:
        """Starts again at a position and velocity, without acceleration."""
        self.position_m = position_m
        self.velocity_m_s = velocity_m_s
        self.acceleration_m_s2 = 0.0
        self._parts_s, self._planned = (0.0, 0.0, 0.0), False

    @property
    def change_s(self) -> float:
        """Duration of the planned change of velocity."""
        first_s, middle_s, last_s = self._parts_s
        return first_s + middle_s + last_s

    def plan(
        self, velocity_wanted_m_s: float, *, acceleration_limit_m_s2: float, jerk_limit_m_s3: float
    ) -> None:
        """Choose the fastest change to the wanted velocity."""
        a, limit = self.acceleration_m_s2, acceleration_limit_m_s2
        jerk_limit_m_s3 = jerk_limit_m_s3 if jerk_limit_m_s3 > 0.1 else 0.1
        stopping_velocity = self.velocity_m_s + 0.5 * a * abs(a) / jerk_limit_m_s3
        gap = velocity_wanted_m_s - stopping_velocity
        jerk = math.copysign(jerk_limit_m_s3, gap if abs(gap) > _NEGLIGIBLE else a)
        change = velocity_wanted_m_s - self.velocity_m_s
        self._jerk_m_s3, self._acceleration_limit_m_s2, self._change_m_s = jerk, limit, change
        square = 0.5 * a * a + change * jerk
        root = math.sqrt(square) if square > 0.0 else 0.0
        first_s = (root - abs(a) * math.copysign(1.0, a * jerk)) / abs(jerk)
        first_s = self._within_limit(first_s if first_s > 0.0 else 0.0)
        last_s = a / jerk + first_s
        last_s = last_s if last_s > 0.0 else 0.0
        self._parts_s, self._planned = (first_s, self._middle_s(first_s, last_s), last_s), True

    def take(self, total_s: float) -> None:
        """Stretches the planned change to a longer duration."""
        a, jerk, change = self.acceleration_m_s2, self._jerk_m_s3, self._change_m_s
        b = jerk * total_s - a
        inner = jerk * jerk * total_s * total_s + 2.0 * total_s * a * jerk - a * a - 4.0 * jerk * change
        first_s = 0.0
        if inner > 0.0:
            root = math.sqrt(inner)
            fits = [
                first
                for first in (max(0.0, (b - root) / (2.0 * jerk)), max(0.0, (b + root) / (2.0 * jerk)))
                if 2.0 * first + a / jerk <= total_s + 1e-9
            ]
            first_s = fits[0] if fits else 0.0
        first_s = self._within_limit(first_s)
        last_s = max(0.0, a / jerk + first_s)
        self._parts_s = (first_s, max(0.0, total_s - first_s - last_s), last_s)

    def fly(self, dt_s: float) -> None:
        """Advances along the plan; after its end the velocity is constant."""
        first_s, middle_s, last_s = self._parts_s
        left_s = dt_s
        if first_s > 0.0 < left_s:
            step_s = min(left_s, first_s)
            self._move(step_s, self._jerk_m_s3)
            left_s, first_s = left_s - step_s, first_s - step_s
        if middle_s > 0.0 < left_s:
            step_s = min(left_s, middle_s)
            self._move(step_s, 0.0)
            left_s, middle_s = left_s - step_s, middle_s - step_s
        if last_s > 0.0 < left_s:
            step_s = min(left_s, last_s)
            self._move(step_s, -self._jerk_m_s3)
            left_s, last_s = left_s - step_s, last_s - step_s
        self._parts_s = (first_s, middle_s, last_s)
        if left_s > 0.0:
            if self._planned:
                self.acceleration_m_s2 = 0.0
            self._move(left_s, 0.0)

    def advance(
        self,
        velocity_wanted_m_s: float,
        dt_s: float,
        *,
        acceleration_limit_m_s2: float,
        jerk_limit_m_s3: float,
    ) -> None:
        """Advances by `dt_s`, then plans a change to the wanted velocity."""
        self.fly(dt_s)
        self.plan(
            velocity_wanted_m_s,
            acceleration_limit_m_s2=acceleration_limit_m_s2,
            jerk_limit_m_s3=jerk_limit_m_s3,
        )

    def _move(self, dt_s: float, jerk: float) -> None:
        a, v = self.acceleration_m_s2, self.velocity_m_s
        self.position_m += v * dt_s + 0.5 * a * dt_s * dt_s + jerk * dt_s**3 / 6.0
        self.velocity_m_s += a * dt_s + 0.5 * jerk * dt_s * dt_s
        self.acceleration_m_s2 += jerk * dt_s

    def _within_limit(self, first_s: float) -> float:
        a, jerk, limit = self.acceleration_m_s2, self._jerk_m_s3, self._acceleration_limit_m_s2
        peak = a + jerk * first_s
        if abs(peak) > limit:
            first_s = (math.copysign(limit, peak) - a) / jerk
        return first_s if first_s > 0.0 else 0.0

    def _middle_s(self, first_s: float, last_s: float) -> float:
        a, jerk = self.acceleration_m_s2, self._jerk_m_s3
        peak = a + jerk * first_s
        if abs(peak) < _NEGLIGIBLE:
            return 0.0
        first_m_s = (a + 0.5 * jerk * first_s) * first_s
        last_m_s = (peak - 0.5 * jerk * last_s) * last_s
        middle_s = (self._change_m_s - first_m_s - last_m_s) / peak
        return middle_s if middle_s > 0.0 else 0.0


def synchronise(*axes: Axis) -> None:
    """Stretches the plans of all axes to the duration of the slowest."""
    times_s = [axis.change_s for axis in axes]
    longest_s = max(times_s)
    for axis, own_s in zip(axes, times_s, strict=True):
        if own_s < longest_s:
            axis.take(longest_s)


YAW_RATE_TIME_CONSTANT_S = 0.2
"""Of the low-pass on the fed-forward yaw rate (from recorded turns: 63 % after 0.2 s)."""


@dataclass(slots=True)
class YawRamp:
    """A heading that turns no faster than MPC_YAWRAUTO_MAX; its rate is fed forward through a low-pass."""

    yaw_ned_rad: float = 0.0
    rate_rad_s: float = 0.0

    def reset(self, yaw_ned_rad: float) -> None:
        """Starts again at the vehicle's heading."""
        self.yaw_ned_rad = yaw_ned_rad
        self.rate_rad_s = 0.0

    def advance(self, target_rad: float, dt_s: float, rate_max_rad_s: float) -> None:
        """Turns towards the target for `dt_s`."""
        gap = wrap_angle(target_rad - self.yaw_ned_rad)
        step = max(-rate_max_rad_s * dt_s, min(rate_max_rad_s * dt_s, gap))
        self.rate_rad_s += (step / dt_s - self.rate_rad_s) * dt_s / (dt_s + YAW_RATE_TIME_CONSTANT_S)
        self.yaw_ned_rad = wrap_angle(self.yaw_ned_rad + step)
