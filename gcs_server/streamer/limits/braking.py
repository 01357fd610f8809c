"""Largest speed from which the vehicle stops in time: lower than PX4's measured braking allows."""

from __future__ import annotations

from missions.avoidance.stopping import braking_speed as braking_speed

BRAKE_M_S2, BRAKE_DELAY_S = 1.2, 0.8
"""PX4's deceleration when a velocity setpoint decreases: less than it could (5 m/s²). Its integrator
compensates drag, and still moves the vehicle at about 0.5 m/s for seconds after the setpoint has become
zero.
"""
BRAKE_HEIGHT_M_S2, BRAKE_HEIGHT_DELAY_S = 1.0, 0.6
GUARD_M_S2, GUARD_DELAY_S = 2.0, 0.8
"""Deceleration from any attitude by position setpoints, while PX4 changes between controllers."""
BACK_PER_S, MAX_BACK_M_S = 1.0, 1.0
"""Nearer to an edge than the margin the vehicle is moved back: speed per metre, and largest speed."""
MARGIN_M = 1.0
"""Distance from the edge at which the vehicle is stopped."""
MARGIN_HEIGHT_M = 0.5
