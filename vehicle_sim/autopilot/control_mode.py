"""Active controllers in Offboard: PX4 updates them at 2 Hz, and when mode or arming state changes.

After a change from position to attitude setpoints, both controllers are therefore active for up to half a
second: the position controller continues, and each attitude setpoint replaces the output of the position
controller until its next output, as recorded on PX4.
"""

from __future__ import annotations

import math

from vehicle_sim.control.setpoints import ControlLevel

PUBLISH_EVERY_S = 0.5


class ControlMode:
    """The control level that PX4 publishes to the controllers of one vehicle."""

    def __init__(self) -> None:
        self.level = ControlLevel.TRAJECTORY
        self._state: object = None
        self._published_at_s = -math.inf

    def update(self, now_s: float, level: ControlLevel, state: object) -> ControlLevel:
        """Publishes the level every PUBLISH_EVERY_S, and when `state` (arming, mode, failsafe) changes."""
        if state != self._state or now_s - self._published_at_s >= PUBLISH_EVERY_S - 1e-6:
            self._state, self._published_at_s, self.level = state, now_s, level
        return self.level
