"""The trail of a vehicle. It is thinned and limited, so that it does not grow with the time in flight."""

from __future__ import annotations

import math
from collections import deque

from missions.frames import Vector3

SPACING_M = 0.5
NEIGHBOURS = 24
"""A new point must be at least `SPACING_M` from each of this number of newest points, so that a drifting
hover produces few lines."""
MAX_POINTS = 512
JUMP_M = 50.0
"""A larger step between two updates is not a flight: the estimator was reset, or the log was rewound [m]."""


class Trail:
    """Points at least `SPACING_M` from the newest points; when the trail is full, its older half is thinned.

    `recent` contains the newest points, at most `RECENT_POINTS`; `sealed` contains all older points. Each
    change of `sealed` increments `version`, so that a view sends `sealed` only once per version.
    """

    RECENT_POINTS = 32

    def __init__(self) -> None:
        self.sealed: list[Vector3] = []
        self.recent: list[Vector3] = []
        self._spacing_points: deque[Vector3] = deque(maxlen=NEIGHBOURS)
        self.version = 0
        """Counts the changes of `sealed`."""

    def add(self, position_enu_m: Vector3) -> bool:
        """Adds the vehicle's position; True if it was stored."""
        if not all(math.isfinite(c) for c in position_enu_m):
            return False
        if self._spacing_points and math.dist(self._spacing_points[-1], position_enu_m) > JUMP_M:
            self.clear()
        if any(math.dist(other, position_enu_m) < SPACING_M for other in reversed(self._spacing_points)):
            return False
        self._spacing_points.append(position_enu_m)
        self.recent.append(position_enu_m)
        if len(self.recent) >= self.RECENT_POINTS:
            self._seal()
        return True

    def clear(self) -> None:
        """Removes all points."""
        self.sealed, self.recent = [], []
        self._spacing_points.clear()
        self.version += 1

    def _seal(self) -> None:
        # The last point stays in `recent`, so that the line to the next point is drawn.
        self.sealed += self.recent if not self.sealed else self.recent[1:]
        self.recent = self.recent[-1:]
        if len(self.sealed) > MAX_POINTS:
            older, newer = self.sealed[: MAX_POINTS // 2], self.sealed[MAX_POINTS // 2 :]
            self.sealed = older[::2] + newer
        self.version += 1
