"""The vehicle's own limits, from its parameters, and the operator's limits, set over the API."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from missions.fence import Fence

VEHICLE_PARAMETERS = (
    "MPC_XY_VEL_MAX",
    "MPC_Z_VEL_MAX_UP",
    "MPC_Z_VEL_MAX_DN",
    "MPC_TILTMAX_AIR",
    "MPC_ACC_HOR_MAX",
    "MPC_ACC_UP_MAX",
    "MPC_ACC_DOWN_MAX",
    "MPC_THR_HOVER",
    "MPC_XY_P",
    "MPC_Z_P",
    "MC_ROLLRATE_MAX",
    "MC_PITCHRATE_MAX",
    "MC_YAWRATE_MAX",
    "GF_MAX_HOR_DIST",
    "GF_MAX_VER_DIST",
)


@dataclass(frozen=True, slots=True)
class VehicleLimits:
    """Limits from the vehicle's parameters; None: unknown, or the limit is off."""

    speed_max_m_s: float | None = None
    """Horizontal: MPC_XY_VEL_MAX [m/s]."""
    climb_max_m_s: float | None = None
    """MPC_Z_VEL_MAX_UP [m/s]."""
    sink_max_m_s: float | None = None
    """MPC_Z_VEL_MAX_DN [m/s]."""
    tilt_max_rad: float | None = None
    """MPC_TILTMAX_AIR [rad]."""
    acceleration_max_m_s2: float | None = None
    """Horizontal: MPC_ACC_HOR_MAX [m/s²]."""
    acceleration_up_max_m_s2: float | None = None
    """MPC_ACC_UP_MAX [m/s²]."""
    acceleration_down_max_m_s2: float | None = None
    """MPC_ACC_DOWN_MAX [m/s²]."""
    hover_thrust: float | None = None
    """MPC_THR_HOVER, 0 to 1."""
    roll_rate_max_rad_s: float | None = None
    """MC_ROLLRATE_MAX [rad/s]."""
    pitch_rate_max_rad_s: float | None = None
    """MC_PITCHRATE_MAX [rad/s]."""
    yaw_rate_max_rad_s: float | None = None
    """MC_YAWRATE_MAX [rad/s]."""
    distance_max_m: float | None = None
    """From home: GF_MAX_HOR_DIST [m]; also None if the limit is off (0)."""
    height_max_m: float | None = None
    """Above home: GF_MAX_VER_DIST [m]; also None if the limit is off (0)."""


MIN_FENCE_M = 1e-3
"""A smaller fence radius or altitude counts as off [m], because PX4 treats zero as off."""


def vehicle_limits(values: Mapping[str, float]) -> VehicleLimits:
    """Limits from parameters; the limits of missing parameters stay unknown."""

    def degrees(name: str) -> float | None:
        value = values.get(name)
        return None if value is None else math.radians(value)

    def limit_or_none(name: str) -> float | None:
        value = values.get(name)
        return None if value is None or value < MIN_FENCE_M else value

    return VehicleLimits(
        speed_max_m_s=values.get("MPC_XY_VEL_MAX"),
        climb_max_m_s=values.get("MPC_Z_VEL_MAX_UP"),
        sink_max_m_s=values.get("MPC_Z_VEL_MAX_DN"),
        tilt_max_rad=degrees("MPC_TILTMAX_AIR"),
        acceleration_max_m_s2=values.get("MPC_ACC_HOR_MAX"),
        acceleration_up_max_m_s2=values.get("MPC_ACC_UP_MAX"),
        acceleration_down_max_m_s2=values.get("MPC_ACC_DOWN_MAX"),
        hover_thrust=values.get("MPC_THR_HOVER"),
        roll_rate_max_rad_s=degrees("MC_ROLLRATE_MAX"),
        pitch_rate_max_rad_s=degrees("MC_PITCHRATE_MAX"),
        yaw_rate_max_rad_s=degrees("MC_YAWRATE_MAX"),
        distance_max_m=limit_or_none("GF_MAX_HOR_DIST"),
        height_max_m=limit_or_none("GF_MAX_VER_DIST"),
    )


@dataclass(frozen=True, slots=True)
class OperatorLimits:
    """Limits set by the operator; None: no limit."""

    speed_max_m_s: float | None = None
    climb_max_m_s: float | None = None
    sink_max_m_s: float | None = None
    tilt_max_rad: float | None = None
    height_min_m: float | None = None
    """Minimum altitude above home [m]."""
    height_max_m: float | None = None
    """Maximum altitude above home [m]."""
    distance_max_m: float | None = None
    """Maximum horizontal distance from home [m]."""
    fence: Fence | None = None
    slew_velocity_m_s2: float | None = None
    """Maximum change of the sent velocity per second [m/s²]."""
    slew_attitude_rad_s: float | None = None
    """Maximum rotation of the sent attitude per second [rad/s]."""
    obstacle_brake: bool = True
    """Whether the vehicle is stopped before obstacles that its sensors measure; no effect without such a
    sensor."""

    @property
    def needs_position(self) -> bool:
        """Whether these limits need the vehicle's position."""
        return any(
            limit is not None
            for limit in (self.height_min_m, self.height_max_m, self.distance_max_m, self.fence)
        )
