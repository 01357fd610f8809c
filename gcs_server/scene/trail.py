"""Where a vehicle has been, conflated and bounded: a day of hovering costs no more than a minute."""

from __future__ import annotations

import math

from gcs_server.scene.frames import Vector3

SPACING_M = 0.25
MAX_POINTS = 512
JUMP_M = 50.0
"""A step no multicopter makes between two looks: the estimator was reset, or the log was rewound."""


class Trail:
    """Points at least `SPACING_M` apart; the older half is thinned whenever it is full.

    `sealed` holds what does not change until `version` does, so that a view can send it once; what came
    since is `recent`, at most `RECENT_POINTS`.
    """

    RECENT_POINTS = 32

    def __init__(self) -> None:
        self.sealed: list[Vector3] = []
        self.recent: list[Vector3] = []
        self.version = 0
        """Counts the changes of `sealed`."""

    def add(self, position_enu_m: Vector3) -> bool:
        """Takes note of where the vehicle is; True: a point was kept."""
        if not all(math.isfinite(c) for c in position_enu_m):
            return False
        if self.recent:
            step_m = math.dist(self.recent[-1], position_enu_m)
            if step_m < SPACING_M:
                return False
            if step_m > JUMP_M:
                self.clear()
        self.recent.append(position_enu_m)
        if len(self.recent) >= self.RECENT_POINTS:
            self._seal()
        return True

    def clear(self) -> None:
        """Forgets everything."""
        self.sealed, self.recent = [], []
        self.version += 1

    def _seal(self) -> None:
        # The last point stays: it is where the recent part goes on.
        self.sealed += self.recent if not self.sealed else self.recent[1:]
        self.recent = self.recent[-1:]
        if len(self.sealed) > MAX_POINTS:
            older, newer = self.sealed[: MAX_POINTS // 2], self.sealed[MAX_POINTS // 2 :]
            self.sealed = older[::2] + newer
        self.version += 1
