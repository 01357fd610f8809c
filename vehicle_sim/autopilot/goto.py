"""GotoSetpoint: smooth flight to a position in any mode, as PX4's position controller flies it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from vehicle_sim.autopilot.path import Path
from vehicle_sim.autopilot.row import SetpointRow
from vehicle_sim.vehicle_view import Vector, VehicleView

EXPIRES_S = 0.5
"""The flight to the position ends this long after the last message."""


@dataclass(frozen=True, slots=True)
class Goto:
    """One message; NaN: the heading is not changed, or the speed of the parameters is used."""

    position_ned_m: Vector
    heading_ned_rad: float = math.nan
    horizontal_m_s: float = math.nan
    vertical_m_s: float = math.nan


class GotoControl:
    """Flies one vehicle to the position of the newest message."""

    def __init__(self, view: VehicleView, row: SetpointRow) -> None:
        self._view = view
        self._path = Path(view, row)
        self.goal: Goto | None = None
        """The newest message; None: no message, or the last one has expired."""
        self._received_at_s = -math.inf
        self._flies = False

    def receive(self, goal: Goto) -> None:
        """Stores a message; a message without a position is ignored."""
        if all(map(math.isfinite, goal.position_ned_m)):
            self.goal, self._received_at_s = goal, self._view.time_s

    def fly(self) -> None:
        """Runs one tick: overrides the active mode's setpoints while messages are received."""
        goal = self.goal
        if goal is None:
            return
        if self._view.time_s - self._received_at_s > EXPIRES_S:
            self.goal, self._flies = None, False
            return
        path = self._path
        if not self._flies:
            path.restart(in_air=True)
            self._flies = True
        path.follow_resets()
        path.target_ned_m = goal.position_ned_m
        path.cruise_m_s = goal.horizontal_m_s
        path.climb_m_s = path.descent_m_s = goal.vertical_m_s
        if math.isfinite(goal.heading_ned_rad):
            path.yaw_target_rad = goal.heading_ned_rad
        path.fly_to_target()
