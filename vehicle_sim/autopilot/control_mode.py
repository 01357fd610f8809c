"""Active controllers in Offboard: PX4 updates them every half second, and when mode or arming state changes.

After a change from position to attitude setpoints, both controllers are therefore active for up to half a
second: the position controller continues, and each attitude setpoint replaces the output of the position
controller until its next output, as recorded on PX4.
"""

from __future__ import annotations

import math

from vehicle_sim.control.setpoints import ControlLevel

PUBLISH_EVERY_S = 0.504
"""Measured; so the moment of an update drifts against a sequence of steps of whole seconds."""


class ControlMode:
    """The control level that PX4 publishes to the controllers of one vehicle."""

    def __init__(self) -> None:
        self.level = ControlLevel.TRAJECTORY
        self._state: object = None
        self._due_s = -math.inf

    def update(self, now_s: float, level: ControlLevel, state: object) -> ControlLevel:
        """Publishes the level every PUBLISH_EVERY_S, and when `state` (arming, mode, failsafe) changes."""
        if state != self._state:
            self._state, self._due_s = state, now_s
        if now_s >= self._due_s - 1e-6:
            # From the time at which it was due, so that the period does not become a multiple of the tick.
            self._due_s, self.level = max(self._due_s, now_s - PUBLISH_EVERY_S) + PUBLISH_EVERY_S, level
        return self.level
