"""Setpoints and sticks that arrive over ROS 2."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from vehicle_sim.autopilot.autopilot import Autopilot

Values = Mapping[str, Any]
STICK_RANGE = 1000.0


class SetpointInputs:
    """Hands each message to the autopilot of one vehicle."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self.receivers: dict[str, Callable[[Values], None]] = {
            "/fmu/in/manual_control_input": self._sticks,
        }

    def _sticks(self, v: Values) -> None:
        if not v["valid"]:
            return
        autopilot = self._autopilot
        throttle = 0.5 * (v["throttle"] + 1.0)
        axes = (v["pitch"], v["roll"], throttle, v["yaw"])
        if not all(abs(each) <= 1.0 for each in axes):
            return
        if autopilot.sticks.hear(*(round(each * STICK_RANGE) for each in axes)):
            autopilot.commander.checks.manual_control_at_s = autopilot.view.time_s
            autopilot.commander.sticks_heard()
