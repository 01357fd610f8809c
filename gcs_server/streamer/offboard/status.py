"""How a stream stands, as the API, the telemetry and the page see it."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from gcs_server.streamer.offboard.operator_limits import LimitsOrigin
from gcs_server.streamer.values.limit_values import OperatorLimits, VehicleLimits
from gcs_server.streamer.values.order import OnExpiry, StreamOwner
from missions.avoidance.values import AvoidanceState, AvoidanceWay
from missions.frames import Quaternion, Vector3
from missions.setpoints import DirectSetpoint, Partial3


@dataclass(frozen=True, slots=True)
class Echo:
    """The target that the vehicle's controllers say they follow."""

    age_s: float
    """Since it was heard; the page's word for a vehicle that ignores us."""
    position_ned_m: Partial3 | None = None
    velocity_ned_m_s: Partial3 | None = None
    acceleration_ned_m_s2: Partial3 | None = None
    yaw_ned_rad: float | None = None
    q_ned_frd: Quaternion | None = None
    rates_frd_rad_s: Vector3 | None = None
    thrust: float | None = None


@dataclass(frozen=True, slots=True)
class StreamHealth:
    """Whether the stream does what it should, and the vehicle what the stream says."""

    rate_achieved_hz: float | None
    """Over the last two seconds, as handed to the link; a slow link leaves out what a newer one replaces."""
    setpoint_age_s: float | None
    """Since the order was taken."""
    sent_age_s: float | None
    """Since a setpoint last went out."""
    valid_left_s: float | None
    """Until the order expires."""
    failsafe_in_s: float | None
    """Until the vehicle's own failsafe (COM_OF_LOSS_T after the last one), were nothing sent from now on."""
    echo: Echo | None
    """POSITION_TARGET_LOCAL_NED or ATTITUDE_TARGET, whichever fits what is sent; None while nothing is."""
    position_error_m: float | None
    """From where it is to the position that is sent."""
    velocity_error_m_s: float | None
    """Between its velocity and the one that is sent."""
    attitude_error_rad: float | None
    """Angle between its attitude and the one that is sent."""
    yaw_error_rad: float | None
    """Between its heading and the one that is sent."""


@dataclass(frozen=True, slots=True)
class AvoidanceView:
    """Obstacle avoidance."""

    on: bool
    way: AvoidanceWay
    """What is tried first: over an obstacle, or around it at the same altitude."""
    state: AvoidanceState | None
    """What it does now; null while it is off or nothing is streamed."""
    text: str
    """The same for people; empty while it flies as ordered."""
    sensor: bool
    """Whether the vehicle has a sensor that sees obstacles; the obstacle brake needs one, too."""


@dataclass(frozen=True, slots=True)
class OffboardStatus:
    """The topic `offboard`, and what the calls below `…/offboard` answer."""

    streaming: bool
    """Whether setpoints go out to the vehicle now."""
    state: str
    """idle, starting, streaming, holding (expired, place held), to_hold, landing (mode asked for), undoing
    (the start failed, but the vehicle may yet take Offboard)."""
    client: str | None
    """Whose setpoint it is."""
    client_key: str | None
    """Tells the client from others of its name."""
    owner: StreamOwner | None
    """operator: a client that flies this vehicle alone; group: setpoints come through `/groups` only."""
    ordered_type: str | None
    """The type of the setpoint that was ordered; what goes out may be another (path, follow, an expiry)."""
    setpoint: dict[str, object] | None
    """What goes out now: the client's within its limits, or the place held after it expired."""
    limited: tuple[str, ...]
    """What the limits take away from the order now, in words; empty where nothing."""
    rate_hz: float
    rate_achieved_hz: float | None
    age_s: float | None
    valid_for_s: float | None
    valid_left_s: float | None
    on_expiry: dict[str, object] | None
    if_stream_stops: str | None
    """What the vehicle will do by itself, in words; None before it was asked."""
    sends_failed: int
    """Setpoints that could not be handed to the link."""
    ended: str | None
    """Why the last stream ended; None while one runs or before the first."""
    limits_origin: LimitsOrigin
    """Whether limits of the operator's are in force, by whom and when they were set, whether a restart kept
    them."""
    avoidance: AvoidanceView
    health: StreamHealth


@dataclass(frozen=True, slots=True)
class Limits:
    """What setpoints are held to."""

    vehicle: VehicleLimits
    operator: OperatorLimits
    origin: LimitsOrigin
    """Of the operator's."""


@dataclass(frozen=True, slots=True)
class FailsafeView:
    """What the vehicle does by itself when the stream stops."""

    after_s: float | None
    """COM_OF_LOSS_T; None where it did not tell."""
    action: str | None
    """COM_OBL_RC_ACT as a mode: position, altitude, stabilized, rtl, land, hold, terminate, disarm."""
    transmitter: bool
    """Whether a transmitter is heard: without one the modes flown by sticks come down by themselves."""
    words: str


def expiry_view(on_expiry: OnExpiry) -> dict[str, object]:
    """As the API takes it."""
    if on_expiry.action == "hold":
        return {"action": "hold", "hold_for_s": on_expiry.hold_for_s}
    return {"action": on_expiry.action}


def setpoint_view(sent: DirectSetpoint | None) -> dict[str, object] | None:
    """A setpoint as the API shows it, what it does not control left out."""
    if sent is None:
        return None
    return {"type": sent.type, **{k: v for k, v in asdict(sent).items() if v is not None}}
