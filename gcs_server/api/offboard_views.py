"""Response bodies of the offboard routes, as models for the OpenAPI description."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from gcs_server.api.reflect import model_of
from gcs_server.api.setpoint_request import HoldOnExpiry, LandOnExpiry, StopStreamOnExpiry
from gcs_server.api.strict_body import ResponseBody
from gcs_server.streamer.offboard import status
from gcs_server.streamer.offboard.operator_limits import LimitsOrigin
from gcs_server.streamer.validation.availability import Available
from gcs_server.streamer.values import limit_values
from missions.frames import Quaternion, Vector3
from missions.setpoints import Partial3

SetpointType = Literal[
    "position",
    "position_global",
    "position_body",
    "velocity",
    "velocity_body",
    "acceleration",
    "trajectory",
    "attitude",
    "rates",
    "thrust_torque",
    "actuators",
    "path",
    "follow",
]


class StreamedSetpoint(ResponseBody):
    """The setpoint that is being sent to the vehicle; fields of other types are omitted."""

    type: SetpointType = Field(
        description="Type of the sent setpoint: path and follow are sent as trajectory."
    )
    position_ned_m: Partial3 | None = Field(default=None, description="North, east, down [m].")
    velocity_ned_m_s: Partial3 | None = Field(default=None, description="North, east, down [m/s].")
    velocity_frd_m_s: Vector3 | None = Field(
        default=None, description="Forward, right, down of the heading [m/s]."
    )
    acceleration_ned_m_s2: Partial3 | None = Field(default=None, description="North, east, down [m/s²].")
    lat_deg: float | None = Field(default=None, description="Degrees north.")
    lon_deg: float | None = Field(default=None, description="Degrees east.")
    alt_amsl_m: float | None = Field(default=None, description="Above mean sea level [m].")
    q_ned_frd: Quaternion | None = Field(default=None, description="w, x, y, z, taking body FRD to NED.")
    rates_frd_rad_s: Vector3 | None = Field(default=None, description="Roll, pitch, yaw rate [rad/s].")
    thrust: float | None = Field(default=None, description="0 to 1.")
    yaw_ned_rad: float | None = Field(default=None, description="Heading clockwise from north [rad].")
    yaw_rate_ned_rad_s: float | None = Field(default=None, description="Turning rate, clockwise [rad/s].")


LimitsOriginModel = model_of(LimitsOrigin, recognised_by=Literal["uid", "system_id"] | None)
StreamHealthModel = model_of(status.StreamHealth, echo=model_of(status.Echo) | None)
AvoidanceModel = model_of(status.AvoidanceView, "ObstacleAvoidance")
OffboardModel = model_of(
    status.OffboardStatus,
    ordered_type=SetpointType | Literal["mission"] | None,
    setpoint=StreamedSetpoint | None,
    on_expiry=HoldOnExpiry | LandOnExpiry | StopStreamOnExpiry | None,
    limits_origin=LimitsOriginModel,
    avoidance=AvoidanceModel,
    health=StreamHealthModel,
)


class FenceView(ResponseBody):
    """The operator's geofence: a polygon's corners, or a circle's centre and radius."""

    kind: Literal["polygon", "circle"] = Field(description="Kind of the geofence.")
    points_deg: tuple[tuple[float, float], ...] | None = Field(
        default=None, description="Latitude and longitude of each corner [deg]."
    )
    lat_deg: float | None = Field(default=None, description="Latitude of the centre.")
    lon_deg: float | None = Field(default=None, description="Longitude of the centre.")
    radius_m: float | None = Field(default=None, description="Radius [m].")


LimitsModel = model_of(
    status.OffboardLimits,
    "OffboardLimits",
    vehicle=model_of(limit_values.VehicleLimits),
    operator=model_of(limit_values.OperatorLimits, fence=FenceView | None),
    origin=LimitsOriginModel,
)
FailsafeModel = model_of(status.FailsafeView, "OffboardFailsafe")
AvailableModel = model_of(Available, needs=tuple[str, ...])


class OffboardStarted(OffboardModel):  # type: ignore[misc,valid-type]
    """The started stream and its limits."""

    limits: LimitsModel = Field(  # type: ignore[valid-type]
        description="Limits of its setpoints; `origin` says whether the operator's limits were set since the "
        "server started, or restored from the data folder."
    )


class OffboardView(OffboardModel):  # type: ignore[misc,valid-type]
    """The stream, available setpoint types, limits, and the vehicle's failsafe."""

    available: dict[SetpointType, AvailableModel] = Field(  # type: ignore[valid-type]
        description="For each setpoint type: whether this vehicle can fly it now over this link, and if "
        "not, why."
    )
    limits: LimitsModel = Field(description="Limits of setpoints.")  # type: ignore[valid-type]
    failsafe: FailsafeModel | None = Field(  # type: ignore[valid-type]
        description="The vehicle's own action when the stream stops; null if unknown."
    )
