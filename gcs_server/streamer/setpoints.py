"""What may be streamed, one frozen class a kind, and the order that carries it.

Names say quantity, frame and unit: NED from the vehicle's local origin, FRD of its body (`_body` kinds: of
its heading, level). None is "not controlled" (MAVLink's ignore bits, NaN in PX4). Where a kind holds several
quantities their order is their priority: position over velocity over acceleration, the lower ones as
feed-forward. With neither yaw nor yaw rate the heading of the moment is kept.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

Vector3 = tuple[float, float, float]
Partial3 = tuple[float | None, float | None, float | None]
"""A vector of which an axis may be left uncontrolled."""
Quaternion = tuple[float, float, float, float]
NOTHING: Partial3 = (None, None, None)
FOLLOW_MIN_DISTANCE_M = 2.0


@dataclass(frozen=True, slots=True)
class Position:
    """A place in the local frame."""

    type: ClassVar[str] = "position"
    position_ned_m: Partial3
    yaw_ned_rad: float | None = None
    yaw_rate_ned_rad_s: float | None = None


@dataclass(frozen=True, slots=True)
class PositionGlobal:
    """A place on the earth; exactly one altitude."""

    type: ClassVar[str] = "position_global"
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float | None = None
    alt_home_m: float | None = None
    yaw_ned_rad: float | None = None
    yaw_rate_ned_rad_s: float | None = None


@dataclass(frozen=True, slots=True)
class PositionBody:
    """An offset from where the vehicle is when the order is taken, along its heading then."""

    type: ClassVar[str] = "position_body"
    offset_frd_m: Vector3
    yaw_offset_rad: float | None = None
    """Turned by this from the heading then; kept unless given."""


@dataclass(frozen=True, slots=True)
class Velocity:
    """A velocity in the local frame."""

    type: ClassVar[str] = "velocity"
    velocity_ned_m_s: Partial3
    yaw_ned_rad: float | None = None
    yaw_rate_ned_rad_s: float | None = None


@dataclass(frozen=True, slots=True)
class VelocityBody:
    """A velocity along the heading, level; it turns with the vehicle."""

    type: ClassVar[str] = "velocity_body"
    velocity_frd_m_s: Vector3
    yaw_ned_rad: float | None = None
    yaw_rate_ned_rad_s: float | None = None


@dataclass(frozen=True, slots=True)
class Acceleration:
    """An acceleration in the local frame, gravity left out: zero hovers (and drifts)."""

    type: ClassVar[str] = "acceleration"
    acceleration_ned_m_s2: Partial3
    yaw_ned_rad: float | None = None
    yaw_rate_ned_rad_s: float | None = None


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Position, velocity and acceleration together, each axis with at least one of them."""

    type: ClassVar[str] = "trajectory"
    position_ned_m: Partial3 = NOTHING
    velocity_ned_m_s: Partial3 = NOTHING
    acceleration_ned_m_s2: Partial3 = NOTHING
    yaw_ned_rad: float | None = None
    yaw_rate_ned_rad_s: float | None = None


@dataclass(frozen=True, slots=True)
class Attitude:
    """An attitude with the thrust of all rotors together."""

    type: ClassVar[str] = "attitude"
    q_ned_frd: Quaternion
    """w, x, y, z, of unit length; takes body FRD to NED."""
    thrust: float
    """0 to 1, along the body's up."""
    yaw_rate_ned_rad_s: float | None = None
    """Feed-forward, about the earth's down (PX4's `yaw_sp_move_rate`)."""


@dataclass(frozen=True, slots=True)
class Rates:
    """Turning rates about the body's axes with thrust."""

    type: ClassVar[str] = "rates"
    rates_frd_rad_s: Vector3
    thrust: float


@dataclass(frozen=True, slots=True)
class ThrustTorque:
    """Thrust and torque, normalised to -1..1."""

    type: ClassVar[str] = "thrust_torque"
    thrust_frd: Vector3
    torque_frd: Vector3


@dataclass(frozen=True, slots=True)
class Actuators:
    """Motors and servos each by itself, normalised to -1..1; None is disarmed."""

    type: ClassVar[str] = "actuators"
    motors: tuple[float | None, ...] = ()
    servos: tuple[float | None, ...] = ()


@dataclass(frozen=True, slots=True)
class PathPoint:
    """Where to be, and when."""

    t_s: float
    """Since the path began."""
    position_ned_m: Vector3
    yaw_ned_rad: float | None = None


@dataclass(frozen=True, slots=True)
class Path:
    """A curve through points in time, sampled at every sending; its last point is then held.

    A client that dies does not stop it: validity counts from its end.
    """

    type: ClassVar[str] = "path"
    points: tuple[PathPoint, ...]

    @property
    def duration_s(self) -> float:
        """From its begin to its last point."""
        return self.points[-1].t_s


@dataclass(frozen=True, slots=True)
class Follow:
    """A place beside another vehicle, that moves with it."""

    type: ClassVar[str] = "follow"
    vehicle: str
    """The id of the one that is followed."""
    offset_ned_m: Vector3 | None = None
    """From it, by compass; or:"""
    offset_frd_m: Vector3 | None = None
    """From it, along its heading."""
    yaw: str = "keep"
    """keep, same (as the other's heading), face (look at it)."""


Sendable = Position | PositionGlobal | Velocity | VelocityBody | Acceleration | Trajectory | Attitude | Rates
"""What a MAVLink message carries as it is."""
Setpoint = Sendable | PositionBody | ThrustTorque | Actuators | Path | Follow
"""What may be ordered."""
TYPES: dict[str, type] = {
    kind.type: kind
    for kind in (
        Position,
        PositionGlobal,
        PositionBody,
        Velocity,
        VelocityBody,
        Acceleration,
        Trajectory,
        Attitude,
        Rates,
        ThrustTorque,
        Actuators,
        Path,
        Follow,
    )
}


@dataclass(frozen=True, slots=True)
class OnExpiry:
    """What the stream does by itself when a setpoint has become too old."""

    action: str = "hold"
    """hold, land, stop_stream."""
    hold_for_s: float = 5.0
    """With `hold`: how long position setpoints hold the place before PX4's own Hold mode is asked for."""


@dataclass(frozen=True, slots=True)
class Order:
    """A setpoint, for how long it is good, what comes after, and whose it is."""

    setpoint: Setpoint
    valid_for_s: float = 1.0
    on_expiry: OnExpiry = OnExpiry()
    client: str = ""
    client_key: str = ""
    """Tells the client from others of its name; empty where nobody is meant."""

    @property
    def lasts_s(self) -> float:
        """From being taken to expiry: a path's validity begins at its end."""
        return self.valid_for_s + (self.setpoint.duration_s if isinstance(self.setpoint, Path) else 0.0)


def is_complete(vector: Partial3) -> bool:
    """Whether all three axes are controlled."""
    return all(axis is not None for axis in vector)


def complete(vector: Partial3) -> Vector3 | None:
    """The vector, where all its axes are controlled."""
    x, y, z = vector
    return None if x is None or y is None or z is None else (x, y, z)


def zeros_for_none(vector: Partial3) -> Vector3:
    """Zero where an axis is not controlled (its ignore bit says so)."""
    return (vector[0] or 0.0, vector[1] or 0.0, vector[2] or 0.0)
