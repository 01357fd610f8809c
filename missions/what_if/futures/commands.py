"""The commands whose futures can be flown; positions and angles in the vehicle's local NED frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from missions.frames import Quaternion, Vector3
from missions.setpoints import DirectSetpoint

ARRIVED_M = 1.0
"""A flight has arrived if its estimated position is this near to the target [m]."""


@dataclass(frozen=True, slots=True)
class GoTo:
    """Hold mode's flight to a position (DO_REPOSITION), also a change of altitude."""

    target_ned_m: Vector3
    yaw_ned_rad: float | None = None
    """None: the nose points to the target, where MPC_YAW_MODE lets it."""
    speed_m_s: float | None = None
    """None: MPC_XY_CRUISE."""


@dataclass(frozen=True, slots=True)
class Hold:
    """Hold mode: brakes, and keeps the position."""


@dataclass(frozen=True, slots=True)
class Land:
    """Land mode: brakes, and descends to the ground."""


OrbitYaw = Literal["center", "initial", "uncontrolled", "tangent"]
ORBIT_YAWS: tuple[OrbitYaw, ...] = ("center", "initial", "uncontrolled", "tangent")
"""By the value of MC_ORBIT_YAW_MOD."""


@dataclass(frozen=True, slots=True)
class Orbit:
    """Orbit mode (DO_ORBIT): to the nearest point of a circle, then around it."""

    centre_ned_m: Vector3
    """With the altitude of the circle."""
    radius_m: float
    speed_m_s: float
    """Positive: clockwise, seen from above."""
    yaw: OrbitYaw | None = None
    """Where the nose points; None: as MC_ORBIT_YAW_MOD says."""


ModeCommand = GoTo | Hold | Land | Orbit
"""Commands that PX4's own modes fly."""


@dataclass(frozen=True, slots=True)
class FlightState:
    """The estimated state of the flight without deviations, for which a stream's setpoints are computed."""

    t_s: float
    """Since the begin [s]."""
    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    yaw_ned_rad: float
    q_ned_frd: Quaternion


StreamedSetpoint = Callable[[FlightState], DirectSetpoint]
"""The setpoint that a stream sends, in the local frame."""
