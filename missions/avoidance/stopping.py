"""From which speed a vehicle still stops in time."""

from __future__ import annotations

import math

STOP_M_S2, STOP_DELAY_S = 1.2, 0.8
"""Horizontally, as PX4 was seen to slow down when a velocity setpoint falls."""


def braking_speed(distance_m: float, decel_m_s2: float = STOP_M_S2, delay_s: float = STOP_DELAY_S) -> float:
    """The speed [m/s] from which it stops within a distance."""
    lag = decel_m_s2 * delay_s
    return max(0.0, -lag + math.sqrt(lag**2 + 2.0 * decel_m_s2 * max(0.0, distance_m)))
