"""Status of a stream in the API, the telemetry and on the page."""

from __future__ import annotations

from dataclasses import dataclass, fields

from gcs_server.streamer.offboard.operator_limits import LimitsOrigin
from gcs_server.streamer.values.limit_values import OperatorLimits, VehicleLimits
from gcs_server.streamer.values.stream_request import OnExpiry, StreamOwner
from missions.avoidance.values import AvoidanceState, AvoidanceWay
from missions.frames import Quaternion, Vector3
from missions.setpoints import Partial3, Setpoint


@dataclass(frozen=True, slots=True)
class Echo:
    """The target that the vehicle's controllers report."""

    age_s: float
    """Time since the target was received [s]; large if the vehicle ignores the setpoints."""
    position_ned_m: Partial3 | None = None
    velocity_ned_m_s: Partial3 | None = None
    acceleration_ned_m_s2: Partial3 | None = None
    yaw_ned_rad: float | None = None
    q_ned_frd: Quaternion | None = None
    rates_frd_rad_s: Vector3 | None = None
    thrust: float | None = None


@dataclass(frozen=True, slots=True)
class StreamHealth:
    """Whether the stream reaches its rate, and whether the vehicle follows the setpoints."""

    rate_achieved_hz: float | None
    """Rate of setpoints passed to the link over the last two seconds [Hz]; a slow link drops a setpoint when
    a newer one replaces it."""
    setpoint_age_s: float | None
    """Time since the setpoint was accepted [s]."""
    sent_age_s: float | None
    """Time since the last sent setpoint [s]."""
    valid_left_s: float | None
    """Time until the setpoint expires [s]."""
    failsafe_in_s: float | None
    """Time until the vehicle's own failsafe acts if sending stops now: COM_OF_LOSS_T after the last setpoint
    [s]."""
    echo: Echo | None
    """POSITION_TARGET_LOCAL_NED or ATTITUDE_TARGET, matching the sent setpoint; null: nothing is sent, or
    the vehicle reports no target."""
    position_error_m: float | None
    """Distance between the vehicle and the sent position [m]."""
    velocity_error_m_s: float | None
    """Difference between the vehicle's velocity and the sent velocity [m/s]."""
    attitude_error_rad: float | None
    """Angle between the vehicle's attitude and the sent attitude [rad]."""
    yaw_error_rad: float | None
    """Angle between the vehicle's heading and the sent heading [rad]."""


@dataclass(frozen=True, slots=True)
class AvoidanceView:
    """Obstacle avoidance."""

    on: bool
    way: AvoidanceWay
    """What avoidance tries first: over an obstacle, or around it at the same altitude."""
    state: AvoidanceState | None
    """Current state; null while avoidance is off or nothing is streamed."""
    text: str
    """The state as text; empty while the vehicle flies the requested setpoint."""
    sensor: bool
    """Whether the vehicle has a sensor that measures obstacles. The obstacle brake also needs such a
    sensor."""


@dataclass(frozen=True, slots=True)
class OffboardStatus:
    """Status of a stream: the topic `offboard`, and the response of the routes below `…/offboard`."""

    streaming: bool
    """Whether setpoints are being sent."""
    state: str
    """idle, starting, streaming, interrupted (the vehicle has not followed its setpoints; the stream keeps
    it where it is), holding (the setpoint has expired, and the stream keeps the position), to_hold and
    landing (the stream requests Hold or Land), undoing (the start failed, but the vehicle may still switch to
    Offboard)."""
    client: str | None
    """Client that sent the setpoint."""
    client_key: str | None
    """Distinguishes clients with the same name."""
    owner: StreamOwner | None
    """operator: a client flies this vehicle; group: setpoints come through `/groups` only; mission: an
    offboard mission flies it."""
    ordered_type: str | None
    """Type of the requested setpoint; the sent type may differ (path, follow, after expiry)."""
    setpoint: dict[str, object] | None
    """The setpoint that is being sent: the client's setpoint within all limits, or the position that is
    kept after expiry."""
    limited: tuple[str, ...]
    """Current reductions by the limits, as texts; empty if nothing is limited."""
    rate_hz: float
    rate_achieved_hz: float | None
    age_s: float | None
    valid_for_s: float | None
    valid_left_s: float | None
    on_expiry: dict[str, object] | None
    if_stream_stops: str | None
    """The vehicle's own action when the stream stops; null if unknown."""
    sends_failed: int
    """Number of setpoints that could not be passed to the link."""
    ended: str | None
    """Reason for the end of the last stream; null while a stream runs, and before the first one."""
    limits_origin: LimitsOrigin
    """Origin of the operator's limits: the client that set them, the time, and whether they survive a
    restart."""
    avoidance: AvoidanceView
    health: StreamHealth


@dataclass(frozen=True, slots=True)
class OffboardLimits:
    """The limits for setpoints."""

    vehicle: VehicleLimits
    operator: OperatorLimits
    origin: LimitsOrigin
    """Origin of the operator's limits."""


@dataclass(frozen=True, slots=True)
class FailsafeView:
    """The vehicle's own action when the stream stops."""

    after_s: float | None
    """COM_OF_LOSS_T; null if unknown."""
    action: str | None
    """COM_OBL_RC_ACT as a mode: position, altitude, stabilized, rtl, land, hold, terminate, disarm."""
    transmitter: bool
    """Whether an RC transmitter is connected. Without one, the vehicle descends in modes that need sticks."""
    words: str


def expiry_view(on_expiry: OnExpiry) -> dict[str, object]:
    """The action on expiry, in the format of the API."""
    if on_expiry.action == "hold":
        return {"action": "hold", "hold_for_s": on_expiry.hold_for_s}
    return {"action": on_expiry.action}


def setpoint_view(setpoint: Setpoint) -> dict[str, object]:
    """A setpoint in the format of the API, without uncontrolled fields."""
    values = {each.name: getattr(setpoint, each.name) for each in fields(setpoint)}
    return {"type": setpoint.type, **{name: value for name, value in values.items() if value is not None}}
