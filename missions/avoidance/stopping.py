"""Highest speed from which a vehicle can stop within a distance."""

from __future__ import annotations

import math

DECEL_M_S2, DELAY_S = 1.2, 0.8
"""Horizontal deceleration and delay measured on PX4 when a velocity setpoint is reduced."""


def braking_speed(distance_m: float, decel_m_s2: float = DECEL_M_S2, delay_s: float = DELAY_S) -> float:
    """The highest speed [m/s] from which the vehicle stops within a distance."""
    lag = decel_m_s2 * delay_s
    return max(0.0, -lag + math.sqrt(lag**2 + 2.0 * decel_m_s2 * max(0.0, distance_m)))
