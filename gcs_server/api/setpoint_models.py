"""Setpoint bodies of HTTP and WebSocket, one class per setpoint type; `to_setpoint` converts to the
streamer's type."""

from __future__ import annotations

import itertools
import math
from typing import Annotated, Literal

from pydantic import FailFast, Field, model_validator

from gcs_server.api.setpoint_fields import (
    ACCELERATION_TEXT,
    NULL_MEANING,
    POSITION_TEXT,
    VELOCITY_TEXT,
    Angle,
    Latitude,
    Longitude,
    Metres3,
    MetresPerSecond,
    Normalized,
    PartialAcceleration,
    PartialPositionNed,
    PartialVelocity,
    Quaternion,
    RadiansPerSecond,
    SetpointBody,
    Thrust,
    YawOrRate,
    example,
)
from gcs_server.api.strict_body import StrictBody
from missions import setpoints as s
from missions.frames import q_from_euler


class PositionSetpoint(YawOrRate):
    """A position in the vehicle's local frame."""

    model_config = example(type="position", position_ned_m=[0, 0, -10])

    type: Literal["position"]
    position_ned_m: PartialPositionNed = Field(description=POSITION_TEXT)

    def to_setpoint(self) -> s.Position:
        return s.Position(self.position_ned_m, self.yaw_ned_rad, self.yaw_rate_ned_rad_s)


class PositionGlobalSetpoint(YawOrRate):
    """A global position; exactly one of the two altitudes."""

    model_config = example(type="position_global", lat_deg=47.3979, lon_deg=8.5458, alt_home_m=12)

    type: Literal["position_global"]
    lat_deg: Latitude
    lon_deg: Longitude
    alt_amsl_m: float | None = Field(
        default=None, allow_inf_nan=False, ge=-500, le=10_000, description="Above mean sea level [m]."
    )
    alt_home_m: float | None = Field(
        default=None, allow_inf_nan=False, ge=-100, le=1000, description="Above home [m]."
    )

    @model_validator(mode="after")
    def _check_one_altitude(self) -> PositionGlobalSetpoint:
        if (self.alt_amsl_m is None) == (self.alt_home_m is None):
            raise ValueError("give exactly one of alt_amsl_m and alt_home_m")
        return self

    def to_setpoint(self) -> s.PositionGlobal:
        return s.PositionGlobal(
            self.lat_deg,
            self.lon_deg,
            self.alt_amsl_m,
            self.alt_home_m,
            self.yaw_ned_rad,
            self.yaw_rate_ned_rad_s,
        )


class PositionBodySetpoint(SetpointBody):
    """An offset from the vehicle's position along its heading, at the time when the server accepts the
    setpoint.
    """

    model_config = example(type="position_body", offset_frd_m=[5, 0, 0])

    type: Literal["position_body"]
    offset_frd_m: Metres3 = Field(description="Forward, right, down of the heading, level [m].")
    yaw_offset_rad: Angle | None = Field(
        default=None, description="Yaw offset, clockwise [rad]; default: keep the heading."
    )

    def to_setpoint(self) -> s.PositionBody:
        return s.PositionBody(self.offset_frd_m, self.yaw_offset_rad)


class VelocitySetpoint(YawOrRate):
    """A velocity in the vehicle's local frame."""

    model_config = example(type="velocity", velocity_ned_m_s=[1, 0, 0])

    type: Literal["velocity"]
    velocity_ned_m_s: PartialVelocity = Field(description=VELOCITY_TEXT)

    def to_setpoint(self) -> s.Velocity:
        return s.Velocity(self.velocity_ned_m_s, self.yaw_ned_rad, self.yaw_rate_ned_rad_s)


class VelocityBodySetpoint(YawOrRate):
    """A velocity in the level heading frame, which turns with the vehicle."""

    model_config = example(type="velocity_body", velocity_frd_m_s=[1, 0, 0], yaw_rate_ned_rad_s=0.2)

    type: Literal["velocity_body"]
    velocity_frd_m_s: tuple[MetresPerSecond, MetresPerSecond, MetresPerSecond] = Field(
        description="Forward, right, down of the heading [m/s]; each at most 20."
    )

    def to_setpoint(self) -> s.VelocityBody:
        return s.VelocityBody(self.velocity_frd_m_s, self.yaw_ned_rad, self.yaw_rate_ned_rad_s)


class AccelerationSetpoint(YawOrRate):
    """An acceleration in the vehicle's local frame, without compensation of drag; at zero the vehicle does
    not keep its position."""

    model_config = example(type="acceleration", acceleration_ned_m_s2=[0.5, 0, 0])

    type: Literal["acceleration"]
    acceleration_ned_m_s2: PartialAcceleration = Field(description=ACCELERATION_TEXT)

    def to_setpoint(self) -> s.Acceleration:
        return s.Acceleration(self.acceleration_ned_m_s2, self.yaw_ned_rad, self.yaw_rate_ned_rad_s)


class TrajectorySetpoint(YawOrRate):
    """Position, velocity and acceleration. On each axis at least one is required: the vehicle controls the
    first of them that is given, and the others are feed-forward. Give north and east together, or neither.
    """

    model_config = example(
        type="trajectory", position_ned_m=[5, 0, -10], velocity_ned_m_s=[1, 0, 0], yaw_ned_rad=0
    )

    type: Literal["trajectory"]
    position_ned_m: PartialPositionNed = Field(
        default=s.UNCONTROLLED, description=POSITION_TEXT + NULL_MEANING
    )
    velocity_ned_m_s: PartialVelocity = Field(
        default=s.UNCONTROLLED, description=VELOCITY_TEXT + NULL_MEANING
    )
    acceleration_ned_m_s2: PartialAcceleration = Field(
        default=s.UNCONTROLLED, description=ACCELERATION_TEXT + NULL_MEANING
    )

    def to_setpoint(self) -> s.Trajectory:
        return s.Trajectory(
            self.position_ned_m,
            self.velocity_ned_m_s,
            self.acceleration_ned_m_s2,
            self.yaw_ned_rad,
            self.yaw_rate_ned_rad_s,
        )


class AttitudeSetpoint(SetpointBody):
    """An attitude, as a quaternion or as roll, pitch and yaw, with thrust."""

    model_config = example(type="attitude", roll_rad=0, pitch_rad=-0.1, yaw_ned_rad=0, thrust=0.5)

    type: Literal["attitude"]
    q_ned_frd: Quaternion | None = Field(
        default=None, description="w, x, y, z of unit length, taking body FRD to NED; or the three angles."
    )
    roll_rad: Angle | None = Field(default=None, description="Right side down is positive [rad].")
    pitch_rad: Annotated[float, Field(allow_inf_nan=False, ge=-math.pi / 2, le=math.pi / 2)] | None = Field(
        default=None, description="Nose up is positive [rad]."
    )
    yaw_ned_rad: Angle | None = Field(default=None, description="Heading clockwise from north [rad].")
    yaw_rate_ned_rad_s: float | None = Field(
        default=None,
        allow_inf_nan=False,
        ge=-3.5,
        le=3.5,
        description="Yaw rate feed-forward, clockwise about the vertical axis [rad/s].",
    )
    thrust: Thrust

    @model_validator(mode="after")
    def _check_one_attitude(self) -> AttitudeSetpoint:
        angles = (self.roll_rad, self.pitch_rad, self.yaw_ned_rad)
        if self.q_ned_frd is None:
            if any(angle is None for angle in angles):
                raise ValueError("give q_ned_frd, or all of roll_rad, pitch_rad and yaw_ned_rad")
        elif any(angle is not None for angle in angles):
            raise ValueError("give q_ned_frd or the three angles, not both")
        elif abs(math.hypot(*self.q_ned_frd) - 1.0) > 0.01:
            raise ValueError(f"q_ned_frd must have length 1, not {math.hypot(*self.q_ned_frd):.3g}")
        return self

    def to_setpoint(self) -> s.Attitude:
        if self.q_ned_frd is not None:
            norm = math.hypot(*self.q_ned_frd)
            w, x, y, z = (each / norm for each in self.q_ned_frd)
            return s.Attitude((w, x, y, z), self.thrust, self.yaw_rate_ned_rad_s)
        assert self.roll_rad is not None
        assert self.pitch_rad is not None
        assert self.yaw_ned_rad is not None
        q = q_from_euler(self.roll_rad, self.pitch_rad, self.yaw_ned_rad)
        return s.Attitude(q, self.thrust, self.yaw_rate_ned_rad_s)


class RatesSetpoint(SetpointBody):
    """Body rates with thrust; the vehicle does not level itself."""

    model_config = example(type="rates", rates_frd_rad_s=[0, 0, 0.5], thrust=0.5)

    type: Literal["rates"]
    rates_frd_rad_s: tuple[RadiansPerSecond, RadiansPerSecond, RadiansPerSecond] = Field(
        description="Roll, pitch, yaw rate [rad/s]."
    )
    thrust: Thrust

    def to_setpoint(self) -> s.Rates:
        return s.Rates(self.rates_frd_rad_s, self.thrust)


class ThrustTorqueSetpoint(SetpointBody):
    """Body thrust and torque, which bypass all controllers; not possible over MAVLink."""

    model_config = example(type="thrust_torque", thrust_frd=[0, 0, -0.5], torque_frd=[0, 0, 0])

    type: Literal["thrust_torque"]
    thrust_frd: tuple[Normalized, Normalized, Normalized] = Field(
        description="Forward, right, down, each -1 to 1."
    )
    torque_frd: tuple[Normalized, Normalized, Normalized] = Field(
        description="Roll, pitch, yaw, each -1 to 1."
    )

    def to_setpoint(self) -> s.ThrustTorque:
        return s.ThrustTorque(self.thrust_frd, self.torque_frd)


class ActuatorsSetpoint(SetpointBody):
    """Individual motor and servo values; not possible over MAVLink."""

    model_config = example(type="actuators", motors=[0.5, 0.5, 0.5, 0.5])

    type: Literal["actuators"]
    motors: Annotated[tuple[Normalized | None, ...], Field(max_length=12)] = Field(
        default=(), description="Each -1 to 1; null is disarmed."
    )
    servos: Annotated[tuple[Normalized | None, ...], Field(max_length=8)] = Field(
        default=(), description="Each -1 to 1; null is disarmed."
    )

    @model_validator(mode="after")
    def _check_not_empty(self) -> ActuatorsSetpoint:
        if not self.motors and not self.servos:
            raise ValueError("give motors or servos")
        return self

    def to_setpoint(self) -> s.Actuators:
        return s.Actuators(self.motors, self.servos)


class PathPointBody(StrictBody):
    """A position at a time."""

    t_s: float = Field(
        allow_inf_nan=False, ge=0, le=3600, description="Time since the start of the path [s]."
    )
    position_ned_m: Metres3 = Field(description=POSITION_TEXT)
    yaw_ned_rad: Angle | None = Field(
        default=None, description="Heading clockwise from north [rad]; given for all points or for none."
    )


class PathSetpoint(SetpointBody):
    """A smooth curve through points in time, flown by the server even if its client disconnects.

    The first point must be within 5 m of the vehicle's position, and its `t_s` must be 0.
    `valid_for_s` starts at the end of the path.
    """

    model_config = example(
        type="path",
        points=[
            {"t_s": 0, "position_ned_m": [0, 0, -10]},
            {"t_s": 5, "position_ned_m": [10, 0, -10]},
            {"t_s": 10, "position_ned_m": [10, 10, -10]},
        ],
    )

    type: Literal["path"]
    points: Annotated[tuple[PathPointBody, ...], Field(min_length=2, max_length=5000), FailFast()] = Field(
        description="Points in the order of their times; the vehicle keeps the position of the last point."
    )

    @model_validator(mode="after")
    def _check_times(self) -> PathSetpoint:
        times = [point.t_s for point in self.points]
        if times[0] != 0:
            raise ValueError("points.0.t_s must be 0: the path starts when the server accepts it")
        for index, (before, after) in enumerate(itertools.pairwise(times), start=1):
            if after - before < 0.01:
                raise ValueError(f"points.{index}.t_s must be later than the one before by 0.01 s or more")
        if len({point.yaw_ned_rad is None for point in self.points}) > 1:
            raise ValueError("points: give yaw_ned_rad for all points or for none")
        return self

    def to_setpoint(self) -> s.Path:
        return s.Path(tuple(s.PathPoint(p.t_s, p.position_ned_m, p.yaw_ned_rad) for p in self.points))


class FollowSetpoint(SetpointBody):
    """A position that moves with another vehicle; exactly one offset, at least 2 m long."""

    model_config = example(type="follow", vehicle="2", offset_frd_m=[-5, 0, -2], yaw="same")

    type: Literal["follow"]
    vehicle: str = Field(min_length=1, max_length=32, description="Id of the vehicle to follow.")
    offset_ned_m: Metres3 | None = Field(
        default=None, description="Offset north, east, down of that vehicle [m]."
    )
    offset_frd_m: Metres3 | None = Field(
        default=None, description="Offset forward, right, down along that vehicle's heading, level [m]."
    )
    yaw: Literal["keep", "same", "face"] = Field(
        default="keep",
        description="keep: the present heading; same: the heading of the followed vehicle; face: towards the "
        "followed vehicle.",
    )

    @model_validator(mode="after")
    def _check_one_offset(self) -> FollowSetpoint:
        if (self.offset_ned_m is None) == (self.offset_frd_m is None):
            raise ValueError("give exactly one of offset_ned_m and offset_frd_m")
        if math.hypot(*(self.offset_ned_m or self.offset_frd_m or ())) < s.FOLLOW_MIN_DISTANCE_M:
            raise ValueError(f"the offset must be at least {s.FOLLOW_MIN_DISTANCE_M:g} m long")
        return self

    def to_setpoint(self) -> s.Follow:
        return s.Follow(self.vehicle, self.offset_ned_m, self.offset_frd_m, self.yaw)


AnySetpoint = Annotated[
    PositionSetpoint
    | PositionGlobalSetpoint
    | PositionBodySetpoint
    | VelocitySetpoint
    | VelocityBodySetpoint
    | AccelerationSetpoint
    | TrajectorySetpoint
    | AttitudeSetpoint
    | RatesSetpoint
    | ThrustTorqueSetpoint
    | ActuatorsSetpoint
    | PathSetpoint
    | FollowSetpoint,
    Field(discriminator="type"),
]
