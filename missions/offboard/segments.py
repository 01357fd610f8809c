"""The segments of a compiled mission: the setpoint at each moment, or the condition to wait for.

Plain frozen values without state, so that a timeline can be handed to another process and sampled there.
A segment's `at(t_s)` gives the setpoint `t_s` after the segment began, and its last one for any later time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from missions.curves import PathCurve
from missions.frames import Vector3
from missions.offboard.gimbals import GimbalTrack
from missions.setpoints import Attitude, Position, Setpoint, Trajectory, Velocity
from missions.trajectory.curve import TimedCurve


@dataclass(frozen=True, slots=True)
class Event:
    """An action at a time of a segment."""

    t_s: float
    """Since the segment began."""
    kind: Literal["photo", "gimbal"]


@dataclass(frozen=True, slots=True)
class Segment:
    """What all segments share."""

    place: str
    """Which step of the document: "step 3", "step 4.2"."""
    title: str
    """For people: the step's name, or what it is."""
    duration_s: float
    """Planned; of a wait: zero, or as long as a take-off or landing is expected to take."""
    end_ned_m: Vector3
    """Where it is expected to end."""
    end_yaw_ned_rad: float
    length_m: float = 0.0
    gimbal: GimbalTrack | None = None
    """None: the gimbal is left as it is."""
    events: tuple[Event, ...] = ()
    avoidance: bool = False
    """Whether the vehicle is led past obstacles that its sensors measure."""
    visit: int = 0
    """Counts the steps that are carried out: each round of a repeat is another one at the same place."""

    def at(self, t_s: float) -> Setpoint:
        """The setpoint at a time since the segment began."""
        return Position(self.end_ned_m, self.end_yaw_ned_rad)

    def gimbal_at(self, t_s: float) -> tuple[float, float] | None:
        """Pitch (up is positive) and yaw from north [rad] of the gimbal; None: left as it is."""
        return None if self.gimbal is None else self.gimbal.at(t_s, self.at(t_s), self.end_yaw_ned_rad)


@dataclass(frozen=True, slots=True)
class HoldSegment(Segment):
    """Stay at a place."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CurveSegment(Segment):
    """Fly a curve; its yaw, or the one kept."""

    curve: TimedCurve

    def at(self, t_s: float) -> Setpoint:
        """The curve's setpoint."""
        found = self.curve.at(t_s)
        if found.yaw_ned_rad is not None:
            return found
        return Trajectory(
            found.position_ned_m,
            found.velocity_ned_m_s,
            found.acceleration_ned_m_s2,
            self.end_yaw_ned_rad,
            0.0,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class TableSegment(Segment):
    """Fly a path that has its own times."""

    path: PathCurve

    def at(self, t_s: float) -> Setpoint:
        """The path's setpoint."""
        return self.path.at(t_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class VelocitySegment(Segment):
    """Fly a velocity, reached and left with limited acceleration and jerk; the position is not held."""

    line: TimedCurve
    """The same flight without wind, from which velocity and acceleration are taken."""

    def at(self, t_s: float) -> Setpoint:
        """The velocity at that time."""
        return Velocity(self.line.at(t_s).velocity_ned_m_s, self.end_yaw_ned_rad)


@dataclass(frozen=True, slots=True, kw_only=True)
class AttitudeSegment(Segment):
    """Fly an attitude; neither position nor height is held."""

    attitude: Attitude

    def at(self, t_s: float) -> Setpoint:
        """The attitude; afterwards the place where it ends by plan is held."""
        return self.attitude if t_s < self.duration_s else Position(self.end_ned_m, self.end_yaw_ned_rad)


WaitKind = Literal["person", "condition", "take_off", "land", "meet"]


@dataclass(frozen=True, slots=True, kw_only=True)
class WaitSegment(Segment):
    """Hold until something has happened: the runner goes on only then."""

    kind: WaitKind
    timeout_s: float
    on_timeout: str = "hold"
    value: str | None = None
    """Of a condition: the value's name."""
    above: float | None = None
    below: float | None = None
    for_s: float = 0.0
    message: str | None = None
    """What a person is asked, or the name of a meeting."""
    height_m: float | None = None
    """Of a take-off: above where the vehicle stands."""


@dataclass(frozen=True, slots=True)
class Decision:
    """A branch: by this condition the mission goes on in one of two timelines."""

    place: str
    value: str
    above: float | None
    below: float | None
    for_s: float
