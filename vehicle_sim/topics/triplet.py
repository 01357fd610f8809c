"""The navigator's target as PX4's `position_setpoint_triplet`, for the log and for ROS 2. The simulated
vehicle knows the current target only."""

from __future__ import annotations

import math
from typing import Any

from vehicle_sim.autopilot.autopilot import Autopilot
from vehicle_sim.autopilot.modes import NavState

SETPOINT_TYPES, LANDING_TYPE = {NavState.TAKEOFF: 3, NavState.HOLD: 2}, 4
"""PositionSetpoint.type of a mode's waypoint, and of a landing; else it is a position to fly to (0)."""
DEFAULT_SETPOINT = {
    "type": 5, "loiter_radius": 80.0, "acceptance_radius": 2.0, "cruising_speed": -1.0,
    "cruising_throttle": math.nan, "lat": math.nan, "lon": math.nan, "yaw": math.nan,
}  # fmt: skip
"""Fields of a position setpoint without a waypoint; type 5 is SETPOINT_TYPE_IDLE."""


def setpoint_type(autopilot: Autopilot) -> int:
    """PositionSetpoint.type of the waypoint of the present mode."""
    active = autopilot.commander.active
    return LANDING_TYPE if autopilot.navigator.lands_in(active) else SETPOINT_TYPES.get(active, 0)


def triplet(autopilot: Autopilot, now_us: int) -> dict[str, Any]:
    """The values of the topic, by flat names such as `current.lat`."""
    waypoint, values = autopilot.waypoint, dict[str, Any]()
    for role in ("previous", "current", "next"):
        setpoint = DEFAULT_SETPOINT | {"timestamp": now_us}
        if role == "current" and waypoint is not None:
            setpoint |= {"valid": True, "type": setpoint_type(autopilot)}
            setpoint |= dict(zip(("lat", "lon", "alt"), waypoint, strict=True))
        values |= {f"{role}.{name}": value for name, value in setpoint.items()}
    return values
