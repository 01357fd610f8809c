"""Bodies of the offboard routes other than setpoints: requests for limits, obstacle avoidance and the
failsafe, and the responses, as models for the OpenAPI description."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from gcs_server.api.reflect import model_of
from gcs_server.api.setpoints import HoldOnExpiry, LandOnExpiry, StopStreamOnExpiry
from gcs_server.api.strict_body import Latitude, Longitude, ResponseBody, StrictBody, example
from gcs_server.streamer.offboard import status
from gcs_server.streamer.offboard.limit_store import LimitsOrigin
from gcs_server.streamer.validation import Available
from gcs_server.streamer.values import limit_values
from missions.fence import CircleFence, Fence, PolygonFence
from missions.frames import Quaternion, Vector3
from missions.setpoints import Partial3


class PolygonFenceBody(StrictBody):
    """A polygon that the vehicle must not leave."""

    kind: Literal["polygon"]
    points_deg: Annotated[tuple[tuple[Latitude, Longitude], ...], Field(min_length=3, max_length=200)]
    """Latitude and longitude of each corner, in order [deg]."""

    def to_fence(self) -> Fence:
        """Converts to the streamer's type."""
        return PolygonFence(self.points_deg)


class CircleFenceBody(StrictBody):
    """A circle that the vehicle must not leave."""

    kind: Literal["circle"]
    lat_deg: Latitude
    lon_deg: Longitude
    radius_m: float = Field(allow_inf_nan=False, ge=5, le=10_000)
    """Radius [m]."""

    def to_fence(self) -> Fence:
        """Converts to the streamer's type."""
        return CircleFence(self.lat_deg, self.lon_deg, self.radius_m)


AnyFence = Annotated[PolygonFenceBody | CircleFenceBody, Field(discriminator="kind")]


def _limit(description: str, low: float, high: float) -> Any:
    return Field(default=None, allow_inf_nan=False, ge=low, le=high, description=description)


class LimitsRequest(StrictBody):
    """All operator limits; an omitted or null field means no limit."""

    model_config = example(speed_max_m_s=5, height_max_m=30, distance_max_m=100)

    speed_max_m_s: float | None = _limit("Maximum horizontal speed [m/s].", 0.1, 20)
    climb_max_m_s: float | None = _limit("Maximum climb rate [m/s].", 0.1, 20)
    sink_max_m_s: float | None = _limit("Maximum descent rate [m/s].", 0.1, 20)
    tilt_max_rad: float | None = _limit("Maximum tilt [rad].", 0.02, 1.5)
    height_min_m: float | None = _limit("Minimum altitude above home [m].", -1000, 10_000)
    height_max_m: float | None = _limit("Maximum altitude above home [m].", -1000, 10_000)
    distance_max_m: float | None = _limit("Maximum horizontal distance from home [m].", 5, 10_000)
    fence: AnyFence | None = None
    """Stay inside this geofence, in addition to the vehicle's own geofence."""
    slew_velocity_m_s2: float | None = _limit("Maximum rate of change of the sent velocity [m/s²].", 0.1, 20)
    slew_attitude_rad_s: float | None = _limit(
        "Maximum rate of change of the sent attitude [rad/s].", 0.05, 10
    )
    obstacle_brake: bool = True
    """Stop before obstacles that the vehicle's distance sensors measure; false switches this off."""

    @model_validator(mode="after")
    def _check_altitude_range(self) -> LimitsRequest:
        low, high = self.height_min_m, self.height_max_m
        if low is not None and high is not None and high - low < 1:
            raise ValueError("height_max_m must be at least 1 m above height_min_m")
        return self

    def to_limits(self) -> limit_values.OperatorLimits:
        """Converts to the streamer's type."""
        fields = {name: getattr(self, name) for name in type(self).model_fields if name != "fence"}
        return limit_values.OperatorLimits(**fields, fence=self.fence.to_fence() if self.fence else None)


class AvoidanceRequest(StrictBody):
    """Obstacle avoidance for a vehicle's setpoint stream."""

    model_config = example(on=True, way="over")

    on: bool
    """Whether avoidance is on: the vehicle flies around or over obstacles."""
    way: Literal["over", "around"] = "over"
    """What to try first: climb over an obstacle, or pass it at the same altitude."""


FailsafeAction = Literal["position", "altitude", "stabilized", "rtl", "land", "hold"]


class FailsafeRequest(StrictBody):
    """The vehicle's own action when the stream stops; omitted fields stay unchanged."""

    model_config = example(action="hold", after_s=1)

    action: FailsafeAction | None = None
    """A mode. In `position`, `altitude` and `stabilized`, the vehicle descends if it has no RC
    transmitter."""
    after_s: float | None = Field(default=None, allow_inf_nan=False, ge=0.5, le=60)
    """Time from the last setpoint to the action [s] (COM_OF_LOSS_T)."""

    @model_validator(mode="after")
    def _check_not_empty(self) -> FailsafeRequest:
        if self.action is None and self.after_s is None:
            raise ValueError("give action, after_s or both")
        return self


# --- responses ------------------------------------------------------------------------------------

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
    "follow_device",
]


class StreamedSetpoint(ResponseBody):
    """The setpoint that is being sent to the vehicle; fields of other types are omitted."""

    type: SetpointType
    """Type of the sent setpoint: path, follow and follow_device are sent as trajectory."""
    position_ned_m: Partial3 | None = None
    """North, east, down [m]."""
    velocity_ned_m_s: Partial3 | None = None
    """North, east, down [m/s]."""
    velocity_frd_m_s: Vector3 | None = None
    """Forward, right, down of the heading [m/s]."""
    acceleration_ned_m_s2: Partial3 | None = None
    """North, east, down [m/s²]."""
    lat_deg: float | None = None
    """Degrees north."""
    lon_deg: float | None = None
    """Degrees east."""
    alt_amsl_m: float | None = None
    """Above mean sea level [m]."""
    q_ned_frd: Quaternion | None = None
    """w, x, y, z, taking body FRD to NED."""
    rates_frd_rad_s: Vector3 | None = None
    """Roll, pitch, yaw rate [rad/s]."""
    thrust: float | None = None
    """0 to 1."""
    yaw_ned_rad: float | None = None
    """Heading clockwise from north [rad]."""
    yaw_rate_ned_rad_s: float | None = None
    """Turning rate, clockwise [rad/s]."""


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

    kind: Literal["polygon", "circle"]
    """Kind of the geofence."""
    points_deg: tuple[tuple[float, float], ...] | None = None
    """Latitude and longitude of each corner [deg]."""
    lat_deg: float | None = None
    """Latitude of the centre."""
    lon_deg: float | None = None
    """Longitude of the centre."""
    radius_m: float | None = None
    """Radius [m]."""


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
