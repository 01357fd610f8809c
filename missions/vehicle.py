"""Vehicle model for checks and estimates of plans: speeds, limits and power."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from missions.floor import LANDING_HEIGHT_M

GRAVITY_M_S2 = 9.80665
AIR_DENSITY_KG_M3 = 1.225
"""Air density at sea level, international standard atmosphere."""


@dataclass(frozen=True, slots=True)
class VehicleModel:
    """Speeds and limits; the defaults are those of the PX4 v1.17 parameters for a multicopter."""

    cruise_m_s: float = 5.0  # MPC_XY_CRUISE
    speed_max_m_s: float = 12.0  # MPC_XY_VEL_MAX
    acceleration_m_s2: float = 3.0  # MPC_ACC_HOR
    jerk_m_s3: float = 4.0  # MPC_JERK_AUTO
    corner_share: float = 0.5  # MPC_XY_TRAJ_P: share of the acceleration that is used in corners
    position_p_1_s: float = 0.95  # MPC_XY_P
    position_error_max_m: float = 2.0  # MPC_XY_ERR_MAX
    velocity_p_1_s: float = 1.8  # MPC_XY_VEL_P_ACC
    velocity_i_1_s2: float = 0.4  # MPC_XY_VEL_I_ACC
    climb_acceleration_m_s2: float = 4.0  # MPC_ACC_UP_MAX
    descent_acceleration_m_s2: float = 3.0  # MPC_ACC_DOWN_MAX
    climb_m_s: float = 3.0  # MPC_Z_V_AUTO_UP
    descent_m_s: float = 1.5  # MPC_Z_V_AUTO_DN
    takeoff_m_s: float = 1.5  # MPC_TKO_SPEED
    land_m_s: float = 0.7  # MPC_LAND_SPEED
    land_fast_m: float = 10.0  # MPC_LAND_ALT1: descent_m_s applies above this height
    land_slow_m: float = 5.0  # MPC_LAND_ALT2: land_m_s applies below this height
    landing_height_m: float = LANDING_HEIGHT_M  # MPC_LAND_ALT3: targets may be this far below the ground
    spoolup_s: float = 1.0  # COM_SPOOLUP_TIME
    takeoff_ramp_s: float = 3.0  # MPC_TKO_RAMP_T
    disarm_s: float = 2.0  # COM_DISARM_LAND
    return_alt_m: float = 30.0  # RTL_RETURN_ALT
    return_cone_deg: float = 45.0  # RTL_CONE_ANG
    return_min_m: float = 10.0  # RTL_MIN_DIST: the cone applies within this distance
    return_delay_s: float = 0.0  # RTL_LAND_DELAY, below 0: the vehicle does not land
    acceptance_m: float = 2.0  # NAV_ACC_RAD
    altitude_acceptance_m: float = 0.8  # NAV_MC_ALT_RAD
    first_waypoint_max_m: float = 10_000.0  # MIS_DIST_1WP
    takeoff_land_required: int = 0  # MIS_TKO_LAND_REQ, 0: none
    fence_radius_m: float = 0.0  # GF_MAX_HOR_DIST, 0: none
    fence_height_m: float = 0.0  # GF_MAX_VER_DIST, 0: none

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, float]) -> VehicleModel:
        """The model with the vehicle's parameters. A field keeps its default if its parameter is missing or
        not finite, or if a speed, acceleration or gain is not above 0."""
        values = {
            field: parameters[name]
            for field, name in PARAMETERS.items()
            if name in parameters and math.isfinite(parameters[name])
        }
        if "takeoff_land_required" in values:
            values["takeoff_land_required"] = int(values["takeoff_land_required"])
        positive = {field for field in PARAMETERS if field.endswith(POSITIVE)}
        valid = {field: value for field, value in values.items() if field not in positive or value > 0.0}
        return cls(**valid)  # type: ignore[arg-type]


POSITIVE = ("_m_s", "_m_s2", "_m_s3", "_p_1_s", "_1_s2", "error_max_m")
"""Endings of the fields that must be above 0."""
PARAMETERS = {
    "cruise_m_s": "MPC_XY_CRUISE",
    "speed_max_m_s": "MPC_XY_VEL_MAX",
    "acceleration_m_s2": "MPC_ACC_HOR",
    "jerk_m_s3": "MPC_JERK_AUTO",
    "corner_share": "MPC_XY_TRAJ_P",
    "position_p_1_s": "MPC_XY_P",
    "position_error_max_m": "MPC_XY_ERR_MAX",
    "velocity_p_1_s": "MPC_XY_VEL_P_ACC",
    "velocity_i_1_s2": "MPC_XY_VEL_I_ACC",
    "climb_acceleration_m_s2": "MPC_ACC_UP_MAX",
    "descent_acceleration_m_s2": "MPC_ACC_DOWN_MAX",
    "climb_m_s": "MPC_Z_V_AUTO_UP",
    "descent_m_s": "MPC_Z_V_AUTO_DN",
    "takeoff_m_s": "MPC_TKO_SPEED",
    "land_m_s": "MPC_LAND_SPEED",
    "land_fast_m": "MPC_LAND_ALT1",
    "land_slow_m": "MPC_LAND_ALT2",
    "landing_height_m": "MPC_LAND_ALT3",
    "spoolup_s": "COM_SPOOLUP_TIME",
    "takeoff_ramp_s": "MPC_TKO_RAMP_T",
    "disarm_s": "COM_DISARM_LAND",
    "return_alt_m": "RTL_RETURN_ALT",
    "return_cone_deg": "RTL_CONE_ANG",
    "return_min_m": "RTL_MIN_DIST",
    "return_delay_s": "RTL_LAND_DELAY",
    "acceptance_m": "NAV_ACC_RAD",
    "altitude_acceptance_m": "NAV_MC_ALT_RAD",
    "first_waypoint_max_m": "MIS_DIST_1WP",
    "takeoff_land_required": "MIS_TKO_LAND_REQ",
    "fence_radius_m": "GF_MAX_HOR_DIST",
    "fence_height_m": "GF_MAX_VER_DIST",
}
"""The PX4 parameter of each field of `VehicleModel`."""


@dataclass(frozen=True, slots=True)
class PowerModel:
    """Constant power in flight, plus the work of climbing.

    Hover power is a good estimate up to moderate speeds: induced power decreases while drag increases.
    A climb with v m/s adds the power mass · g · v / efficiency [W]; a descent saves no energy.
    """

    hover_power_w: float
    battery_wh: float
    mass_kg: float
    efficiency: float = 0.6
    """Total efficiency of motors, controllers and propellers, 0 to 1."""
    reserve: float = 0.2
    """Fraction of the battery that is kept as reserve."""

    @property
    def usable_wh(self) -> float:
        """Energy for the flight [Wh]."""
        return self.battery_wh * (1.0 - self.reserve)

    def energy_wh(self, time_s: float, climb_m: float) -> float:
        """Energy of a flight, from its duration and total climb [Wh]."""
        climb_j = self.mass_kg * GRAVITY_M_S2 * climb_m / self.efficiency
        return (self.hover_power_w * time_s + climb_j) / 3600.0


def hover_power_w(mass_kg: float, rotor_area_m2: float, efficiency: float = 0.6) -> float:
    """Electrical power to hover [W] by momentum theory: (m g)^1.5 / sqrt(2 ρ A) / efficiency.

    `rotor_area_m2` is the swept area of all rotors. Source: J. G. Leishman, Principles of Helicopter
    Aerodynamics, section 2.2.
    """
    return (mass_kg * GRAVITY_M_S2) ** 1.5 / math.sqrt(2.0 * AIR_DENSITY_KG_M3 * rotor_area_m2) / efficiency
