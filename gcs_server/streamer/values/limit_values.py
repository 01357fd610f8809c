"""The vehicle's own limits, from its parameters, the operator's limits, set over the API, and both combined
in the vehicle's local frame."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from gcs_server.vehicle.samples import Home
from missions.fence import Circle, CircleFence, Fence, Polygon, Region
from missions.frames import Vector3
from missions.geodesy import LocalOrigin

LIMIT_PARAMETERS = {
    "speed_max_m_s": "MPC_XY_VEL_MAX",
    "climb_max_m_s": "MPC_Z_VEL_MAX_UP",
    "sink_max_m_s": "MPC_Z_VEL_MAX_DN",
    "tilt_max_rad": "MPC_TILTMAX_AIR",
    "acceleration_max_m_s2": "MPC_ACC_HOR_MAX",
    "acceleration_up_max_m_s2": "MPC_ACC_UP_MAX",
    "acceleration_down_max_m_s2": "MPC_ACC_DOWN_MAX",
    "hover_thrust": "MPC_THR_HOVER",
    "roll_rate_max_rad_s": "MC_ROLLRATE_MAX",
    "pitch_rate_max_rad_s": "MC_PITCHRATE_MAX",
    "yaw_rate_max_rad_s": "MC_YAWRATE_MAX",
    "distance_max_m": "GF_MAX_HOR_DIST",
    "height_max_m": "GF_MAX_VER_DIST",
}
"""The parameter of each of the vehicle's limits. PX4 has angles and turning rates in degrees."""
VEHICLE_PARAMETERS = (*LIMIT_PARAMETERS.values(), "MPC_XY_P", "MPC_Z_P")


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

    def limit(name: str) -> float | None:
        value = values.get(LIMIT_PARAMETERS[name])
        if value is None or (name in ("distance_max_m", "height_max_m") and value < MIN_FENCE_M):
            return None
        return math.radians(value) if name.endswith(("_rad", "_rad_s")) else value

    return VehicleLimits(**{name: limit(name) for name in LIMIT_PARAMETERS})


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


INF = math.inf
UNLIMITED_REGION = Region()
DEFAULT_POSITION_GAIN = 0.95
"""Default of MPC_XY_P: PX4's approach speed per metre of distance [1/s]."""
DEFAULT_VERTICAL_GAIN = 1.0
"""Default of MPC_Z_P [1/s]."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """Combined limits; infinite means not limited."""

    speed_m_s: float = INF
    climb_m_s: float = INF
    descent_m_s: float = INF
    tilt_rad: float = INF
    acceleration_m_s2: float = INF
    acceleration_up_m_s2: float = INF
    acceleration_down_m_s2: float = INF
    rates_rad_s: Vector3 = (INF, INF, INF)
    slew_velocity_m_s2: float = INF
    slew_attitude_rad_s: float = INF
    approach_m_s: float = INF
    """Maximum speed towards a target position, from the operator's limit; PX4 applies its own limit
    itself."""
    approach_climb_m_s: float = INF
    approach_descent_m_s: float = INF
    position_gain: float = DEFAULT_POSITION_GAIN
    vertical_gain: float = DEFAULT_VERTICAL_GAIN
    obstacle_brake: bool = True
    """Whether the vehicle is stopped before obstacles that its sensors measure."""
    region: Region = UNLIMITED_REGION
    origin: LocalOrigin | None = None
    enforcement_problem: str | None = None
    """Why the operator's position limits cannot be applied now; None if they can be applied."""

    @property
    def depends_on_position(self) -> bool:
        """Whether the limited setpoint depends on the vehicle's position or on the last sent setpoint."""
        region = self.region
        return (
            region.is_limited_horizontally
            or region.is_limited_vertically
            or min(self.approach_m_s, self.approach_climb_m_s, self.approach_descent_m_s) < INF
            or min(self.slew_velocity_m_s2, self.slew_attitude_rad_s) < INF
        )


UNBOUNDED = Bounds()


def bounds_of(
    vehicle: VehicleLimits,
    operator: OperatorLimits,
    home: Home | None,
    origin: LocalOrigin | None,
    gains: tuple[float | None, float | None] = (None, None),
) -> Bounds:
    """Combines both limits; the stricter one of each pair applies.

    Args:
        vehicle: limits from the vehicle's parameters.
        operator: limits set over the API.
        home: reference of altitude and distance limits.
        origin: origin of the local frame, for a fence in latitude and longitude.
        gains: MPC_XY_P and MPC_Z_P, if known.
    """
    region, enforcement_problem = _region(vehicle, operator, home, origin)
    return Bounds(
        speed_m_s=_strictest(vehicle.speed_max_m_s, operator.speed_max_m_s),
        climb_m_s=_strictest(vehicle.climb_max_m_s, operator.climb_max_m_s),
        descent_m_s=_strictest(vehicle.sink_max_m_s, operator.sink_max_m_s),
        tilt_rad=_strictest(vehicle.tilt_max_rad, operator.tilt_max_rad),
        acceleration_m_s2=_strictest(vehicle.acceleration_max_m_s2),
        acceleration_up_m_s2=_strictest(vehicle.acceleration_up_max_m_s2),
        acceleration_down_m_s2=_strictest(vehicle.acceleration_down_max_m_s2),
        rates_rad_s=(
            _strictest(vehicle.roll_rate_max_rad_s),
            _strictest(vehicle.pitch_rate_max_rad_s),
            _strictest(vehicle.yaw_rate_max_rad_s),
        ),
        slew_velocity_m_s2=_strictest(operator.slew_velocity_m_s2),
        slew_attitude_rad_s=_strictest(operator.slew_attitude_rad_s),
        approach_m_s=_strictest(operator.speed_max_m_s),
        approach_climb_m_s=_strictest(operator.climb_max_m_s),
        approach_descent_m_s=_strictest(operator.sink_max_m_s),
        position_gain=gains[0] or DEFAULT_POSITION_GAIN,
        vertical_gain=gains[1] or DEFAULT_VERTICAL_GAIN,
        obstacle_brake=operator.obstacle_brake,
        region=region,
        origin=origin,
        enforcement_problem=enforcement_problem,
    )


def _strictest(*limits: float | None) -> float:
    return min((limit for limit in limits if limit is not None), default=INF)


def _region(
    vehicle: VehicleLimits, operator: OperatorLimits, home: Home | None, origin: LocalOrigin | None
) -> tuple[Region, str | None]:
    circles: list[Circle] = []
    polygons: list[Polygon] = []
    down_min_m, down_max_m = -INF, INF
    enforcement_problem = None
    altitude_limits_m = (vehicle.height_max_m, operator.height_max_m, operator.height_min_m)
    distance_limits_m = (vehicle.distance_max_m, operator.distance_max_m)
    if any(limit is not None for limit in (*altitude_limits_m, *distance_limits_m)):
        home_ned = _home_ned(home, origin)
        if home_ned is None:
            enforcement_problem = (
                "there is no home position, from which altitude and distance limits are measured"
            )
        else:
            down_min_m = home_ned[2] - _strictest(vehicle.height_max_m, operator.height_max_m)
            if operator.height_min_m is not None:
                down_max_m = home_ned[2] - operator.height_min_m
            for radius_m, owner_text in zip(
                distance_limits_m, ("the vehicle's", "the operator's"), strict=True
            ):
                if radius_m is not None:
                    name = f"{owner_text} limit of {radius_m:g} m from home"
                    circles.append(Circle((home_ned[0], home_ned[1]), radius_m, name))
    fence = operator.fence
    if fence is not None:
        if origin is None:
            enforcement_problem = "there is no valid global position, which a geofence needs"
        elif isinstance(fence, CircleFence):
            circles.append(fence.to_local(origin, "the operator's geofence"))
        else:
            polygons.append(fence.to_local(origin, "the operator's geofence"))
    return Region(down_min_m, down_max_m, tuple(circles), tuple(polygons)), enforcement_problem


def _home_ned(home: Home | None, origin: LocalOrigin | None) -> Vector3 | None:
    if home is None:
        return None
    if home.position_ned_m is not None:
        return home.position_ned_m
    return None if origin is None else origin.to_ned(home.lat_deg, home.lon_deg, home.alt_amsl_m)
