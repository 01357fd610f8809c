"""Which controllers run in Offboard: PX4 tells them at 2 Hz and when its mode or arming changes, no sooner.

A stream that changes from positions to attitudes is therefore flown by both for up to half a second: the
position controller goes on and each message cuts in until its next output. Recordings show it.
"""

from __future__ import annotations

import math

from vehicle_sim.control.setpoints import ControlLevel

PUBLISH_EVERY_S = 0.5


class ControlMode:
    """The control level that the controllers of one vehicle know of."""

    def __init__(self) -> None:
        self.level = ControlLevel.TRAJECTORY
        self._key: object = None
        self._published_at_s = -math.inf

    def update(self, now_s: float, wanted: ControlLevel, key: object) -> ControlLevel:
        """Publish if it is time, or if `key` (arming, mode, failsafe) changed."""
        if key != self._key or now_s - self._published_at_s >= PUBLISH_EVERY_S - 1e-6:
            self._key, self._published_at_s, self.level = key, now_s, wanted
        return self.level
