"""GotoSetpoint: PX4's position controller flies a smooth trajectory to a position, in any mode."""

from __future__ import annotations

import math
from dataclasses import dataclass

from vehicle_sim.autopilot.path import Path
from vehicle_sim.autopilot.setpoint_writer import SetpointWriter
from vehicle_sim.vehicle_view import Vector, VehicleView

TIMEOUT_S = 0.5
"""The flight to the position ends this long after the last message."""


@dataclass(frozen=True, slots=True)
class Goto:
    """A GotoSetpoint message; NaN heading: unchanged; NaN speed: only the parameters limit the speed."""

    position_ned_m: Vector
    heading_ned_rad: float = math.nan
    max_horizontal_m_s: float = math.nan
    max_vertical_m_s: float = math.nan


class GotoControl:
    """Flies one vehicle to the position of the newest message."""

    def __init__(self, view: VehicleView, setpoints: SetpointWriter) -> None:
        self._view = view
        self._path = Path(view, setpoints)
        self.goal: Goto | None = None
        """The newest message; None: no message, or the last one has expired."""
        self._received_at_s = -math.inf
        self._active = False

    def receive(self, goal: Goto) -> None:
        """Stores a message; a message without a position is ignored."""
        if all(map(math.isfinite, goal.position_ned_m)):
            self.goal, self._received_at_s = goal, self._view.time_s

    def fly(self) -> None:
        """Runs one tick: overwrites the active mode's setpoints while messages are received."""
        goal = self.goal
        if goal is None:
            return
        if self._view.time_s - self._received_at_s > TIMEOUT_S:
            self.goal, self._active = None, False
            return
        path = self._path
        if not self._active:
            path.restart(in_air=True)
            self._active = True
        path.follow_resets()
        path.target_ned_m = goal.position_ned_m
        path.cruise_m_s = goal.max_horizontal_m_s
        path.climb_m_s = path.descent_m_s = goal.max_vertical_m_s
        if math.isfinite(goal.heading_ned_rad):
            path.yaw_target_rad = goal.heading_ned_rad
        path.fly_to_target()
