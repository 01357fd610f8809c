"""The request format for all setpoints: `{"setpoint": {…}, "valid_for_s": …, "on_expiry": {…}}`.

`offboard/start`, `offboard/setpoint` and the WebSocket accept one setpoint. The groups' routes accept the
same `valid_for_s` and `on_expiry`, with one setpoint for each member.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, cast

from pydantic import Field, model_validator

from gcs_server.api.setpoint_fields import example
from gcs_server.api.setpoint_models import AnySetpoint
from gcs_server.api.strict_body import StrictBody
from gcs_server.control.principal import Principal
from gcs_server.streamer.values.stream_request import OnExpiry, StreamRequest


class HoldOnExpiry(StrictBody):
    """Hold the position by setpoints, then switch to PX4's Hold mode; land if there is no position
    estimate."""

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


class Validity(StrictBody):
    """How long setpoints are valid, and the action on expiry."""

    valid_for_s: float = Field(
        default=1.0,
        allow_inf_nan=False,
        ge=0.05,
        le=3600,
        description="Time until the setpoint expires if it is not renewed [s]; then `on_expiry` applies.",
    )
    on_expiry: AnyOnExpiry = Field(
        default=HoldOnExpiry(action="hold"),
        description="Action of the server when the setpoint has expired.",
    )

    def expiry(self) -> OnExpiry:
        """Converts to the streamer's type."""
        on_expiry = self.on_expiry
        hold_for_s = on_expiry.hold_for_s if isinstance(on_expiry, HoldOnExpiry) else 0.0
        return OnExpiry(on_expiry.action, hold_for_s)


class SetpointRequest(Validity):
    """A setpoint, sent immediately; it replaces the previous setpoint."""

    model_config = example(
        setpoint={"type": "velocity", "velocity_ned_m_s": [1, 0, 0]},
        valid_for_s=3,
        on_expiry={"action": "hold", "hold_for_s": 5},
    )

    setpoint: AnySetpoint

    @model_validator(mode="before")
    @classmethod
    def _check_setpoint_given(cls, data: Any) -> Any:
        if isinstance(data, dict) and "type" in data and "setpoint" not in cast(dict[str, Any], data):
            raise ValueError(
                "setpoint is missing: put type and the other fields of the setpoint into it, as in "
                '{"setpoint": {"type": "velocity", "velocity_ned_m_s": [1, 0, 0]}, "valid_for_s": 3}'
            )
        return data

    def to_stream_request(self, principal: Principal) -> StreamRequest:
        """Converts to the streamer's type."""
        setpoint = self.setpoint.to_setpoint()
        return StreamRequest(setpoint, self.valid_for_s, self.expiry(), principal.name, principal.key)


class StartRequest(SetpointRequest):
    """The first setpoint and the stream's settings; the validity starts when Offboard is confirmed."""

    model_config = example(
        setpoint={"type": "position", "position_ned_m": [0, 0, -10]}, valid_for_s=10, rate_hz=50
    )

    rate_hz: float = Field(
        default=50.0, allow_inf_nan=False, ge=2, le=100, description="Setpoints per second [Hz]."
    )
