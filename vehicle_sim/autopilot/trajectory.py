"""Smooth motion to a target: jerk- and acceleration-limited velocity, integrated to positions.

Follows the idea of PX4's position smoothing: the speed wanted falls with the distance left so that the stop
fits into the limits, and the position set point waits for a vehicle that lags.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


def max_speed_for_distance(
    jerk_m_s3: float, acceleration_m_s2: float, distance_m: float, final_speed_m_s: float = 0.0
) -> float:
    """The speed from which one can still stop within `distance_m` under both limits."""
    jerk_m_s3 = max(0.1, jerk_m_s3)
    b = 4.0 * acceleration_m_s2 * acceleration_m_s2 / jerk_m_s3
    c = -2.0 * acceleration_m_s2 * max(0.0, distance_m) - final_speed_m_s * final_speed_m_s
    return max(0.5 * (-b + math.sqrt(max(0.0, b * b - 4.0 * c))), final_speed_m_s)


@dataclass(slots=True)
class Axis:
    """Position, velocity and acceleration of one direction."""

    position_m: float = 0.0
    velocity_m_s: float = 0.0
    acceleration_m_s2: float = 0.0

    def reset(self, position_m: float, velocity_m_s: float = 0.0) -> None:
        """Start over from where the vehicle is."""
        self.position_m = position_m
        self.velocity_m_s = velocity_m_s
        self.acceleration_m_s2 = 0.0

    def advance(
        self,
        velocity_wanted_m_s: float,
        dt_s: float,
        *,
        acceleration_limit_m_s2: float,
        jerk_limit_m_s3: float,
        stretch: float = 1.0,
    ) -> None:
        """Move `dt_s` on towards the wanted velocity; `stretch` slows the position down (0..1)."""
        gap = velocity_wanted_m_s - self.velocity_m_s
        wanted = math.copysign(min(acceleration_limit_m_s2, math.sqrt(2.0 * jerk_limit_m_s3 * abs(gap))), gap)
        change = jerk_limit_m_s3 * dt_s
        previous = self.acceleration_m_s2
        self.acceleration_m_s2 = max(previous - change, min(previous + change, wanted))
        step = 0.5 * (previous + self.acceleration_m_s2) * dt_s
        if abs(step) > abs(gap) and step * gap > 0.0:
            step, self.acceleration_m_s2 = gap, 0.0
        before = self.velocity_m_s
        self.velocity_m_s += step
        self.position_m += 0.5 * (before + self.velocity_m_s) * dt_s * stretch


def wrap_pi(angle_rad: float) -> float:
    """Into -pi..pi."""
    return math.remainder(angle_rad, math.tau)


YAW_RATE_TIME_CONSTANT_S = 0.2
"""Of the low-pass on the fed-forward yaw rate (from recorded turns: 63 % after 0.2 s)."""


@dataclass(slots=True)
class YawRamp:
    """A heading that turns no faster than MPC_YAWRAUTO_MAX; its rate is fed forward through a low-pass."""

    yaw_ned_rad: float = 0.0
    rate_rad_s: float = 0.0

    def reset(self, yaw_ned_rad: float) -> None:
        """Start over from the vehicle's heading."""
        self.yaw_ned_rad = yaw_ned_rad
        self.rate_rad_s = 0.0

    def advance(self, target_rad: float, dt_s: float, rate_max_rad_s: float) -> None:
        """Turn `dt_s` on towards the target."""
        gap = wrap_pi(target_rad - self.yaw_ned_rad)
        step = max(-rate_max_rad_s * dt_s, min(rate_max_rad_s * dt_s, gap))
        self.rate_rad_s += (step / dt_s - self.rate_rad_s) * dt_s / (dt_s + YAW_RATE_TIME_CONSTANT_S)
        self.yaw_ned_rad = wrap_pi(self.yaw_ned_rad + step)
