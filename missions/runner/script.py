"""Messages to the stream process: the segments to fly, and changes during the flight.

The messages are frozen values. The first segments are sent immediately, later segments are appended during
the flight.
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
    """Limits for braking and accelerating along the path when a mission is paused and resumed."""

    acceleration_m_s2: float = 3.0
    """Horizontal."""
    vertical_acceleration_m_s2: float = 3.0
    jerk_m_s3: float = 4.0


@dataclass(frozen=True, slots=True)
class Script:
    """Segments that are flown in order without leaving Offboard."""

    type: ClassVar[str] = "mission"
    needs: ClassVar[tuple[Estimate, ...]] = ("position", "velocity")
    name: str
    """Name of the mission."""
    segments: tuple[Segment, ...]
    begin_s: float = 0.0
    """Time in the first segment at which the flight starts; not 0 when a mission is resumed."""
    approach: CurveSegment | None = None
    """Segment from the vehicle's position to the start of the first segment, flown first."""
    pace: Pace = Pace()
    number: int = 0
    """Number of the script in the mission."""
    fence: FenceArea | None = None
    """The mission's own geofence, which also limits detours around obstacles."""


@dataclass(frozen=True, slots=True)
class ScriptChange:
    """Changes to a script that is being flown."""

    paused: bool = False
    """Whether to stop on the path."""
    go_past: int = 0
    """Index of a segment; waits before it have ended."""
    appended: tuple[Segment, ...] = ()
    """Segments added to the end of the script."""


@dataclass(frozen=True, slots=True)
class Played:
    """How far a script has been flown."""

    number: int = 0
    """Number of the script."""
    index: int = 0
    """Index of the current segment. If it equals the number of segments, all segments are flown and the end
    position is held."""
    t_s: float = 0.0
    """Mission time since the start of the segment; it stops while paused."""
    rate: float = 1.0
    """Rate of mission time: 1 is as planned, 0 is stopped."""
    approaching: bool = False
    """Whether the vehicle is flying to the start of the first segment."""
    waiting: bool = False
    """Whether the vehicle holds at a wait that has not ended."""
    diverted: bool = False
    """Whether a velocity or attitude segment was interrupted; the vehicle holds where it stopped, away from
    its path."""
    position_ned_m: Vector3 | None = None
    """The position setpoint; None: no position is sent."""
    held_back: bool = False
    """Whether mission time has stopped because the vehicle is too far behind on its path."""
