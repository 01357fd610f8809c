"""How often an agent may call. No I/O; the time is handed in."""

from __future__ import annotations


class CallLimit:
    """A number of calls per minute; as many may come at once.

    Args:
        per_min: calls per minute.
    """

    def __init__(self, per_min: int) -> None:
        self.per_min = per_min
        self._left = float(per_min)
        self._at_s: float | None = None

    def take(self, now_s: float) -> float:
        """Counts a call. Returns 0 if it is allowed, or else the time after which the next one is [s]."""
        elapsed_s = 0.0 if self._at_s is None else max(0.0, now_s - self._at_s)
        self._at_s = now_s
        self._left = min(float(self.per_min), self._left + elapsed_s * self.per_min / 60.0)
        if self._left >= 1.0:
            self._left -= 1.0
            return 0.0
        return (1.0 - self._left) * 60.0 / self.per_min
