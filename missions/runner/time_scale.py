"""Slows mission time down to zero and back to normal, so that a vehicle stays on its path when it pauses.

With mission time s, ds/dt = r, the path p(s) is flown with velocity p' r and acceleration p'' r² + p' dr/dt.
The change of r is chosen so that the vehicle stays within its limits of acceleration and jerk.
"""

from __future__ import annotations

import math

from missions.frames import Vector3
from missions.runner.script import TimeScaleLimits

MAX_RATE_CHANGE = 1.0
"""Largest derivative of the rate [1/s], also for slow vehicles."""
MAX_RATE_JERK = 4.0
"""Largest second derivative of the rate [1/s²]."""
BRAKING_FACTOR = 1.1
"""Factor on the acceleration limit while braking. Without this factor, the vehicle could not brake on a path
that is already at the limit, such as a circle."""
JERK_FRACTION = 0.8
"""Fraction of the jerk limit that is used near the goal, because time steps are finite."""
GOAL_TOLERANCE = 2e-3
"""A rate closer than this to the goal is set to the goal."""
MAX_STEP_S = 0.05
"""Longer time steps are split [s]."""
ZERO_VECTOR: Vector3 = (0.0, 0.0, 0.0)


class TimeScale:
    """The rate of mission time.

    Args:
        time_scale_limits: the vehicle's limits.
        rate: initial rate.
    """

    def __init__(self, time_scale_limits: TimeScaleLimits, rate: float = 1.0) -> None:
        self.time_scale_limits = time_scale_limits
        self.rate = rate
        self.rate_change = 0.0
        """Current change of the rate [1/s]."""

    def is_at(self, goal: float) -> bool:
        """Whether the rate is at the goal and no longer changes."""
        return self.rate == goal and self.rate_change == 0.0

    def step(
        self, dt_s: float, goal: float, velocity: Vector3 = ZERO_VECTOR, acceleration: Vector3 = ZERO_VECTOR
    ) -> float:
        """Moves the rate towards the goal; returns by how much mission time advances [s].

        Args:
            dt_s: real time.
            goal: 0 to pause, 1 for planned speed.
            velocity: velocity of the path at rate 1 [m/s]; not used if `is_at(goal)`.
            acceleration: acceleration of the path at rate 1 [m/s²].
        """
        if 0.0 < dt_s <= MAX_STEP_S and self.rate == goal and self.rate_change == 0.0:
            return dt_s * (goal + goal) / 2.0  # the usual case; exactly the result of the loop below
        passed_s = 0.0
        while dt_s > 0.0:
            part_s = min(dt_s, MAX_STEP_S)
            rate_before = self.rate
            self._change_rate(part_s, goal, velocity, acceleration)
            passed_s += part_s * (rate_before + self.rate) / 2.0
            dt_s -= part_s
        return passed_s

    def _change_rate(self, dt_s: float, goal: float, velocity: Vector3, acceleration: Vector3) -> None:
        gap = goal - self.rate
        if abs(gap) < GOAL_TOLERANCE:
            self.rate, self.rate_change = goal, 0.0
            return
        speed = max(math.hypot(*velocity), 1e-6)
        jerk = min(MAX_RATE_JERK, self.time_scale_limits.jerk_m_s3 / speed)
        limit = min(MAX_RATE_CHANGE, self.time_scale_limits.acceleration_m_s2 / speed)
        wanted = math.copysign(min(limit, math.sqrt(2.0 * JERK_FRACTION * jerk * abs(gap))), gap)
        change = min(max(wanted, self.rate_change - jerk * dt_s), self.rate_change + jerk * dt_s)
        lower, upper = self._change_bounds(velocity, acceleration)
        self.rate_change = min(max(change, lower), upper)
        rate = self.rate + self.rate_change * dt_s
        if (goal - rate) * gap <= 0.0:
            rate = goal
        self.rate = min(max(rate, 0.0), 1.0)
        if self.rate == goal:
            self.rate_change = 0.0

    def _change_bounds(self, velocity: Vector3, acceleration: Vector3) -> tuple[float, float]:
        """Bounds of the change of rate that keep the acceleration within the vehicle's limits."""
        rate_squared = self.rate * self.rate
        north, east, down = (axis * rate_squared for axis in acceleration)
        lower, upper = -math.inf, math.inf
        horizontal = (
            math.hypot(*velocity[:2]),
            north * velocity[0] + east * velocity[1],
            math.hypot(north, east),
        )
        vertical = (abs(velocity[2]), down * velocity[2], abs(down))
        limits = (self.time_scale_limits.acceleration_m_s2, self.time_scale_limits.vertical_acceleration_m_s2)
        for (speed, along, path_acceleration), limit in zip((horizontal, vertical), limits, strict=True):
            if speed > 1e-6:
                limit = max(limit, path_acceleration)
                slower = math.hypot(
                    along, speed * math.sqrt((BRAKING_FACTOR * limit) ** 2 - path_acceleration**2)
                )
                faster = math.hypot(along, speed * math.sqrt(limit**2 - path_acceleration**2))
                lower = max(lower, (-along - slower) / speed**2)
                upper = min(upper, (-along + faster) / speed**2)
        return lower, upper
