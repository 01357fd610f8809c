"""Decelerations, delays and margins for the maximum speed from which the vehicle stops in time. The values
are more cautious than the braking that was measured with PX4."""

from __future__ import annotations

from missions.avoidance.values import braking_speed as braking_speed

BRAKE_M_S2, BRAKE_DELAY_S = 1.2, 0.8
"""PX4's deceleration [m/s²] and delay [s] when a velocity setpoint decreases. The deceleration is less than
PX4's maximum of 5 m/s²: PX4's integrator compensates drag, and still moves the vehicle at about 0.5 m/s for
seconds after the setpoint has become zero.
"""
BRAKE_VERTICAL_M_S2, BRAKE_VERTICAL_DELAY_S = 1.0, 0.6
TAKEOVER_M_S2, TAKEOVER_DELAY_S = 2.0, 0.8
"""Deceleration [m/s²] and delay [s] after the stream has replaced attitude or rate setpoints by position
setpoints; the delay includes PX4's change of controllers."""
BACK_PER_S, MAX_BACK_M_S = 1.0, 1.0
"""Speed at which the vehicle is moved back from an edge nearer than the margin: speed per metre [1/s], and
maximum speed [m/s]."""
MARGIN_M = 1.0
"""Distance from the edge or obstacle at which the vehicle is stopped [m]."""
MARGIN_VERTICAL_M = 0.5
