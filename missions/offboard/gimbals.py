"""The gimbal's direction while a segment is flown."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from missions.frames import Vector3, wrap_pi
from missions.setpoints import Position, Setpoint, Trajectory, Velocity, complete_vector


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
