"""Status of a stream in the API, the telemetry and on the page; its health compares the stream with its
requested rate, and the vehicle's state with the sent setpoints."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.streamer.offboard.limit_store import LimitsOrigin
from gcs_server.streamer.schedule.scheduler import StreamState
from gcs_server.streamer.values.limit_values import OperatorLimits, VehicleLimits
from gcs_server.streamer.values.stream_request import OnExpiry, StreamOwner
from gcs_server.vehicle.px4.stream_loss import DEFAULT_COM_OF_LOSS_T_S, StreamLoss
from missions.avoidance.values import AvoidanceState, AvoidanceWay
from missions.frames import Quaternion, Vector3, ned_from_heading
from missions.setpoints import (
    Actuators,
    Attitude,
    DirectSetpoint,
    Partial3,
    Position,
    PositionGlobal,
    Rates,
    Setpoint,
    ThrustTorque,
    Trajectory,
    Velocity,
    VelocityBody,
    complete_vector,
)


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


def health_of(state: StreamState, estimates: VehicleEstimates, failsafe: StreamLoss | None) -> StreamHealth:
    """Health of a stream, from its state and the vehicle's newest samples."""
    sent = state.sent
    loss_timeout_s = failsafe.loss_timeout_s if failsafe is not None else None
    left_s = None
    if state.sent_age_s is not None:
        left_s = (DEFAULT_COM_OF_LOSS_T_S if loss_timeout_s is None else loss_timeout_s) - state.sent_age_s
    attitude = estimates.attitude()
    return StreamHealth(
        rate_achieved_hz=state.rate_achieved_hz,
        setpoint_age_s=state.age_s,
        sent_age_s=state.sent_age_s,
        valid_left_s=state.valid_left_s,
        failsafe_in_s=None if left_s is None else max(0.0, left_s),
        echo=None if sent is None else _echo(sent, estimates),
        position_error_m=None if sent is None else _position_error(sent, estimates),
        velocity_error_m_s=None if sent is None else _velocity_error(sent, estimates),
        attitude_error_rad=(
            angle_between(sent.q_ned_frd, attitude.q_ned_frd)
            if isinstance(sent, Attitude) and attitude is not None
            else None
        ),
        yaw_error_rad=(
            None
            if attitude is None or (target := getattr(sent, "yaw_ned_rad", None)) is None
            else math.remainder(target - attitude.yaw_ned_rad, math.tau)
        ),
    )


def angle_between(a: Quaternion, b: Quaternion) -> float:
    """Angle of the single rotation between two attitudes [rad]."""
    dot = abs(sum(x * y for x, y in zip(a, b, strict=True)))
    return 2.0 * math.acos(min(1.0, dot))


def _echo(sent: DirectSetpoint, estimates: VehicleEstimates) -> Echo | None:
    if isinstance(sent, ThrustTorque | Actuators):
        return None  # PX4 reports no target of these types
    if isinstance(sent, Attitude | Rates):
        reported_attitude = estimates.target_attitude()
        if reported_attitude is None:
            return None
        attitude, age_s = reported_attitude
        return Echo(
            age_s,
            q_ned_frd=attitude.q_ned_frd,
            rates_frd_rad_s=attitude.rates_frd_rad_s,
            thrust=attitude.thrust,
        )
    reported = estimates.target_local()
    if reported is None:
        return None
    target, age_s = reported
    return Echo(
        age_s,
        target.position_ned_m,
        target.velocity_ned_m_s,
        target.acceleration_ned_m_s2,
        target.yaw_ned_rad,
    )


def _position_error(sent: DirectSetpoint, estimates: VehicleEstimates) -> float | None:
    local = estimates.local()
    if local is None:
        return None
    if isinstance(sent, PositionGlobal):
        origin = estimates.origin()
        if origin is None or sent.alt_amsl_m is None:
            return None
        return math.dist(origin.to_ned(sent.lat_deg, sent.lon_deg, sent.alt_amsl_m), local.position_ned_m)
    if not isinstance(sent, Position | Trajectory):
        return None
    return _distance(sent.position_ned_m, local.position_ned_m)


def _velocity_error(sent: DirectSetpoint, estimates: VehicleEstimates) -> float | None:
    local, attitude = estimates.local(), estimates.attitude()
    if local is None:
        return None
    if isinstance(sent, VelocityBody):
        if attitude is None:
            return None
        return math.dist(
            ned_from_heading(sent.velocity_frd_m_s, attitude.yaw_ned_rad), local.velocity_ned_m_s
        )
    if isinstance(sent, Velocity):
        return _distance(sent.velocity_ned_m_s, local.velocity_ned_m_s)
    if isinstance(sent, Trajectory) and complete_vector(sent.position_ned_m) is None:
        return _distance(sent.velocity_ned_m_s, local.velocity_ned_m_s)
    return None


def _distance(target: Partial3, measured: Vector3) -> float | None:
    """Distance over the controlled axes; None if no axis is controlled."""
    squares = [(t - m) ** 2 for t, m in zip(target, measured, strict=True) if t is not None]
    return math.sqrt(sum(squares)) if squares else None
