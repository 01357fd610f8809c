"""Offboard setpoints, one frozen class a kind, whatever carries them.

Field names say quantity, frame and unit: NED from the vehicle's local origin; FRD of the body, in the
`_body` kinds of the level heading frame. None means "not controlled" (an ignore bit in MAVLink, NaN in PX4).
Where a kind has several quantities, position goes before velocity and velocity before acceleration; the lower
ones are feed-forward. With neither yaw nor yaw rate the vehicle keeps its present heading.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, get_args

from missions.frames import Quaternion, Vector3

Partial3 = tuple[float | None, float | None, float | None]
"""A vector in which each axis may be left uncontrolled."""
NOTHING: Partial3 = (None, None, None)
FOLLOW_MIN_DISTANCE_M = 2.0


@dataclass(frozen=True, slots=True)
class Position:
    """A position in the local frame."""

    type: ClassVar[str] = "position"
    position_ned_m: Partial3
    yaw_ned_rad: float | None = None
    yaw_rate_ned_rad_s: float | None = None


@dataclass(frozen=True, slots=True)
class PositionGlobal:
    """A position on the earth, with exactly one of the two altitudes."""

    type: ClassVar[str] = "position_global"
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float | None = None
    alt_home_m: float | None = None
    yaw_ned_rad: float | None = None
    yaw_rate_ned_rad_s: float | None = None


@dataclass(frozen=True, slots=True)
class PositionBody:
    """An offset from the vehicle's position at the time of the setpoint, along its heading at that time."""

    type: ClassVar[str] = "position_body"
    offset_frd_m: Vector3
    yaw_offset_rad: float | None = None
    """Added to the heading; None keeps the heading."""


@dataclass(frozen=True, slots=True)
class Velocity:
    """A velocity in the local frame."""

    type: ClassVar[str] = "velocity"
    velocity_ned_m_s: Partial3
    yaw_ned_rad: float | None = None
    yaw_rate_ned_rad_s: float | None = None


@dataclass(frozen=True, slots=True)
class VelocityBody:
    """A velocity in the level heading frame; it turns with the vehicle."""

    type: ClassVar[str] = "velocity_body"
    velocity_frd_m_s: Vector3
    yaw_ned_rad: float | None = None
    yaw_rate_ned_rad_s: float | None = None


@dataclass(frozen=True, slots=True)
class Acceleration:
    """An acceleration in the local frame without gravity: zero keeps the velocity, not the position."""

    type: ClassVar[str] = "acceleration"
    acceleration_ned_m_s2: Partial3
    yaw_ned_rad: float | None = None
    yaw_rate_ned_rad_s: float | None = None


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Position, velocity and acceleration together; each axis has at least one of them."""

    type: ClassVar[str] = "trajectory"
    position_ned_m: Partial3 = NOTHING
    velocity_ned_m_s: Partial3 = NOTHING
    acceleration_ned_m_s2: Partial3 = NOTHING
    yaw_ned_rad: float | None = None
    yaw_rate_ned_rad_s: float | None = None


@dataclass(frozen=True, slots=True)
class Attitude:
    """An attitude with the collective thrust."""

    type: ClassVar[str] = "attitude"
    q_ned_frd: Quaternion
    thrust: float
    """0 to 1, along the body's up axis."""
    yaw_rate_ned_rad_s: float | None = None
    """Feed-forward about the earth's down axis (PX4's `yaw_sp_move_rate`)."""


@dataclass(frozen=True, slots=True)
class Rates:
    """Body rates (roll, pitch, yaw) with the collective thrust."""

    type: ClassVar[str] = "rates"
    rates_frd_rad_s: Vector3
    thrust: float


@dataclass(frozen=True, slots=True)
class ThrustTorque:
    """Thrust and torque of the body, normalised to -1..1."""

    type: ClassVar[str] = "thrust_torque"
    thrust_frd: Vector3
    torque_frd: Vector3


@dataclass(frozen=True, slots=True)
class Actuators:
    """Each motor and servo by itself, normalised to -1..1; None is disarmed."""

    type: ClassVar[str] = "actuators"
    motors: tuple[float | None, ...] = ()
    servos: tuple[float | None, ...] = ()


@dataclass(frozen=True, slots=True)
class PathPoint:
    """A position at a time."""

    t_s: float
    """Since the start of the path."""
    position_ned_m: Vector3
    yaw_ned_rad: float | None = None


@dataclass(frozen=True, slots=True)
class Path:
    """A curve through points in time (`curves.PathCurve`); the vehicle holds its last point afterwards."""

    type: ClassVar[str] = "path"
    points: tuple[PathPoint, ...]

    @property
    def duration_s(self) -> float:
        """From the first point to the last."""
        return self.points[-1].t_s


@dataclass(frozen=True, slots=True)
class Follow:
    """A position relative to another vehicle; it moves with that vehicle. Exactly one of the two offsets."""

    type: ClassVar[str] = "follow"
    vehicle: str
    """The id of the vehicle that is followed."""
    offset_ned_m: Vector3 | None = None
    offset_frd_m: Vector3 | None = None
    """Along the other vehicle's heading."""
    yaw: str = "keep"
    """keep (the heading), same (as the other vehicle's), face (the other vehicle)."""


DirectSetpoint = (
    Position | PositionGlobal | Velocity | VelocityBody | Acceleration | Trajectory | Attitude | Rates
)
"""Kinds that are sent as they are."""
Setpoint = DirectSetpoint | PositionBody | ThrustTorque | Actuators | Path | Follow
"""Every kind."""
KINDS: dict[str, type[Setpoint]] = {kind.type: kind for kind in get_args(Setpoint)}
"""Every kind by the name that the API, the page and plans give it."""


def complete(vector: Partial3) -> Vector3 | None:
    """The vector where all its axes are controlled, else None."""
    x, y, z = vector
    return None if x is None or y is None or z is None else (x, y, z)


def zeros_for_none(vector: Partial3) -> Vector3:
    """The vector with zero on each axis that is not controlled."""
    return (vector[0] or 0.0, vector[1] or 0.0, vector[2] or 0.0)
