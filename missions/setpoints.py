"""Offboard setpoints, one frozen class for each kind, independent of the protocol that carries them.

A class is also the kind's JSON in the API: the annotations have the limits for clients, and the docstrings of
the attributes are their descriptions (`gcs_server/api/setpoints.py`).

Field names contain quantity, frame and unit. NED is relative to the vehicle's local origin. FRD is the body
frame; in kinds whose name ends in `_body`, FRD is the level heading frame. None means "not controlled" (an
ignore bit in MAVLink, NaN in PX4). If several quantities are given, PX4 controls the first one in the order
position, velocity, acceleration; the others are feed-forward. Without yaw and yaw rate the vehicle keeps its
heading.

`type` is the name of a kind in the API, on the page and in plans. `needs` are the estimates that a kind
requires, in PX4 or for the conversion to a `DirectSetpoint`.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, get_args

from annotated_types import Interval, Len

from missions.frames import Quaternion, Vector3

Partial3 = tuple[float | None, float | None, float | None]
"""A vector in which each axis may be left uncontrolled."""
UNCONTROLLED: Partial3 = (None, None, None)
FOLLOW_MIN_DISTANCE_M = 2.0
DEVICE_MIN_DISTANCE_M = 5.0
"""Smallest horizontal distance to a device that is followed: somebody carries it [m]."""
Estimate = Literal["position", "velocity", "heading", "global_position", "home"]
"""An estimate that the vehicle must have."""

Metres = Annotated[float, Interval(ge=-10_000, le=10_000)]
MetresPerSecond = Annotated[float, Interval(ge=-20, le=20)]
MetresPerSecond2 = Annotated[float, Interval(ge=-20, le=20)]
RadiansPerSecond = Annotated[float, Interval(ge=-10, le=10)]
YawRate = Annotated[float, Interval(ge=-3.5, le=3.5)]
Angle = Annotated[float, Interval(ge=-2 * math.pi, le=2 * math.pi)]
Normalized = Annotated[float, Interval(ge=-1, le=1)]
Metres3 = tuple[Metres, Metres, Metres]
PartialPosition = tuple[Metres | None, Metres | None, Metres | None]
PartialVelocity = tuple[MetresPerSecond | None, MetresPerSecond | None, MetresPerSecond | None]
PartialAcceleration = tuple[MetresPerSecond2 | None, MetresPerSecond2 | None, MetresPerSecond2 | None]


def _json(**example: object) -> dict[str, Any]:
    """Pydantic's settings for the JSON of a kind, with an example of its fields."""
    config: dict[str, Any] = {"extra": "forbid"}
    return config | ({"json_schema_extra": {"examples": [example]}} if example else {})


@dataclass(frozen=True, slots=True)
class Position:
    """A position in the vehicle's local frame."""

    __pydantic_config__: ClassVar = _json(type="position", position_ned_m=[0, 0, -10])
    type: ClassVar[str] = "position"
    needs: ClassVar[tuple[Estimate, ...]] = ("position", "velocity")
    position_ned_m: PartialPosition
    """North, east, down of the vehicle's local origin [m]; down is negative above the origin."""
    yaw_ned_rad: Angle | None = None
    """Heading clockwise from north [rad]; without yaw and yaw rate, the vehicle keeps its heading."""
    yaw_rate_ned_rad_s: YawRate | None = None
    """Turning rate, clockwise [rad/s]."""


@dataclass(frozen=True, slots=True)
class PositionGlobal:
    """A global position; exactly one of the two altitudes."""

    __pydantic_config__: ClassVar = _json(
        type="position_global", lat_deg=47.3979, lon_deg=8.5458, alt_home_m=12
    )
    type: ClassVar[str] = "position_global"
    needs: ClassVar[tuple[Estimate, ...]] = ("position", "velocity", "global_position")
    lat_deg: Annotated[float, Interval(ge=-90, le=90)]
    """Degrees north, WGS 84."""
    lon_deg: Annotated[float, Interval(ge=-180, le=180)]
    """Degrees east, WGS 84."""
    alt_amsl_m: Annotated[float, Interval(ge=-500, le=10_000)] | None = None
    """Above mean sea level [m]."""
    alt_home_m: Annotated[float, Interval(ge=-100, le=1000)] | None = None
    """Above home [m]."""
    yaw_ned_rad: Angle | None = None
    """Heading clockwise from north [rad]; without yaw and yaw rate, the vehicle keeps its heading."""
    yaw_rate_ned_rad_s: YawRate | None = None
    """Turning rate, clockwise [rad/s]."""


@dataclass(frozen=True, slots=True)
class PositionBody:
    """An offset from the vehicle's position along its heading, at the time when the server accepts the
    setpoint.
    """

    __pydantic_config__: ClassVar = _json(type="position_body", offset_frd_m=[5, 0, 0])
    type: ClassVar[str] = "position_body"
    needs: ClassVar[tuple[Estimate, ...]] = ("position", "velocity", "heading")
    offset_frd_m: Metres3
    """Forward, right, down of the heading, level [m]."""
    yaw_offset_rad: Angle | None = None
    """Yaw offset, clockwise [rad]; default: keep the heading."""


@dataclass(frozen=True, slots=True)
class Velocity:
    """A velocity in the vehicle's local frame."""

    __pydantic_config__: ClassVar = _json(type="velocity", velocity_ned_m_s=[1, 0, 0])
    type: ClassVar[str] = "velocity"
    needs: ClassVar[tuple[Estimate, ...]] = ("velocity",)
    velocity_ned_m_s: PartialVelocity
    """North, east, down [m/s]; each at most 20."""
    yaw_ned_rad: Angle | None = None
    """Heading clockwise from north [rad]; without yaw and yaw rate, the vehicle keeps its heading."""
    yaw_rate_ned_rad_s: YawRate | None = None
    """Turning rate, clockwise [rad/s]."""


@dataclass(frozen=True, slots=True)
class VelocityBody:
    """A velocity in the level heading frame, which turns with the vehicle."""

    __pydantic_config__: ClassVar = _json(
        type="velocity_body", velocity_frd_m_s=[1, 0, 0], yaw_rate_ned_rad_s=0.2
    )
    type: ClassVar[str] = "velocity_body"
    needs: ClassVar[tuple[Estimate, ...]] = ("velocity", "heading")
    velocity_frd_m_s: tuple[MetresPerSecond, MetresPerSecond, MetresPerSecond]
    """Forward, right, down of the heading [m/s]; each at most 20."""
    yaw_ned_rad: Angle | None = None
    """Heading clockwise from north [rad]; without yaw and yaw rate, the vehicle keeps its heading."""
    yaw_rate_ned_rad_s: YawRate | None = None
    """Turning rate, clockwise [rad/s]."""


@dataclass(frozen=True, slots=True)
class Acceleration:
    """An acceleration in the vehicle's local frame, without compensation of drag; at zero the vehicle does
    not keep its position."""

    # PX4 tilts the vehicle accordingly: it approaches the velocity at which drag equals the acceleration.
    __pydantic_config__: ClassVar = _json(type="acceleration", acceleration_ned_m_s2=[0.5, 0, 0])
    type: ClassVar[str] = "acceleration"
    needs: ClassVar[tuple[Estimate, ...]] = ("velocity",)
    acceleration_ned_m_s2: PartialAcceleration
    """North, east, down [m/s²], without gravity; each at most 20."""
    yaw_ned_rad: Angle | None = None
    """Heading clockwise from north [rad]; without yaw and yaw rate, the vehicle keeps its heading."""
    yaw_rate_ned_rad_s: YawRate | None = None
    """Turning rate, clockwise [rad/s]."""


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Position, velocity and acceleration. On each axis at least one is required: the vehicle controls the
    first of them that is given, and the others are feed-forward. Give north and east together, or neither.
    """

    __pydantic_config__: ClassVar = _json(
        type="trajectory", position_ned_m=[5, 0, -10], velocity_ned_m_s=[1, 0, 0], yaw_ned_rad=0
    )
    type: ClassVar[str] = "trajectory"
    needs: ClassVar[tuple[Estimate, ...]] = ("position", "velocity")
    position_ned_m: PartialPosition = UNCONTROLLED
    """North, east, down of the vehicle's local origin [m]; down is negative above it. null: uncontrolled."""
    velocity_ned_m_s: PartialVelocity = UNCONTROLLED
    """North, east, down [m/s]; each at most 20. null: not controlled."""
    acceleration_ned_m_s2: PartialAcceleration = UNCONTROLLED
    """North, east, down [m/s²], without gravity; each at most 20. null: not controlled."""
    yaw_ned_rad: Angle | None = None
    """Heading clockwise from north [rad]; without yaw and yaw rate, the vehicle keeps its heading."""
    yaw_rate_ned_rad_s: YawRate | None = None
    """Turning rate, clockwise [rad/s]."""


@dataclass(frozen=True, slots=True)
class Attitude:
    """An attitude with the collective thrust; in the API also as roll, pitch, yaw (`AttitudeSetpoint`)."""

    type: ClassVar[str] = "attitude"
    needs: ClassVar[tuple[Estimate, ...]] = ("heading",)
    q_ned_frd: Quaternion
    thrust: float
    """0 to 1, along the body's up axis."""
    yaw_rate_ned_rad_s: float | None = None
    """Yaw rate feed-forward about the vertical axis (PX4's `yaw_sp_move_rate`)."""


@dataclass(frozen=True, slots=True)
class Rates:
    """Body rates with thrust; the vehicle does not level itself."""

    __pydantic_config__: ClassVar = _json(type="rates", rates_frd_rad_s=[0, 0, 0.5], thrust=0.5)
    type: ClassVar[str] = "rates"
    needs: ClassVar[tuple[Estimate, ...]] = ("heading",)
    rates_frd_rad_s: tuple[RadiansPerSecond, RadiansPerSecond, RadiansPerSecond]
    """Roll, pitch, yaw rate [rad/s]."""
    thrust: Annotated[float, Interval(ge=0, le=1)]
    """Total thrust, 0 to 1, along the body's up axis."""


@dataclass(frozen=True, slots=True)
class ThrustTorque:
    """Body thrust and torque, which bypass all controllers; not possible over MAVLink."""

    __pydantic_config__: ClassVar = _json(type="thrust_torque", thrust_frd=[0, 0, -0.5], torque_frd=[0, 0, 0])
    type: ClassVar[str] = "thrust_torque"
    needs: ClassVar[tuple[Estimate, ...]] = ()
    thrust_frd: tuple[Normalized, Normalized, Normalized]
    """Forward, right, down, each -1 to 1."""
    torque_frd: tuple[Normalized, Normalized, Normalized]
    """Roll, pitch, yaw, each -1 to 1."""


@dataclass(frozen=True, slots=True)
class Actuators:
    """Individual motor and servo values; not possible over MAVLink."""

    __pydantic_config__: ClassVar = _json(type="actuators", motors=[0.5, 0.5, 0.5, 0.5])
    type: ClassVar[str] = "actuators"
    needs: ClassVar[tuple[Estimate, ...]] = ()
    motors: Annotated[tuple[Normalized | None, ...], Len(0, 12)] = ()
    """Each -1 to 1; null is disarmed."""
    servos: Annotated[tuple[Normalized | None, ...], Len(0, 8)] = ()
    """Each -1 to 1; null is disarmed."""


@dataclass(frozen=True, slots=True)
class PathPoint:
    """A position at a time."""

    __pydantic_config__: ClassVar = _json()
    t_s: Annotated[float, Interval(ge=0, le=3600)]
    """Time since the start of the path [s]."""
    position_ned_m: Metres3
    """North, east, down of the vehicle's local origin [m]; down is negative above the origin."""
    yaw_ned_rad: Angle | None = None
    """Heading clockwise from north [rad]; given for all points or for none."""


@dataclass(frozen=True, slots=True)
class Path:
    """A smooth curve through points in time, flown by the server even if its client disconnects.

    The first point must be within 5 m of the vehicle's position, and its `t_s` must be 0.
    `valid_for_s` starts at the end of the path.
    """

    __pydantic_config__: ClassVar = _json(
        type="path",
        points=[
            {"t_s": 0, "position_ned_m": [0, 0, -10]},
            {"t_s": 5, "position_ned_m": [10, 0, -10]},
            {"t_s": 10, "position_ned_m": [10, 10, -10]},
        ],
    )
    type: ClassVar[str] = "path"
    needs: ClassVar[tuple[Estimate, ...]] = ("position", "velocity")
    points: Annotated[tuple[PathPoint, ...], Len(2, 5000)]
    """Points in the order of their times; the vehicle keeps the position of the last point."""

    @property
    def duration_s(self) -> float:
        """Time from the first point to the last."""
        return self.points[-1].t_s


@dataclass(frozen=True, slots=True)
class Follow:
    """A position that moves with another vehicle; exactly one offset, at least 2 m long."""

    __pydantic_config__: ClassVar = _json(type="follow", vehicle="2", offset_frd_m=[-5, 0, -2], yaw="same")
    type: ClassVar[str] = "follow"
    needs: ClassVar[tuple[Estimate, ...]] = ("position", "velocity", "global_position")
    vehicle: Annotated[str, Len(1, 32)]
    """Id of the vehicle to follow."""
    offset_ned_m: Metres3 | None = None
    """Offset north, east, down of that vehicle [m]."""
    offset_frd_m: Metres3 | None = None
    """Offset forward, right, down along that vehicle's heading, level [m]."""
    yaw: Literal["keep", "same", "face"] = "keep"
    """keep: the present heading; same: the followed vehicle's heading; face: towards the followed vehicle."""


@dataclass(frozen=True, slots=True)
class FollowDevice:
    """A position beside a device that reports its own position, such as a phone; each newer position is a new
    setpoint. The offset is at least 5 m long, and the height is above home: that of such devices is too
    inaccurate.
    """

    __pydantic_config__: ClassVar = _json(
        type="follow_device",
        lat_deg=47.3979,
        lon_deg=8.5458,
        accuracy_m=6,
        age_s=0.4,
        offset_ne_m=[0, -15],
        alt_home_m=12,
        yaw="face",
    )
    type: ClassVar[str] = "follow_device"
    needs: ClassVar[tuple[Estimate, ...]] = ("position", "velocity", "global_position", "home")
    lat_deg: Annotated[float, Interval(ge=-90, le=90)]
    """Position of the device: degrees north, WGS 84."""
    lon_deg: Annotated[float, Interval(ge=-180, le=180)]
    """Degrees east, WGS 84."""
    accuracy_m: Annotated[float, Interval(ge=0, le=100_000)]
    """Radius within which the device is, as it reports it [m]; more than 20 m, or more than the offset, is
    refused."""
    offset_ne_m: tuple[
        Annotated[float, Interval(ge=-200, le=200)], Annotated[float, Interval(ge=-200, le=200)]
    ]
    """Where the vehicle stays: north, east of the device [m]."""
    alt_home_m: Annotated[float, Interval(ge=5, le=500)]
    """Height above home [m]."""
    age_s: Annotated[float, Interval(ge=0, le=3600)] = 0.0
    """Age of the position when it is sent [s]; more than 3 s is refused."""
    velocity_ne_m_s: tuple[MetresPerSecond, MetresPerSecond] | None = None
    """Velocity of the device north, east [m/s]; its position is extrapolated with it for at most 1.5 s."""
    yaw: Literal["keep", "face"] = "keep"
    """keep: the present heading; face: towards the device."""


DirectSetpoint = (
    Position
    | PositionGlobal
    | Velocity
    | VelocityBody
    | Acceleration
    | Trajectory
    | Attitude
    | Rates
    | ThrustTorque
    | Actuators
)
"""Kinds that are sent without conversion, if the vehicle's link carries them."""
Setpoint = DirectSetpoint | PositionBody | Path | Follow | FollowDevice
"""Every kind."""
KINDS: dict[str, type[Setpoint]] = {kind.type: kind for kind in get_args(Setpoint)}
"""Every kind by its `type`."""


def needs_of(setpoint: Setpoint) -> tuple[Estimate, ...]:
    """The estimates that one setpoint needs; they depend on its kind and on the given fields."""
    if isinstance(setpoint, Trajectory) and all(axis is None for axis in setpoint.position_ned_m):
        return (Velocity if any(setpoint.velocity_ned_m_s) else Acceleration).needs
    if isinstance(setpoint, PositionGlobal) and setpoint.alt_home_m is not None:
        return (*setpoint.needs, "home")
    if isinstance(setpoint, Follow | FollowDevice) and setpoint.yaw == "keep":
        return (*setpoint.needs, "heading")
    return setpoint.needs


def complete_vector(vector: Partial3) -> Vector3 | None:
    """The vector if all its axes are controlled, otherwise None."""
    x, y, z = vector
    return None if x is None or y is None or z is None else (x, y, z)


def zeros_for_none(vector: Partial3) -> Vector3:
    """The vector with zero on each axis that is not controlled."""
    return (vector[0] or 0.0, vector[1] or 0.0, vector[2] or 0.0)


def contradiction_of(setpoint: Setpoint) -> str | None:
    """Why the fields of a setpoint do not fit together; None: they do."""
    if getattr(setpoint, "yaw_ned_rad", None) is not None and (
        getattr(setpoint, "yaw_rate_ned_rad_s", None) is not None
    ):
        return "give yaw_ned_rad or yaw_rate_ned_rad_s, not both"
    if isinstance(setpoint, PositionGlobal):
        one_altitude = (setpoint.alt_amsl_m is None) != (setpoint.alt_home_m is None)
        return None if one_altitude else "give exactly one of alt_amsl_m and alt_home_m"
    if isinstance(setpoint, Actuators) and not setpoint.motors and not setpoint.servos:
        return "give motors or servos"
    if isinstance(setpoint, Follow):
        if (setpoint.offset_ned_m is None) == (setpoint.offset_frd_m is None):
            return "give exactly one of offset_ned_m and offset_frd_m"
        if math.hypot(*(setpoint.offset_ned_m or setpoint.offset_frd_m or ())) < FOLLOW_MIN_DISTANCE_M:
            return f"the offset must be at least {FOLLOW_MIN_DISTANCE_M:g} m long"
    if isinstance(setpoint, FollowDevice) and math.hypot(*setpoint.offset_ne_m) < DEVICE_MIN_DISTANCE_M:
        return f"offset_ne_m must be at least {DEVICE_MIN_DISTANCE_M:g} m long"
    return _contradiction_of_points(setpoint.points) if isinstance(setpoint, Path) else None


def _contradiction_of_points(points: tuple[PathPoint, ...]) -> str | None:
    if points[0].t_s != 0:
        return "points.0.t_s must be 0: the path starts when the server accepts it"
    for index, (before, after) in enumerate(itertools.pairwise(points), start=1):
        if after.t_s - before.t_s < 0.01:
            return f"points.{index}.t_s must be later than the one before by 0.01 s or more"
    if len({point.yaw_ned_rad is None for point in points}) > 1:
        return "points: give yaw_ned_rad for all points or for none"
    return None
