"""Limits between parameters that PX4 enforces and reports: speeds, tilts, hover thrust."""

from __future__ import annotations

import math
from dataclasses import dataclass

from vehicle_sim.autopilot.announcer import Announcer
from vehicle_sim.parameters import Parameters

CRITICAL = 2
"""MAV_SEVERITY_CRITICAL."""
TILT_MAX_DEG = 89.0


@dataclass(frozen=True, slots=True)
class _Limit:
    """The parameter `name` may not exceed the parameter `maximum`."""

    name: str
    maximum: str
    text: str
    event: str


_LIMITS = (
    _Limit("MPC_TILTMAX_LND", "MPC_TILTMAX_AIR", "Land tilt has been constrained by max tilt",
           "mc_pos_ctrl_land_tilt_set"),
    _Limit("MPC_XY_CRUISE", "MPC_XY_VEL_MAX", "Cruise speed has been constrained by max speed",
           "mc_pos_ctrl_cruise_set"),
    _Limit("MPC_VEL_MANUAL", "MPC_XY_VEL_MAX", "Manual speed has been constrained by max speed",
           "mc_pos_ctrl_man_vel_set"),
    _Limit("MPC_VEL_MAN_BACK", "MPC_VEL_MANUAL",
           "Manual backward speed has been constrained by forward speed", "mc_pos_ctrl_man_vel_back_set"),
    _Limit("MPC_VEL_MAN_SIDE", "MPC_VEL_MANUAL",
           "Manual sideways speed has been constrained by forward speed", "mc_pos_ctrl_man_vel_side_set"),
    _Limit("MPC_Z_V_AUTO_UP", "MPC_Z_VEL_MAX_UP", "Ascent speed has been constrained by max speed",
           "mc_pos_ctrl_up_vel_set"),
    _Limit("MPC_Z_V_AUTO_DN", "MPC_Z_VEL_MAX_DN", "Descent speed has been constrained by max speed",
           "mc_pos_ctrl_down_vel_set"),
)  # fmt: skip


class ParameterLimits:
    """Enforces the limits of one vehicle; call `apply` after each parameter change by a client."""

    def __init__(self, parameters: Parameters, announcer: Announcer) -> None:
        self._parameters = parameters
        self._announcer = announcer

    def apply(self) -> None:
        """Sets values outside their limits to the limit, and reports each change."""
        value = self._parameters.get
        if value("MPC_TILTMAX_AIR") > TILT_MAX_DEG:
            self._parameters.set("MPC_TILTMAX_AIR", TILT_MAX_DEG)
            self._report("Tilt constrained to safe value", "mc_pos_ctrl_tilt_set", TILT_MAX_DEG)
        for limit in _LIMITS:
            highest = value(limit.maximum)
            if value(limit.name) > highest:
                self._parameters.set(limit.name, highest)
                self._report(limit.text, limit.event, highest)
        low, high = value("MPC_THR_MIN"), value("MPC_THR_MAX")
        hover = value("MPC_THR_HOVER")
        if low <= high and not low <= hover <= high and not math.isnan(hover):
            limited = max(low, min(high, hover))
            self._parameters.set("MPC_THR_HOVER", limited)
            self._report(
                "Hover thrust has been constrained by min/max", "mc_pos_ctrl_hover_thrust_set", limited
            )

    def _report(self, text: str, event: str, value: float) -> None:
        self._announcer.announce(CRITICAL, text, event, "f", value)
