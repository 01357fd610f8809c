"""The segments of a compiled mission: a setpoint for each time, or a condition to wait for.

Segments are frozen values, so that another process can receive and sample a timeline. `at(t_s)` is the
setpoint `t_s` after the start of the segment; after the end of the segment, `at` is the last setpoint.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from missions.avoidance.values import AvoidanceWay
from missions.curves import PathCurve
from missions.frames import Vector3, wrap_pi
from missions.setpoints import Attitude, Position, Setpoint, Trajectory, Velocity, complete_vector
from missions.trajectory.curve import TimedCurve


@dataclass(frozen=True, slots=True)
class GimbalTrack:
    """Gimbal direction: fixed relative to the nose, aimed at a position, along the path, or sweeping.
    Positive pitch is up."""

    kind: Literal["fixed", "look_at", "along_path", "sweep"]
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0
    """Yaw relative to the nose."""
    target_ned_m: Vector3 = (0.0, 0.0, 0.0)
    """Position that `look_at` aims at, in the local frame."""
    sweep_pitch_rad: float = 0.0
    sweep_yaw_rad: float = 0.0
    period_s: float = 10.0

    def at(self, t_s: float, setpoint: Setpoint, default_yaw_ned_rad: float) -> tuple[float, float]:
        """Gimbal pitch (up is positive) and yaw from north at a time of the segment [rad].

        Args:
            t_s: time since the start of the segment.
            setpoint: the vehicle's setpoint at that time.
            default_yaw_ned_rad: the heading if the setpoint has none.
        """
        setpoint_yaw_rad = getattr(setpoint, "yaw_ned_rad", None)
        heading_ned_rad = default_yaw_ned_rad if setpoint_yaw_rad is None else float(setpoint_yaw_rad)
        if self.kind == "look_at":
            return self._towards(setpoint, heading_ned_rad)
        if self.kind == "along_path":
            return self.pitch_rad, _course(setpoint, heading_ned_rad)
        pitch_rad, yaw_rad = self.pitch_rad, heading_ned_rad + self.yaw_rad
        if self.kind == "sweep":
            sine = math.sin(math.tau * t_s / self.period_s)
            pitch_rad += self.sweep_pitch_rad * sine
            yaw_rad += self.sweep_yaw_rad * sine
        return pitch_rad, wrap_pi(yaw_rad)

    def _towards(self, setpoint: Setpoint, heading_ned_rad: float) -> tuple[float, float]:
        position_ned_m = (
            complete_vector(setpoint.position_ned_m) if isinstance(setpoint, Trajectory | Position) else None
        )
        if position_ned_m is None:
            return self.pitch_rad, wrap_pi(heading_ned_rad)
        n, e, d = (
            target_coordinate - coordinate
            for target_coordinate, coordinate in zip(self.target_ned_m, position_ned_m, strict=True)
        )
        horizontal_m = math.hypot(n, e)
        yaw_rad = math.atan2(e, n) if horizontal_m > 1e-6 else wrap_pi(heading_ned_rad)
        return math.atan2(-d, horizontal_m), yaw_rad


def _course(setpoint: Setpoint, heading_ned_rad: float) -> float:
    """The horizontal direction of flight; the heading if the vehicle hardly moves."""
    if isinstance(setpoint, Trajectory | Velocity):
        north, east = setpoint.velocity_ned_m_s[0] or 0.0, setpoint.velocity_ned_m_s[1] or 0.0
        if math.hypot(north, east) > 0.05:
            return math.atan2(east, north)
    return wrap_pi(heading_ned_rad)


@dataclass(frozen=True, slots=True)
class Event:
    """An action at a time of a segment."""

    t_s: float
    """Time since the start of the segment."""
    kind: Literal["photo", "gimbal"]
    component: int | None = None
    """Component id of the camera that takes the photo; None: the connected camera with the lowest id."""


@dataclass(frozen=True, slots=True)
class Segment:
    """Base class of all segments."""

    place: str
    """Step of the document: "step 3", "step 4.2"."""
    title: str
    """The step's name if it has one, otherwise its kind."""
    duration_s: float
    """Planned duration [s]. For a wait: zero, or the expected duration of a take-off or landing."""
    end_ned_m: Vector3
    """Expected end position."""
    end_yaw_ned_rad: float
    length_m: float = 0.0
    gimbal: GimbalTrack | None = None
    """None: the gimbal is not commanded."""
    events: tuple[Event, ...] = ()
    avoidance: AvoidanceWay | None = None
    """What obstacle avoidance tries first; None: avoidance is off."""
    executed_step: int = 0
    """Number of the executed step; each round of a repeat has its own number."""

    def at(self, t_s: float) -> Setpoint:
        """The setpoint `t_s` after the start of the segment."""
        return Position(self.end_ned_m, self.end_yaw_ned_rad)

    def gimbal_at(self, t_s: float) -> tuple[float, float] | None:
        """Gimbal pitch (up is positive) and yaw relative to north [rad]; None: not commanded."""
        return None if self.gimbal is None else self.gimbal.at(t_s, self.at(t_s), self.end_yaw_ned_rad)


@dataclass(frozen=True, slots=True)
class HoldSegment(Segment):
    """Hold a position."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CurveSegment(Segment):
    """Fly a curve; if the curve has no yaw, with the current yaw."""

    curve: TimedCurve

    def at(self, t_s: float) -> Setpoint:
        """The curve's setpoint."""
        setpoint = self.curve.at(t_s)
        if setpoint.yaw_ned_rad is not None:
            return setpoint
        return Trajectory(
            setpoint.position_ned_m,
            setpoint.velocity_ned_m_s,
            setpoint.acceleration_ned_m_s2,
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
    """Fly a velocity, with limited acceleration and jerk; the position is not controlled."""

    line: TimedCurve
    """The path without wind, from which the velocity is sampled."""

    def at(self, t_s: float) -> Setpoint:
        """The velocity setpoint of that time."""
        return Velocity(self.line.at(t_s).velocity_ned_m_s, self.end_yaw_ned_rad)


@dataclass(frozen=True, slots=True, kw_only=True)
class AttitudeSegment(Segment):
    """Fly an attitude; position and altitude are not controlled."""

    attitude: Attitude

    def at(self, t_s: float) -> Setpoint:
        """The attitude; after the end, the planned end position."""
        return self.attitude if t_s < self.duration_s else Position(self.end_ned_m, self.end_yaw_ned_rad)


WaitKind = Literal["person", "condition", "take_off", "land", "meet"]


@dataclass(frozen=True, slots=True, kw_only=True)
class WaitSegment(Segment):
    """Hold until a condition is true; then the runner continues with the next segment."""

    kind: WaitKind
    timeout_s: float
    on_timeout: str = "hold"
    value: str | None = None
    """Name of the condition's value."""
    above: float | None = None
    below: float | None = None
    for_s: float = 0.0
    message: str | None = None
    """The question to the pilot, or the name of a meeting."""
    height_m: float | None = None
    """Height of a take-off above the take-off position."""


@dataclass(frozen=True, slots=True)
class Decision:
    """A branch: the condition selects one of two timelines to continue with."""

    place: str
    value: str
    above: float | None
    below: float | None
    for_s: float
