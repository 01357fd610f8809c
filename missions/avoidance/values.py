"""What avoidance is asked, and what it answers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from missions.fence import FenceArea, Region
from missions.frames import Vector3
from missions.setpoints import Position, Velocity

AvoidanceWay = Literal["over", "around"]
"""What is tried first: climb over an obstacle, or pass it at the same altitude (and never climb)."""
AvoidanceState = Literal["clear", "turning", "over", "around", "back", "stopped"]
"""clear: flies as wanted; turning: the nose into the direction of travel; over, around: the obstacle; back:
past it, returning to the path; stopped: holds its place."""

NOWHERE_LIMITED = Region()


@dataclass(frozen=True, slots=True)
class Here:
    """The vehicle now."""

    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    yaw_ned_rad: float


@dataclass(frozen=True, slots=True)
class Wanted:
    """The motion without obstacles."""

    position_ned_m: Vector3
    velocity_ned_m_s: Vector3 = (0.0, 0.0, 0.0)
    """Feed-forward."""
    yaw_ned_rad: float | None = None
    """None: not controlled."""
    ahead_ned_m: tuple[Vector3, ...] = ()
    """Where a path leads within the next seconds."""


@dataclass(frozen=True, slots=True)
class Allowed:
    """What a detour must keep to."""

    speed_m_s: float = math.inf
    climb_m_s: float = math.inf
    sink_m_s: float = math.inf
    region: Region = NOWHERE_LIMITED
    fence: FenceArea | None = None
    """Of the mission that is flown."""


@dataclass(frozen=True, slots=True)
class Adjusted:
    """What is to be flown instead."""

    state: AvoidanceState
    text: str = ""
    """For people; empty while it flies as wanted."""
    motion: Velocity | Position | None = None
    """None: as wanted."""
    yaw_ned_rad: float | None = None
    """None: as wanted."""
