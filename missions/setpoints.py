"""Offboard setpoints, one frozen class for each kind, independent of the protocol that carries them.

Field names contain quantity, frame and unit. NED is relative to the vehicle's local origin. FRD is the body
frame; in kinds whose name ends in `_body`, FRD is the level heading frame. None means "not controlled" (an
ignore bit in MAVLink, NaN in PX4). If several quantities are given, PX4 controls the first one in the order
position, velocity, acceleration; the others are feed-forward. Without yaw and yaw rate the vehicle keeps its
heading.

`type` is the name of a kind in the API, on the page and in plans. `needs` are the estimates that a kind
requires, in PX4 or for the conversion to a `DirectSetpoint`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, get_args

from missions.frames import Quaternion, Vector3

Partial3 = tuple[float | None, float | None, float | None]
"""A vector in which each axis may be left uncontrolled."""
UNCONTROLLED: Partial3 = (None, None, None)
FOLLOW_MIN_DISTANCE_M = 2.0
Estimate = Literal["position", "velocity", "heading", "global_position", "home"]
"""An estimate that the vehicle must have."""


@dataclass(frozen=True, slots=True)
class Position:
    """A position in the local frame."""

    type: ClassVar[str] = "position"
    needs: ClassVar[tuple[Estimate, ...]] = ("position", "velocity")
    position_ned_m: Partial3
    yaw_ned_rad: float | None = None
    yaw_rate_ned_rad_s: float | None = None


@dataclass(frozen=True, slots=True)
class PositionGlobal:
    """A global position, with exactly one of the two altitudes."""

    type: ClassVar[str] = "position_global"
    needs: ClassVar[tuple[Estimate, ...]] = ("position", "velocity", "global_position")
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
    needs: ClassVar[tuple[Estimate, ...]] = ("position", "velocity", "heading")
    offset_frd_m: Vector3
    yaw_offset_rad: float | None = None
    """Angle added to the heading; None: keep the heading."""


@dataclass(frozen=True, slots=True)
class Velocity:
    """A velocity in the local frame."""

    type: ClassVar[str] = "velocity"
    needs: ClassVar[tuple[Estimate, ...]] = ("velocity",)
    velocity_ned_m_s: Partial3
    yaw_ned_rad: float | None = None
    yaw_rate_ned_rad_s: float | None = None


@dataclass(frozen=True, slots=True)
class VelocityBody:
    """A velocity in the level heading frame, which turns with the vehicle."""

    type: ClassVar[str] = "velocity_body"
    needs: ClassVar[tuple[Estimate, ...]] = ("velocity", "heading")
    velocity_frd_m_s: Vector3
    yaw_ned_rad: float | None = None
    yaw_rate_ned_rad_s: float | None = None


@dataclass(frozen=True, slots=True)
class Acceleration:
    """An acceleration in the local frame, without gravity.

    PX4 tilts the vehicle accordingly and does not compensate drag: the vehicle approaches the velocity at
    which drag equals the acceleration. Zero lets the vehicle slow down by drag; it does not hold the
    position.
    """

    type: ClassVar[str] = "acceleration"
    needs: ClassVar[tuple[Estimate, ...]] = ("velocity",)
    acceleration_ned_m_s2: Partial3
    yaw_ned_rad: float | None = None
    yaw_rate_ned_rad_s: float | None = None


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Position, velocity and acceleration together; each axis has at least one of these quantities."""

    type: ClassVar[str] = "trajectory"
    needs: ClassVar[tuple[Estimate, ...]] = ("position", "velocity")
    position_ned_m: Partial3 = UNCONTROLLED
    velocity_ned_m_s: Partial3 = UNCONTROLLED
    acceleration_ned_m_s2: Partial3 = UNCONTROLLED
    yaw_ned_rad: float | None = None
    yaw_rate_ned_rad_s: float | None = None


@dataclass(frozen=True, slots=True)
class Attitude:
    """An attitude with the collective thrust."""

    type: ClassVar[str] = "attitude"
    needs: ClassVar[tuple[Estimate, ...]] = ("heading",)
    q_ned_frd: Quaternion
    thrust: float
    """0 to 1, along the body's up axis."""
    yaw_rate_ned_rad_s: float | None = None
    """Yaw rate feed-forward about the vertical axis (PX4's `yaw_sp_move_rate`)."""


@dataclass(frozen=True, slots=True)
class Rates:
    """Body rates (roll, pitch, yaw) with the collective thrust."""

    type: ClassVar[str] = "rates"
    needs: ClassVar[tuple[Estimate, ...]] = ("heading",)
    rates_frd_rad_s: Vector3
    thrust: float


@dataclass(frozen=True, slots=True)
class ThrustTorque:
    """Thrust and torque of the body, normalised to -1..1."""

    type: ClassVar[str] = "thrust_torque"
    needs: ClassVar[tuple[Estimate, ...]] = ()
    thrust_frd: Vector3
    torque_frd: Vector3


@dataclass(frozen=True, slots=True)
class Actuators:
    """A value for each motor and servo, normalised to -1..1; None: disarmed."""

    type: ClassVar[str] = "actuators"
    needs: ClassVar[tuple[Estimate, ...]] = ()
    motors: tuple[float | None, ...] = ()
    servos: tuple[float | None, ...] = ()


@dataclass(frozen=True, slots=True)
class PathPoint:
    """A position at a time."""

    t_s: float
    """Time since the start of the path."""
    position_ned_m: Vector3
    yaw_ned_rad: float | None = None


@dataclass(frozen=True, slots=True)
class Path:
    """A curve through timed points (`curves.PathCurve`); at the end the vehicle holds the last point."""

    type: ClassVar[str] = "path"
    needs: ClassVar[tuple[Estimate, ...]] = ("position", "velocity")
    points: tuple[PathPoint, ...]

    @property
    def duration_s(self) -> float:
        """Time from the first point to the last."""
        return self.points[-1].t_s


@dataclass(frozen=True, slots=True)
class Follow:
    """A position relative to another vehicle, with exactly one of the two offsets; the position moves with
    that vehicle."""

    type: ClassVar[str] = "follow"
    needs: ClassVar[tuple[Estimate, ...]] = ("position", "velocity", "global_position")
    vehicle: str
    """Id of the vehicle to follow."""
    offset_ned_m: Vector3 | None = None
    offset_frd_m: Vector3 | None = None
    """Offset in the other vehicle's heading frame."""
    yaw: str = "keep"
    """keep: keep the heading; same: the other vehicle's heading; face: towards the other vehicle."""


DirectSetpoint = (
    Position
    | PositionGlobal
    | Velocity
    | VelocityBody
    | Acceleration
    | Trajectory
    | Attitude
    | Rates
    | ThrustTorque
    | Actuators
)
"""Kinds that are sent without conversion, if the vehicle's link carries them."""
Setpoint = DirectSetpoint | PositionBody | Path | Follow
"""Every kind."""
KINDS: dict[str, type[Setpoint]] = {kind.type: kind for kind in get_args(Setpoint)}
"""Every kind by its `type`."""


def needs_of(setpoint: Setpoint) -> tuple[Estimate, ...]:
    """The estimates that one setpoint needs; they depend on its kind and on the given fields."""
    if isinstance(setpoint, Trajectory) and all(axis is None for axis in setpoint.position_ned_m):
        return (Velocity if any(setpoint.velocity_ned_m_s) else Acceleration).needs
    if isinstance(setpoint, PositionGlobal) and setpoint.alt_home_m is not None:
        return (*setpoint.needs, "home")
    if isinstance(setpoint, Follow) and setpoint.yaw == "keep":
        return (*setpoint.needs, "heading")
    return setpoint.needs


def complete_vector(vector: Partial3) -> Vector3 | None:
    """The vector if all its axes are controlled, otherwise None."""
    x, y, z = vector
    return None if x is None or y is None or z is None else (x, y, z)


def zeros_for_none(vector: Partial3) -> Vector3:
    """The vector with zero on each axis that is not controlled."""
    return (vector[0] or 0.0, vector[1] or 0.0, vector[2] or 0.0)
