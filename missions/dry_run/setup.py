"""Inputs of a dry run: vehicle, wind and other conditions, ground and obstacles."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase

import numpy as np
from numpy.typing import NDArray

from missions.errors import PlanError
from missions.frames import Vector3
from missions.geodesy import LocalOrigin
from missions.obstacles import corners_ne_m, obstacle_name
from missions.values import HomePosition
from missions.values import Obstacle as PlannedObstacle

SIMULATED_PX4 = ((1, 16), (1, 17))
"""Releases of PX4 that can be simulated, oldest first."""
DEFAULT_PX4 = SIMULATED_PX4[-1]
"""The release that is simulated without a vehicle, and for one whose release is not known."""
USED_PARAMETERS = (
    "BAT_*_THR", "COM_DISARM_LAND", "COM_FLTT_LOW_ACT", "COM_FLT_TIME_MAX", "COM_LOW_BAT_ACT",
    "COM_OBL_RC_ACT", "COM_OF_LOSS_T", "COM_SPOOLUP_TIME", "COM_TAKEOFF_ACT", "COM_WIND_*", "GF_*",
    "LNDMC_*", "MIS_*", "MNT_*", "MPC_*", "NAV_ACC_RAD", "NAV_MC_ALT_RAD", "NAV_RCL_ACT", "RTL_*",
)  # fmt: skip
"""Parameters of a real vehicle that the simulated vehicle uses: they affect the flight and do not depend on
the airframe."""
AIRFRAME_SPECIFIC = ("MPC_THR_HOVER", "MPC_THR_MIN", "MPC_THR_MAX", "MPC_USE_HTE")
"""Parameters in USED_PARAMETERS that are ignored, because they are tuned for the real airframe."""
USED_PARAMETERS_OF_SIMULATED = (
    *USED_PARAMETERS,
    "CA_ROTOR*",
    "EKF2_*",
    "IMU_*",
    "MC_*",
    "SIH_*",
    "SIM_BAT_*",
)
"""Parameters that are used if the vehicle to simulate is itself a simulated vehicle."""
WIND_MAX_M_S = 40.0


def simulated_release(release: tuple[int, int] | None) -> tuple[int, int]:
    """The release that is simulated for a vehicle with this one: the same or the nearest."""
    return DEFAULT_PX4 if release is None else min(max(release, SIMULATED_PX4[0]), SIMULATED_PX4[-1])


def release_name(release: tuple[int, int]) -> str:
    """A release without the `v`: `1.17`."""
    return f"{release[0]}.{release[1]}"


@dataclass(frozen=True, slots=True)
class Aircraft:
    """The vehicle to simulate."""

    home: HomePosition
    """Start position; the local origin of all results."""
    yaw_ned_rad: float = 0.0
    parameters: Mapping[str, float] = field(default_factory=dict[str, float])
    """Parameters by PX4 name; `simulated_parameters` selects those that the simulated vehicle uses."""
    body: Mapping[str, float] = field(default_factory=dict[str, float])
    """Parameters of the body (SIH_*) that were identified in a flight; they come before all others."""
    battery_share: float = 1.0
    """Battery charge at the start, 0 to 1."""
    endurance_s: float | None = None
    """Hover time from full to empty [s]; None: the value of SIM_BAT_DRAIN, if the vehicle has this
    parameter."""
    battery_reserve: float = 0.2
    """Battery charge that must remain after the flight, 0 to 1."""
    px4: str = release_name(DEFAULT_PX4)
    """Release of PX4 to simulate, as `release_name` gives it: its defaults, failsafes and home."""

    @property
    def origin(self) -> LocalOrigin:
        """Origin of the local frame."""
        return LocalOrigin(self.home.lat_deg, self.home.lon_deg, self.home.alt_amsl_m)

    @property
    def is_simulated(self) -> bool:
        """Whether the parameters are those of a simulated vehicle."""
        return "SIH_MASS" in self.parameters

    @property
    def battery_is_known(self) -> bool:
        """Whether the battery's discharge rate is known."""
        return self.endurance_s is not None or "SIM_BAT_DRAIN" in self.parameters

    def simulated_parameters(self) -> dict[str, float]:
        """The parameters that the simulated vehicle uses."""
        patterns = USED_PARAMETERS_OF_SIMULATED if self.is_simulated else USED_PARAMETERS
        used = {
            name: value
            for name, value in self.parameters.items()
            if math.isfinite(value)
            and any(fnmatchcase(name, pattern) for pattern in patterns)
            and (self.is_simulated or name not in AIRFRAME_SPECIFIC)
        }
        return used | dict(self.body)


@dataclass(frozen=True, slots=True)
class Conditions:
    """Conditions of one flight."""

    wind_ned_m_s: Vector3 = (0.0, 0.0, 0.0)
    """Steady wind as the velocity of the air [m/s]."""
    gusts_m_s: float = 0.0
    """Standard deviation of the gusts on each horizontal axis [m/s]."""
    mass_scale: float = 1.0
    """Factor on the vehicle's mass."""
    battery_scale: float = 1.0
    """Factor on the battery's capacity."""
    sensor_noise: float = 1.0
    """Factor on the sensor noise of PX4's own simulation."""

    def __post_init__(self) -> None:
        """Checks the bounds of each value.

        Raises:
            PlanError: a value is out of bounds; the error names the value and its bounds.
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
    """An upright box; position relative to home."""

    name: str
    north_m: float
    east_m: float
    """North and east of the centre."""
    length_m: float
    """Length along the box's x axis, which points north at yaw 0 [m]."""
    width_m: float
    height_m: float
    base_alt_home_m: float = 0.0
    yaw_ned_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class Prism:
    """An upright prism that stands on the ground; position relative to home."""

    name: str
    corners_ne_m: tuple[tuple[float, float], ...]
    """North and east of the corners; the last one joins the first."""
    top_alt_home_m: float


AnyObstacle = Obstacle | Prism


def prisms_of(obstacles: Sequence[PlannedObstacle], home: HomePosition) -> list[Prism]:
    """The obstacles of a plan or mission, relative to the start position of the (first) vehicle."""
    origin = LocalOrigin(home.lat_deg, home.lon_deg, home.alt_amsl_m)
    return [
        Prism(obstacle_name(each, index), corners_ne_m(each, origin), _top_alt_home_m(each, home))
        for index, each in enumerate(obstacles)
    ]


def _top_alt_home_m(obstacle: PlannedObstacle, home: HomePosition) -> float:
    top = obstacle.top
    return top.value_m if top.reference == "home" else top.value_m - home.alt_amsl_m


@dataclass(frozen=True, slots=True, eq=False)
class GroundGrid:
    """Altitudes of the ground on a square grid. Outside the grid, the altitude of the nearest border point
    applies."""

    north_m: float
    """Position of the south-west corner from home."""
    east_m: float
    spacing_m: float
    altitudes_home_m: NDArray[np.float64]
    """(rows to the north, columns to the east) altitude of the ground above home; at least 2 x 2."""

    def altitude_home_m(
        self, north_m: NDArray[np.float64], east_m: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(N,) altitudes of the ground above home at positions (N,), interpolated between four grid
        points."""
        altitudes = self.altitudes_home_m
        row = np.clip((north_m - self.north_m) / self.spacing_m, 0.0, altitudes.shape[0] - 1.0)
        column = np.clip((east_m - self.east_m) / self.spacing_m, 0.0, altitudes.shape[1] - 1.0)
        r = np.minimum(row.astype(np.intp), altitudes.shape[0] - 2)
        c = np.minimum(column.astype(np.intp), altitudes.shape[1] - 2)
        v, u = row - r, column - c
        south = altitudes[r, c] * (1.0 - u) + altitudes[r, c + 1] * u
        north = altitudes[r + 1, c] * (1.0 - u) + altitudes[r + 1, c + 1] * u
        return south * (1.0 - v) + north * v


@dataclass(frozen=True, slots=True)
class Site:
    """Obstacles and ground around the start."""

    obstacles: Sequence[AnyObstacle] = ()
    ground: GroundGrid | None = None
    """None: level ground."""

    @property
    def is_empty(self) -> bool:
        """Whether the ground is level and has no obstacles."""
        return not self.obstacles and self.ground is None


LEVEL_SITE = Site()
"""Level ground without obstacles."""
