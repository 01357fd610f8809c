"""From which speed the vehicle still stops in time: on the careful side of what PX4 was seen to do."""

from __future__ import annotations

from missions.avoidance.stopping import braking_speed as braking_speed

BRAKE_M_S2, BRAKE_DELAY_S = 1.2, 0.8
"""How PX4 slows down when a velocity setpoint falls: gentler than it can (5 m/s²). Its integrator, wound up
against drag, carries it on at some 0.5 m/s for seconds after the setpoint has become zero."""
BRAKE_HEIGHT_M_S2, BRAKE_HEIGHT_DELAY_S = 1.0, 0.6
GUARD_M_S2, GUARD_DELAY_S = 2.0, 0.8
"""The same from any attitude, by position setpoints, while the controllers change over."""
PUSH_PER_S, PUSH_MOST_M_S = 1.0, 1.0
"""Nearer to an edge than the margin it is pushed back: so fast for each metre, at most so."""
MARGIN_M = 1.0
"""Speeds are cut to stop this far inside."""
MARGIN_HEIGHT_M = 0.5
