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
class TimeScaleLimits:
    """Limits for braking and accelerating along the path when a mission is paused and resumed."""

    acceleration_m_s2: float = 3.0
    """Horizontal acceleration."""
    vertical_acceleration_m_s2: float = 3.0
    jerk_m_s3: float = 4.0


@dataclass(frozen=True, slots=True)
class Script:
    """Segments that the stream process flies in order by setpoints, without leaving Offboard."""

    type: ClassVar[str] = "mission"
    needs: ClassVar[tuple[Estimate, ...]] = ("position", "velocity")
    name: str
    """Name of the mission."""
    segments: tuple[Segment, ...]
    begin_s: float = 0.0
    """Time in the first segment at which the flight starts; not 0 when a mission is resumed."""
    approach: CurveSegment | None = None
    """Segment from the vehicle's position to the start of the first segment; None: not needed."""
    time_scale_limits: TimeScaleLimits = TimeScaleLimits()
    number: int = 0
    """Number of the script among all scripts of the mission."""
    begin_rate: float | None = None
    """Rate of mission time at the start, for a vehicle that already flies along the path; None: 1, or 0 if
    `begin_s` is not 0."""
    fence: FenceArea | None = None
    """The mission's own geofence, which also limits detours around obstacles."""


@dataclass(frozen=True, slots=True)
class ScriptChange:
    """Changes to a script that is being flown."""

    paused: bool = False
    """Whether mission time must stop, so that the vehicle stops on its path."""
    first_open_wait: int = 0
    """Waits in segments with a lower index than this have ended."""
    appended: tuple[Segment, ...] = ()
    """Segments added to the end of the script."""


@dataclass(frozen=True, slots=True)
class ScriptProgress:
    """Progress of a script."""

    number: int = 0
    """Number of the script."""
    index: int = 0
    """Index of the current segment. Equal to the number of segments: all segments were flown, and the vehicle
    holds the end position."""
    t_s: float = 0.0
    """Mission time since the start of the segment; mission time stops during a pause."""
    rate: float = 1.0
    """Rate of mission time: 1 is as planned, 0 is stopped."""
    approaching: bool = False
    """Whether the vehicle is flying to the start of the first segment."""
    waiting: bool = False
    """Whether the vehicle holds its position in a wait that has not ended."""
    diverted: bool = False
    """Whether a velocity or attitude segment was interrupted; the vehicle then stops and holds its position,
    away from its path."""
    position_ned_m: Vector3 | None = None
    """The position setpoint; None: the setpoint has no position."""
    held_back: bool = False
    """Whether mission time stops because the vehicle is too far behind on its path, or its position or the
    link for its setpoints is lost."""
