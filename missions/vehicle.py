"""What a plan is judged and timed by: the vehicle's speeds and limits, and its power."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

GRAVITY_M_S2 = 9.80665
AIR_DENSITY_KG_M3 = 1.225
"""ISA, sea level."""


@dataclass(frozen=True, slots=True)
class VehicleModel:
    """Speeds and limits; the defaults are those of PX4 v1.16 for a multicopter (parameter names beside)."""

    cruise_m_s: float = 5.0  # MPC_XY_CRUISE
    speed_max_m_s: float = 12.0  # MPC_XY_VEL_MAX
    acceleration_m_s2: float = 3.0  # MPC_ACC_HOR
    climb_m_s: float = 3.0  # MPC_Z_V_AUTO_UP
    descent_m_s: float = 1.5  # MPC_Z_V_AUTO_DN
    takeoff_m_s: float = 1.5  # MPC_TKO_SPEED
    land_m_s: float = 0.7  # MPC_LAND_SPEED
    land_slow_m: float = 5.0  # MPC_LAND_ALT2: below this height it descends at land_m_s
    return_alt_m: float = 30.0  # RTL_RETURN_ALT
    acceptance_m: float = 2.0  # NAV_ACC_RAD
    altitude_acceptance_m: float = 0.8  # NAV_MC_ALT_RAD
    first_waypoint_max_m: float = 10_000.0  # MIS_DIST_1WP
    required_ends: int = 0  # MIS_TKO_LAND_REQ
    fence_radius_m: float = 0.0  # GF_MAX_HOR_DIST, 0: none
    fence_height_m: float = 0.0  # GF_MAX_VER_DIST, 0: none

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, float]) -> VehicleModel:
        """With the vehicle's own values, where it has them and they are finite."""
        found = {
            field: parameters[name]
            for field, name in PARAMETERS.items()
            if name in parameters and math.isfinite(parameters[name])
        }
        if "required_ends" in found:
            found["required_ends"] = int(found["required_ends"])
        positive = {name for name in PARAMETERS if name.endswith(("_m_s", "_m_s2"))}
        return cls(**{name: value for name, value in found.items() if name not in positive or value > 0.0})  # type: ignore[arg-type]


PARAMETERS = {
    "cruise_m_s": "MPC_XY_CRUISE",
    "speed_max_m_s": "MPC_XY_VEL_MAX",
    "acceleration_m_s2": "MPC_ACC_HOR",
    "climb_m_s": "MPC_Z_V_AUTO_UP",
    "descent_m_s": "MPC_Z_V_AUTO_DN",
    "takeoff_m_s": "MPC_TKO_SPEED",
    "land_m_s": "MPC_LAND_SPEED",
    "land_slow_m": "MPC_LAND_ALT2",
    "return_alt_m": "RTL_RETURN_ALT",
    "acceptance_m": "NAV_ACC_RAD",
    "altitude_acceptance_m": "NAV_MC_ALT_RAD",
    "first_waypoint_max_m": "MIS_DIST_1WP",
    "required_ends": "MIS_TKO_LAND_REQ",
    "fence_radius_m": "GF_MAX_HOR_DIST",
    "fence_height_m": "GF_MAX_VER_DIST",
}
"""The PX4 parameter of each field of `VehicleModel`."""


@dataclass(frozen=True, slots=True)
class PowerModel:
    """Constant power in flight, and the work of climbing.

    Hover power is a fair bound up to moderate speeds, where induced power falls and drag rises. Climbing at v
    adds mass · g · v / efficiency; descending saves nothing.
    """

    hover_power_w: float
    battery_wh: float
    mass_kg: float
    efficiency: float = 0.6
    """Of motors, controllers and propellers together, 0 to 1."""
    reserve: float = 0.2
    """Share of the battery that stays for the unexpected."""

    @property
    def usable_wh(self) -> float:
        """Energy for the flight [Wh]."""
        return self.battery_wh * (1.0 - self.reserve)

    def energy_wh(self, time_s: float, climb_m: float) -> float:
        """Energy of a flight of this duration that climbs so many metres in all [Wh]."""
        climb_j = self.mass_kg * GRAVITY_M_S2 * climb_m / self.efficiency
        return (self.hover_power_w * time_s + climb_j) / 3600.0


def hover_power_w(mass_kg: float, rotor_area_m2: float, efficiency: float = 0.6) -> float:
    """Electrical power to hover [W] by momentum theory: (m g)^1.5 / sqrt(2 ρ A) / efficiency.

    `rotor_area_m2` is the swept area of all rotors. Source: J. G. Leishman, Principles of Helicopter
    Aerodynamics, section 2.2.
    """
    return (mass_kg * GRAVITY_M_S2) ** 1.5 / math.sqrt(2.0 * AIR_DENSITY_KG_M3 * rotor_area_m2) / efficiency
