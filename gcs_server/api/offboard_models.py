"""Request bodies of the offboard routes other than setpoints: limits, obstacle avoidance, failsafe."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from gcs_server.api.setpoint_fields import Latitude, Longitude, example
from gcs_server.api.strict_body import StrictBody
from gcs_server.streamer.values import limit_values
from missions.fence import CircleFence, Fence, PolygonFence


class PolygonFenceBody(StrictBody):
    """A polygon that the vehicle must not leave."""

    kind: Literal["polygon"]
    points_deg: Annotated[tuple[tuple[Latitude, Longitude], ...], Field(min_length=3, max_length=200)] = (
        Field(description="Latitude and longitude of each corner, in order [deg].")
    )

    def to_fence(self) -> Fence:
        """Converts to the streamer's type."""
        return PolygonFence(self.points_deg)


class CircleFenceBody(StrictBody):
    """A circle that the vehicle must not leave."""

    kind: Literal["circle"]
    lat_deg: Latitude
    lon_deg: Longitude
    radius_m: float = Field(allow_inf_nan=False, ge=5, le=10_000, description="Radius [m].")

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
    fence: AnyFence | None = Field(
        default=None, description="Stay inside this geofence, in addition to the vehicle's own geofence."
    )
    slew_velocity_m_s2: float | None = _limit("Maximum rate of change of the sent velocity [m/s²].", 0.1, 20)
    slew_attitude_rad_s: float | None = _limit(
        "Maximum rate of change of the sent attitude [rad/s].", 0.05, 10
    )
    obstacle_brake: bool = Field(
        default=True,
        description=(
            "Stop before obstacles that the vehicle's distance sensors measure; false switches this off."
        ),
    )

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

    on: bool = Field(description="Whether avoidance is on: the vehicle flies around or over obstacles.")
    way: Literal["over", "around"] = Field(
        default="over",
        description="What to try first: climb over an obstacle, or pass it at the same altitude.",
    )


FailsafeAction = Literal["position", "altitude", "stabilized", "rtl", "land", "hold"]


class FailsafeRequest(StrictBody):
    """The vehicle's own action when the stream stops; omitted fields stay unchanged."""

    model_config = example(action="hold", after_s=1)

    action: FailsafeAction | None = Field(
        default=None,
        description="A mode. In `position`, `altitude` and `stabilized`, the vehicle descends if it has no "
        "RC transmitter.",
    )
    after_s: float | None = Field(
        default=None,
        allow_inf_nan=False,
        ge=0.5,
        le=60,
        description="Time from the last setpoint to the action [s] (COM_OF_LOSS_T).",
    )

    @model_validator(mode="after")
    def _check_not_empty(self) -> FailsafeRequest:
        if self.action is None and self.after_s is None:
            raise ValueError("give action, after_s or both")
        return self
