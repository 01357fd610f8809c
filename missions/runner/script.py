"""What the streams' process needs to fly a stretch of a mission: segments, and how they are steered.

Plain frozen values, handed over once; the rest is appended while the vehicle flies.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from missions.fence import FenceArea
from missions.frames import Vector3
from missions.offboard.segments import CurveSegment, Segment
from missions.setpoints import Estimate


@dataclass(frozen=True, slots=True)
class Pace:
    """How hard the vehicle may brake and speed up along its path when a mission is paused and resumed."""

    acceleration_m_s2: float = 3.0
    """Horizontal."""
    vertical_acceleration_m_s2: float = 3.0
    jerk_m_s3: float = 4.0


@dataclass(frozen=True, slots=True)
class Script:
    """Segments that are flown one after the other without leaving Offboard."""

    type: ClassVar[str] = "mission"
    needs: ClassVar[tuple[Estimate, ...]] = ("position", "velocity")
    name: str
    """Of the mission."""
    segments: tuple[Segment, ...]
    begin_s: float = 0.0
    """Where in the first segment the flight begins: a mission that is resumed goes on there."""
    approach: CurveSegment | None = None
    """Flown before the first segment: from where the vehicle is to where the segment begins."""
    pace: Pace = Pace()
    number: int = 0
    """Tells a mission's scripts apart."""
    fence: FenceArea | None = None
    """The mission's own geofence, which a detour around an obstacle keeps to."""


@dataclass(frozen=True, slots=True)
class Steering:
    """How a script is flown from now on."""

    paused: bool = False
    """Stand still on the path."""
    go_past: int = 0
    """Waits before this index of the script are over."""
    appended: tuple[Segment, ...] = ()
    """Segments added to the end of the script."""


@dataclass(frozen=True, slots=True)
class Played:
    """How far a script has been flown."""

    number: int = 0
    """Of the script."""
    index: int = 0
    """Of the segment that is flown; as many as there are segments: all are flown, the end is held."""
    t_s: float = 0.0
    """The mission's own time since that segment began; it stands still while paused."""
    rate: float = 1.0
    """Of the mission's time to real time: 1 flies as planned, 0 stands still."""
    approaching: bool = False
    """It flies to where the first segment begins."""
    waiting: bool = False
    """It holds at a wait that is not over."""
    diverted: bool = False
    """A velocity or attitude was interrupted: the vehicle holds where it has stopped, off its path."""
    position_ned_m: Vector3 | None = None
    """The position that is sent; None while none is."""
    held_back: bool = False
    """The vehicle is too far behind on its path: the mission's own time waits for it."""
