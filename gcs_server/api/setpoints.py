"""Setpoints in requests: `{"setpoint": {…}, "valid_for_s": …, "on_expiry": {…}}`.

The kinds are the classes of `missions/setpoints.py`, with their limits and checks; this module adds `type`.
`offboard/start`, `offboard/setpoint` and the WebSocket accept one setpoint. The groups' routes accept the
same `valid_for_s` and `on_expiry`, with one setpoint for each member.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, cast

from pydantic import Field, GetCoreSchemaHandler, GetJsonSchemaHandler, model_validator
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from gcs_server.api.reflect import attribute_docs, describe_properties
from gcs_server.api.station import Station
from gcs_server.api.strict_body import StrictBody, example, make_strict
from gcs_server.control.accepted import authorized_command
from gcs_server.control.principal import Principal
from gcs_server.streamer.offboard.status import OffboardStatus, expiry_view, setpoint_view
from gcs_server.streamer.values.stream_request import OnExpiry, StreamRequest
from missions import setpoints as s
from missions.frames import q_from_euler

FRAME_TEXT = (
    "PX4 follows only the local frames 1 (LOCAL_NED) and 8 (BODY_NED) and the global frames 5, 6 and 11. The "
    "type of the setpoint selects the frame: position and velocity are local NED, velocity_body is relative "
    "to the heading, position_body is an offset from the current position (like MAVLink frames 7 and 9), "
    "position_global is latitude and longitude."
)
FORCE_TEXT = (
    "PX4 does not support force setpoints: with their flag (512) it ignores the acceleration. Remove "
    "this field and give acceleration_ned_m_s2 in m/s²."
)
MASK_TEXT = "The ignore bits follow from the fields: give null for what is not to be controlled."
MAVLINK_ONLY_FIELDS = {
    **dict.fromkeys(("frame", "coordinate_frame", "mav_frame"), FRAME_TEXT),
    **dict.fromkeys(("force", "force_ned_n", "is_force", "use_force"), FORCE_TEXT),
    **dict.fromkeys(("type_mask", "mask"), MASK_TEXT),
}
"""MAVLink fields that a client may send by mistake, with the text that explains the API's fields."""


def _refuse_mavlink_fields(data: Any) -> Any:
    if isinstance(data, dict):
        for name in cast(dict[object, object], data):
            if isinstance(name, str) and name in MAVLINK_ONLY_FIELDS:
                raise ValueError(f"{name}: {MAVLINK_ONLY_FIELDS[name]}")
    return data


def _refuse_contradictions(setpoint: Any) -> Any:
    contradiction = s.contradiction_of(setpoint)
    if contradiction is not None:
        raise ValueError(contradiction)
    return setpoint


class _Kind:
    """Makes the JSON of a setpoint class: its fields and `type`."""

    def __get_pydantic_core_schema__(
        self, kind: type[s.Setpoint], handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        reference = handler(kind)
        schema = cast(dict[str, Any], handler.resolve_ref_schema(reference))
        fields = schema["schema"]["fields"]
        if all(field["name"] != "type" for field in fields):  # the same class in another request
            literal = core_schema.literal_schema([kind.type])
            fields.insert(0, core_schema.dataclass_field("type", literal, init_only=True))
        make_strict(schema, handler)
        if kind is s.Path:  # a list of thousands of invalid points is not validated to its end
            fields[1]["schema"]["fail_fast"] = True
        checked = core_schema.no_info_after_validator_function(_refuse_contradictions, reference)
        return core_schema.no_info_before_validator_function(_refuse_mavlink_fields, checked)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        reference = handler(schema)
        json_schema = handler.resolve_ref_schema(reference)
        _describe(json_schema)
        if json_schema["title"] == s.Path.__name__:
            _describe(handler.resolve_ref_schema(json_schema["properties"]["points"]["items"]))
        return reference


def _describe(json_schema: JsonSchemaValue) -> None:
    """Describes the fields of a setpoint class by their docstrings."""
    describe_properties(json_schema["properties"], attribute_docs(getattr(s, json_schema["title"])))


Quaternion = tuple[s.Normalized, s.Normalized, s.Normalized, s.Normalized]


class AttitudeSetpoint(StrictBody):
    """An attitude, as a quaternion or as roll, pitch and yaw, with thrust."""

    model_config = example(type="attitude", roll_rad=0, pitch_rad=-0.1, yaw_ned_rad=0, thrust=0.5)

    type: Literal["attitude"]
    q_ned_frd: Quaternion | None = None
    """w, x, y, z of unit length, taking body FRD to NED; or the three angles."""
    roll_rad: s.Angle | None = None
    """Right side down is positive [rad]."""
    pitch_rad: Annotated[float, Field(ge=-math.pi / 2, le=math.pi / 2)] | None = None
    """Nose up is positive [rad]."""
    yaw_ned_rad: s.Angle | None = None
    """Heading clockwise from north [rad]."""
    yaw_rate_ned_rad_s: s.YawRate | None = None
    """Yaw rate feed-forward, clockwise about the vertical axis [rad/s]."""
    thrust: float = Field(ge=0, le=1)
    """Total thrust, 0 to 1, along the body's up axis."""

    @model_validator(mode="before")
    @classmethod
    def _check_fields(cls, data: Any) -> Any:
        return _refuse_mavlink_fields(data)

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
        """The attitude as a unit quaternion."""
        if self.q_ned_frd is not None:
            norm = math.hypot(*self.q_ned_frd)
            w, x, y, z = (each / norm for each in self.q_ned_frd)
            return s.Attitude((w, x, y, z), self.thrust, self.yaw_rate_ned_rad_s)
        assert self.roll_rad is not None
        assert self.pitch_rad is not None
        assert self.yaw_ned_rad is not None
        q = q_from_euler(self.roll_rad, self.pitch_rad, self.yaw_ned_rad)
        return s.Attitude(q, self.thrust, self.yaw_rate_ned_rad_s)


class _AttitudeBody:
    """Makes the JSON of an attitude, whose angles the class does not have."""

    def __get_pydantic_core_schema__(
        self, kind: type[s.Attitude], handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        body = handler.generate_schema(AttitudeSetpoint)
        return core_schema.no_info_after_validator_function(AttitudeSetpoint.to_setpoint, body)


_KIND = _Kind()
AnySetpoint = Annotated[
    Annotated[s.Position, _KIND]
    | Annotated[s.PositionGlobal, _KIND]
    | Annotated[s.PositionBody, _KIND]
    | Annotated[s.Velocity, _KIND]
    | Annotated[s.VelocityBody, _KIND]
    | Annotated[s.Acceleration, _KIND]
    | Annotated[s.Trajectory, _KIND]
    | Annotated[s.Attitude, _AttitudeBody()]
    | Annotated[s.Rates, _KIND]
    | Annotated[s.ThrustTorque, _KIND]
    | Annotated[s.Actuators, _KIND]
    | Annotated[s.Path, _KIND]
    | Annotated[s.Follow, _KIND]
    | Annotated[s.FollowDevice, _KIND],
    Field(discriminator="type"),
]
SCHEMA_NAMES = {"PathPoint": "PathPointBody"} | {
    kind.__name__: f"{kind.__name__}Setpoint" for kind in s.KINDS.values() if kind is not s.Attitude
}
"""Names of the setpoint classes in the OpenAPI description."""


class HoldOnExpiry(StrictBody):
    """Hold the position by setpoints, then switch to PX4's Hold mode; land if there is no position
    estimate."""

    action: Literal["hold"]
    hold_for_s: float = Field(default=5.0, ge=0, le=3600)
    """Time before Hold mode [s]."""


class LandOnExpiry(StrictBody):
    """Land at the current position."""

    action: Literal["land"]


class StopStreamOnExpiry(StrictBody):
    """Stop sending: the vehicle's own failsafe takes over."""

    action: Literal["stop_stream"]


AnyOnExpiry = Annotated[HoldOnExpiry | LandOnExpiry | StopStreamOnExpiry, Field(discriminator="action")]


class Validity(StrictBody):
    """How long setpoints are valid, and the action on expiry."""

    valid_for_s: float = Field(default=1.0, ge=0.05, le=3600)
    """Time until the setpoint expires if it is not renewed [s]; then `on_expiry` applies."""
    on_expiry: AnyOnExpiry = HoldOnExpiry(action="hold")
    """Action of the server when the setpoint has expired."""

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
        return StreamRequest(self.setpoint, self.valid_for_s, self.expiry(), principal.name, principal.key)

    def arguments(self) -> dict[str, object]:
        """The request for the journal."""
        return {
            "setpoint": setpoint_arguments(self.setpoint),
            "valid_for_s": self.valid_for_s,
            "on_expiry": expiry_view(self.expiry()),
        }


class StartRequest(SetpointRequest):
    """The first setpoint and the stream's settings; the validity starts when Offboard is confirmed."""

    model_config = example(
        setpoint={"type": "position", "position_ned_m": [0, 0, -10]}, valid_for_s=10, rate_hz=50
    )

    rate_hz: float = Field(default=50.0, ge=2, le=100)
    """Setpoints per second [Hz]."""

    def arguments(self) -> dict[str, object]:
        return {**super().arguments(), "rate_hz": self.rate_hz}


def setpoint_arguments(setpoint: s.Setpoint) -> dict[str, object]:
    """A setpoint for the journal; a path is replaced by its number of points."""
    if isinstance(setpoint, s.Path):
        return {"type": setpoint.type, "points": f"{len(setpoint.points)} points"}
    return setpoint_view(setpoint)


async def apply_setpoint(
    station: Station, principal: Principal, vehicle_id: str, body: SetpointRequest
) -> OffboardStatus:
    """Applies one setpoint, from HTTP or WebSocket."""
    with authorized_command(station, principal, "offboard/setpoint", vehicle_id, body.arguments):
        return await station.offboard(vehicle_id).setpoint(body.to_stream_request(principal))
