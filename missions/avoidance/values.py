"""Inputs and outputs of obstacle avoidance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from missions.fence import FenceArea, Region
from missions.frames import Vector3
from missions.setpoints import Position, Velocity

AvoidanceWay = Literal["over", "around"]
"""over: climb over obstacles first; around: pass obstacles at the same altitude, never climb."""
AvoidanceState = Literal["clear", "turning", "over", "around", "back", "stopped"]
"""clear: flies the wanted motion; turning: turns the sensors to the direction of travel; over, around: flies
over or around the obstacle; back: returns to the path; stopped: the vehicle holds its position."""

UNLIMITED = Region()
STOPPING_M_S2, STOPPING_DELAY_S = 1.2, 0.8
"""Horizontal deceleration and delay measured on PX4 when a velocity setpoint is reduced. A stop by a position
is faster (`STOP_M_S2` in `missions/separation.py`): the separation guard commands that one."""


def braking_speed(
    distance_m: float, decel_m_s2: float = STOPPING_M_S2, delay_s: float = STOPPING_DELAY_S
) -> float:
    """The highest speed [m/s] from which the vehicle stops within a distance."""
    lag = decel_m_s2 * delay_s
    return max(0.0, -lag + math.sqrt(lag**2 + 2.0 * decel_m_s2 * max(0.0, distance_m)))


@dataclass(frozen=True, slots=True)
class MotionState:
    """Position and motion of the vehicle."""

    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    yaw_ned_rad: float


@dataclass(frozen=True, slots=True)
class WantedMotion:
    """The motion without obstacles."""

    position_ned_m: Vector3
    velocity_ned_m_s: Vector3 = (0.0, 0.0, 0.0)
    """Feed-forward."""
    yaw_ned_rad: float | None = None
    """None: not controlled."""
    ahead_ned_m: tuple[Vector3, ...] = ()
    """Positions of the path within the next seconds."""


@dataclass(frozen=True, slots=True)
class DetourLimits:
    """Limits of a detour."""

    speed_m_s: float = math.inf
    climb_m_s: float = math.inf
    descent_m_s: float = math.inf
    region: Region = UNLIMITED
    fence: FenceArea | None = None
    """Fence of the active mission."""


@dataclass(frozen=True, slots=True)
class AdjustedMotion:
    """The motion to fly instead of the wanted one."""

    state: AvoidanceState
    text: str = ""
    """Message for the pilot; empty while the wanted motion is flown."""
    motion: Velocity | Position | None = None
    """None: the wanted motion."""
    yaw_ned_rad: float | None = None
    """None: the wanted yaw."""
