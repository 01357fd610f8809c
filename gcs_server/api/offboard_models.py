"""Request bodies of the offboard routes: orders, limits, failsafe."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from gcs_server.api.setpoint_fields import Latitude, Longitude, SetpointBody, example
from gcs_server.api.setpoint_models import (
    AccelerationSetpoint,
    ActuatorsSetpoint,
    AnySetpoint,
    AttitudeSetpoint,
    FollowSetpoint,
    PathSetpoint,
    PositionBodySetpoint,
    PositionGlobalSetpoint,
    PositionSetpoint,
    RatesSetpoint,
    ThrustTorqueSetpoint,
    TrajectorySetpoint,
    VelocityBodySetpoint,
    VelocitySetpoint,
)
from gcs_server.api.strict_body import StrictBody
from gcs_server.control.principal import Principal
from gcs_server.streamer.values import limit_values as values
from gcs_server.streamer.values.order import OnExpiry, Order
from missions.fence import CircleFence, Fence, PolygonFence


class HoldOnExpiry(StrictBody):
    """Hold the position by setpoints, then switch to PX4's Hold mode; without a position estimate, land."""

    action: Literal["hold"]
    hold_for_s: float = Field(
        default=5.0, allow_inf_nan=False, ge=0, le=3600, description="Time before Hold mode [s]."
    )


class LandOnExpiry(StrictBody):
    """Land at the current position."""

    action: Literal["land"]


class StopStreamOnExpiry(StrictBody):
    """Stop sending: the vehicle's own failsafe takes over."""

    action: Literal["stop_stream"]


AnyOnExpiry = Annotated[HoldOnExpiry | LandOnExpiry | StopStreamOnExpiry, Field(discriminator="action")]


class _Lasting(StrictBody):
    valid_for_s: float = Field(
        default=1.0,
        allow_inf_nan=False,
        ge=0.05,
        le=3600,
        description="How long the setpoint is valid without being renewed [s]; then `on_expiry` applies.",
    )
    on_expiry: AnyOnExpiry = Field(
        default=HoldOnExpiry(action="hold"),
        description="Action of the server when the setpoint has expired.",
    )

    def order(self, setpoint: SetpointBody, principal: Principal) -> Order:
        """Converts to the streamer's type."""
        expiry = self.on_expiry
        hold_for_s = expiry.hold_for_s if isinstance(expiry, HoldOnExpiry) else 0.0
        on_expiry = OnExpiry(expiry.action, hold_for_s)
        return Order(setpoint.to_setpoint(), self.valid_for_s, on_expiry, principal.name, principal.key)


class StartRequest(_Lasting):
    """The first setpoint and how to stream it; validity counts from the moment Offboard is confirmed."""

    setpoint: AnySetpoint
    rate_hz: float = Field(
        default=50.0, allow_inf_nan=False, ge=2, le=100, description="Setpoints a second [Hz]."
    )

    def to_order(self, principal: Principal) -> Order:
        """Converts to the streamer's type."""
        return self.order(self.setpoint, principal)


class _OrderBody(_Lasting, SetpointBody):
    def to_order(self, principal: Principal) -> Order:
        """Converts to the streamer's type."""
        return self.order(self, principal)


class PositionOrder(PositionSetpoint, _OrderBody):
    """A new position, sent at once."""


class PositionGlobalOrder(PositionGlobalSetpoint, _OrderBody):
    """A new global position, sent at once."""


class PositionBodyOrder(PositionBodySetpoint, _OrderBody):
    """An offset from the vehicle's current position."""


class VelocityOrder(VelocitySetpoint, _OrderBody):
    """A new velocity, sent at once."""


class VelocityBodyOrder(VelocityBodySetpoint, _OrderBody):
    """A new velocity along the heading, sent at once."""


class AccelerationOrder(AccelerationSetpoint, _OrderBody):
    """A new acceleration, sent at once."""


class TrajectoryOrder(TrajectorySetpoint, _OrderBody):
    """Position with feed-forward, sent at once."""


class AttitudeOrder(AttitudeSetpoint, _OrderBody):
    """A new attitude, sent at once."""


class RatesOrder(RatesSetpoint, _OrderBody):
    """New body rates, sent at once."""


class ThrustTorqueOrder(ThrustTorqueSetpoint, _OrderBody):
    """Thrust and torque; refused on MAVLink links."""


class ActuatorsOrder(ActuatorsSetpoint, _OrderBody):
    """Motors and servos; refused on MAVLink links."""


class PathOrder(PathSetpoint, _OrderBody):
    """A path, started at once."""


class FollowOrder(FollowSetpoint, _OrderBody):
    """Follow another vehicle from now on."""


AnyOrder = Annotated[
    PositionOrder
    | PositionGlobalOrder
    | PositionBodyOrder
    | VelocityOrder
    | VelocityBodyOrder
    | AccelerationOrder
    | TrajectoryOrder
    | AttitudeOrder
    | RatesOrder
    | ThrustTorqueOrder
    | ActuatorsOrder
    | PathOrder
    | FollowOrder,
    Field(discriminator="type"),
]


class PolygonFenceBody(StrictBody):
    """Stay inside."""

    kind: Literal["polygon"]
    points_deg: Annotated[tuple[tuple[Latitude, Longitude], ...], Field(min_length=3, max_length=200)] = (
        Field(description="Latitude and longitude of each corner, in order [deg].")
    )

    def to_fence(self) -> Fence:
        """Converts to the streamer's type."""
        return PolygonFence(self.points_deg)


class CircleFenceBody(StrictBody):
    """Stay inside."""

    kind: Literal["circle"]
    lat_deg: Latitude
    lon_deg: Longitude
    radius_m: float = Field(allow_inf_nan=False, ge=5, le=10_000, description="[m]")

    def to_fence(self) -> Fence:
        """Converts to the streamer's type."""
        return CircleFence(self.lat_deg, self.lon_deg, self.radius_m)


AnyFence = Annotated[PolygonFenceBody | CircleFenceBody, Field(discriminator="kind")]


def _limit(words: str, low: float, high: float) -> Any:
    return Field(default=None, allow_inf_nan=False, ge=low, le=high, description=words)


class LimitsRequest(StrictBody):
    """All operator limits; an omitted or null field means no limit."""

    model_config = example(speed_max_m_s=5, height_max_m=30, distance_max_m=100)

    speed_max_m_s: float | None = _limit("Over the ground [m/s].", 0.1, 20)
    climb_max_m_s: float | None = _limit("[m/s]", 0.1, 20)
    sink_max_m_s: float | None = _limit("[m/s]", 0.1, 20)
    tilt_max_rad: float | None = _limit("[rad]", 0.02, 1.5)
    height_min_m: float | None = _limit("Above home [m].", -1000, 10_000)
    height_max_m: float | None = _limit("Above home [m].", -1000, 10_000)
    distance_max_m: float | None = _limit("From home, over the ground [m].", 5, 10_000)
    fence: AnyFence | None = Field(
        default=None, description="Stay inside this fence, in addition to the vehicle's own fence."
    )
    slew_velocity_m_s2: float | None = _limit("A sent velocity changes by no more than this [m/s²].", 0.1, 20)
    slew_attitude_rad_s: float | None = _limit(
        "A sent attitude turns by no more than this [rad/s].", 0.05, 10
    )
    obstacle_brake: bool = Field(
        default=True,
        description=(
            "Stop before obstacles that the vehicle's distance sensors measure; false switches this off."
        ),
    )

    @model_validator(mode="after")
    def _heights_in_order(self) -> LimitsRequest:
        low, high = self.height_min_m, self.height_max_m
        if low is not None and high is not None and high - low < 1:
            raise ValueError("height_max_m must be at least 1 m above height_min_m")
        return self

    def to_limits(self) -> values.OperatorLimits:
        """Converts to the streamer's type."""
        fields = {name: getattr(self, name) for name in type(self).model_fields if name != "fence"}
        return values.OperatorLimits(**fields, fence=self.fence.to_fence() if self.fence else None)


class AvoidanceRequest(StrictBody):
    """Obstacle avoidance of a vehicle's setpoints."""

    model_config = example(on=True, way="over")

    on: bool = Field(description="Whether the vehicle is led past obstacles.")
    way: Literal["over", "around"] = Field(
        default="over",
        description="Direction that is tried first: climb over an obstacle, or pass it at the same altitude.",
    )


FAILSAFE_ACTIONS = Literal["position", "altitude", "stabilized", "rtl", "land", "hold"]


class FailsafeRequest(StrictBody):
    """The vehicle's own action when the stream stops; omitted fields stay unchanged."""

    model_config = example(action="hold", after_s=1)

    action: FAILSAFE_ACTIONS | None = Field(
        default=None,
        description="A mode; in the three modes that need sticks the vehicle descends if there is no RC "
        "transmitter.",
    )
    after_s: float | None = Field(
        default=None,
        allow_inf_nan=False,
        ge=0.5,
        le=60,
        description="Time from the last setpoint to the action [s] (COM_OF_LOSS_T).",
    )

    @model_validator(mode="after")
    def _something(self) -> FailsafeRequest:
        if self.action is None and self.after_s is None:
            raise ValueError("give action, after_s or both")
        return self
