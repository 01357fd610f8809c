"""What a dry run is given: the vehicle, the weather, what stands around; and how these may vary."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase

from missions.errors import PlanError
from missions.frames import Vector3
from missions.geodesy import LocalOrigin
from missions.values import HomePosition

TAKEN = (
    "BAT_*_THR", "COM_DISARM_LAND", "COM_FLT_TIME_MAX", "COM_LOW_BAT_ACT", "COM_OBL_RC_ACT", "COM_OF_LOSS_T",
    "COM_SPOOLUP_TIME", "COM_TAKEOFF_ACT", "COM_WIND_*", "GF_*", "LNDMC_*", "MIS_*", "MNT_*", "MPC_*",
    "NAV_ACC_RAD", "NAV_MC_ALT_RAD", "RTL_*",
)  # fmt: skip
"""Parameters of a real vehicle that decide how a flight goes, whatever the airframe."""
AIRFRAME_BOUND = ("MPC_THR_HOVER", "MPC_THR_MIN", "MPC_THR_MAX", "MPC_USE_HTE")
"""Of these, what was tuned on the real airframe and does not fit the simulated one."""
TAKEN_OF_SIMULATED = (*TAKEN, "CA_ROTOR*", "EKF2_*", "IMU_*", "MC_*", "SIH_*", "SIM_BAT_*")
"""Of a vehicle that is simulated itself."""
WIND_MAX_M_S = 40.0


@dataclass(frozen=True, slots=True)
class Aircraft:
    """The vehicle that flies, as far as known."""

    home: HomePosition
    """Where it stands; the local origin of all results."""
    yaw_ned_rad: float = 0.0
    parameters: Mapping[str, float] = field(default_factory=dict[str, float])
    """PX4's names; those that fit the simulated vehicle are taken over (`parameters_taken`)."""
    battery_share: float = 1.0
    """At the start, 0 to 1."""
    endurance_s: float | None = None
    """Hovering from full to empty; None: as the simulated battery's parameters say, where it has them."""
    battery_reserve: float = 0.2
    """Share of the battery that is to be left after the flight."""

    @property
    def origin(self) -> LocalOrigin:
        """Of the local frame."""
        return LocalOrigin(self.home.lat_deg, self.home.lon_deg, self.home.alt_amsl_m)

    @property
    def is_simulated(self) -> bool:
        """Whether the parameters are those of a simulated vehicle."""
        return "SIH_MASS" in self.parameters

    @property
    def battery_is_known(self) -> bool:
        """Whether anything says how fast the battery drains."""
        return self.endurance_s is not None or "SIM_BAT_DRAIN" in self.parameters

    def parameters_taken(self) -> dict[str, float]:
        """Those that the simulated vehicle flies with."""
        patterns = TAKEN_OF_SIMULATED if self.is_simulated else TAKEN
        return {
            name: value
            for name, value in self.parameters.items()
            if math.isfinite(value)
            and any(fnmatchcase(name, pattern) for pattern in patterns)
            and (self.is_simulated or name not in AIRFRAME_BOUND)
        }


@dataclass(frozen=True, slots=True)
class Conditions:
    """What one flight meets."""

    wind_ned_m_s: Vector3 = (0.0, 0.0, 0.0)
    """Where the air moves to."""
    gusts_m_s: float = 0.0
    """One sigma of each horizontal axis."""
    mass_scale: float = 1.0
    """Of the vehicle's mass."""
    battery_scale: float = 1.0
    """Of the battery's capacity."""
    sensor_noise: float = 1.0
    """Times the noise of PX4's own simulation."""

    def __post_init__(self) -> None:
        """Refuses what cannot be flown.

        Raises:
            PlanError: names the value and its bounds.
        """
        bounds = {
            "wind_ned_m_s": (math.hypot(*self.wind_ned_m_s), 0.0, WIND_MAX_M_S),
            "gusts_m_s": (self.gusts_m_s, 0.0, 20.0),
            "mass_scale": (self.mass_scale, 0.3, 3.0),
            "battery_scale": (self.battery_scale, 0.05, 3.0),
            "sensor_noise": (self.sensor_noise, 0.0, 10.0),
        }
        for name, (value, low, high) in bounds.items():
            if not low <= value <= high:
                reason = f"{value:g} is not between {low:g} and {high:g}"
                raise PlanError(f"conditions, {name}", reason, "Give a value between these.")


@dataclass(frozen=True, slots=True)
class Obstacle:
    """An upright box; north and east of home, heights above home."""

    name: str
    north_m: float
    east_m: float
    """Of its centre."""
    length_m: float
    """Along its own x axis: north where yaw is 0."""
    width_m: float
    height_m: float
    base_alt_home_m: float = 0.0
    yaw_ned_rad: float = 0.0
