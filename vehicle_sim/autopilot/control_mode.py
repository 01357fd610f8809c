"""Active controllers in Offboard: PX4 updates them at 2 Hz, and when mode or arming state changes.

After a change from position to attitude setpoints, both controllers are therefore active for up to half a
second: the position controller continues, and each attitude setpoint overrides its output until the position
controller's next output, as recorded on PX4.
"""

from __future__ import annotations

import math

from vehicle_sim.control.setpoints import ControlLevel

PUBLISH_EVERY_S = 0.5


class ControlMode:
    """The control level that PX4 publishes to the controllers of one vehicle."""

    def __init__(self) -> None:
        self.level = ControlLevel.TRAJECTORY
        self._key: object = None
        self._published_at_s = -math.inf

    def update(self, now_s: float, level: ControlLevel, key: object) -> ControlLevel:
        """Publishes the level periodically, and when `key` (arming, mode, failsafe) changes."""
        if key != self._key or now_s - self._published_at_s >= PUBLISH_EVERY_S - 1e-6:
            self._key, self._published_at_s, self.level = key, now_s, level
        return self.level
