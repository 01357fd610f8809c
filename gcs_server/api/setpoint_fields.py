"""Fields of setpoint bodies with units and limits, and checks common to all bodies."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Annotated, Any, cast

from pydantic import ConfigDict, Field, JsonValue, model_validator

from gcs_server.api.strict_body import StrictBody
from gcs_server.streamer.validation.axes import MAVLINK_ONLY_FIELDS
from missions import setpoints as s

Metres = Annotated[float, Field(allow_inf_nan=False, ge=-10_000, le=10_000)]
MetresPerSecond = Annotated[float, Field(allow_inf_nan=False, ge=-20, le=20)]
MetresPerSecond2 = Annotated[float, Field(allow_inf_nan=False, ge=-20, le=20)]
RadiansPerSecond = Annotated[float, Field(allow_inf_nan=False, ge=-10, le=10)]
Latitude = Annotated[float, Field(allow_inf_nan=False, ge=-90, le=90, description="Degrees north, WGS 84.")]
Longitude = Annotated[float, Field(allow_inf_nan=False, ge=-180, le=180, description="Degrees east, WGS 84.")]
Angle = Annotated[float, Field(allow_inf_nan=False, ge=-2 * math.pi, le=2 * math.pi)]
Normalized = Annotated[float, Field(allow_inf_nan=False, ge=-1, le=1)]
Metres3 = tuple[Metres, Metres, Metres]
PartialPositionNed = tuple[Metres | None, Metres | None, Metres | None]
PartialVelocity = tuple[MetresPerSecond | None, MetresPerSecond | None, MetresPerSecond | None]
PartialAcceleration = tuple[MetresPerSecond2 | None, MetresPerSecond2 | None, MetresPerSecond2 | None]
Quaternion = tuple[Normalized, Normalized, Normalized, Normalized]
Thrust = Annotated[
    float,
    Field(allow_inf_nan=False, ge=0, le=1, description="Total thrust, 0 to 1, along the body's up axis."),
]

POSITION_TEXT = "North, east, down of the vehicle's local origin [m]; down is negative above the origin."
VELOCITY_TEXT = "North, east, down [m/s]; each at most 20."
ACCELERATION_TEXT = "North, east, down [m/s²], without gravity; each at most 20."
NULL_MEANING = " null: not controlled."


def example(**fields: JsonValue) -> ConfigDict:
    """An example of the body, for the API reference."""
    examples: list[JsonValue] = [fields]
    return ConfigDict(json_schema_extra={"examples": examples})


class SetpointBody(StrictBody, ABC):
    """Base of all setpoint bodies."""

    @model_validator(mode="before")
    @classmethod
    def _refuse_mavlink_fields(cls, data: Any) -> Any:
        if isinstance(data, dict):
            for name in cast(dict[object, object], data):
                if isinstance(name, str) and name in MAVLINK_ONLY_FIELDS:
                    raise ValueError(f"{name}: {MAVLINK_ONLY_FIELDS[name]}")
        return data

    @abstractmethod
    def to_setpoint(self) -> s.Setpoint:
        """Converts to the setpoint value."""


class YawOrRate(SetpointBody):
    """Base of setpoints with yaw or yaw rate."""

    yaw_ned_rad: Angle | None = Field(
        default=None,
        description="Heading clockwise from north [rad]; without yaw and yaw rate, the vehicle keeps its "
        "heading.",
    )
    yaw_rate_ned_rad_s: float | None = Field(
        default=None, allow_inf_nan=False, ge=-3.5, le=3.5, description="Turning rate, clockwise [rad/s]."
    )

    @model_validator(mode="after")
    def _check_one_yaw(self) -> YawOrRate:
        if self.yaw_ned_rad is not None and self.yaw_rate_ned_rad_s is not None:
            raise ValueError("give yaw_ned_rad or yaw_rate_ned_rad_s, not both")
        return self
