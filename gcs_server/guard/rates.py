"""The rates at which a program gets each message: it may ask for a slower one than arrives. Pure."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Final

DEFAULT, NEVER = 0.0, -1.0
"""Values of MAV_CMD_SET_MESSAGE_INTERVAL [us]."""
EARLY: Final = 0.25
"""A message that comes earlier than its interval by less than this share of it is passed, because arrivals
are not even."""
MAX_ARRIVALS: Final = 20
FASTER: Final = 0.9
"""Requested intervals below this share of the measured one are asked of the vehicle."""


@dataclass(slots=True)
class AskedRates:
    """The intervals that one program has asked for."""

    intervals_s: dict[int, float] = field(default_factory=dict[int, float])
    """By message id [s]; infinity: never. A message without an entry is passed as it comes."""
    _due_s: dict[tuple[int, int], float] = field(default_factory=dict[tuple[int, int], float])

    def ask(self, msg_id: int, interval_us: float) -> None:
        """Sets the interval of a message [us]; 0: as it comes; negative: never."""
        if interval_us == DEFAULT:
            self.intervals_s.pop(msg_id, None)
        else:
            self.intervals_s[msg_id] = interval_us / 1e6 if interval_us > 0 else float("inf")

    def passes(self, msg_id: int, component_id: int, now_s: float) -> bool:
        """Whether a message that arrives now is sent to the program."""
        interval_s = self.intervals_s.get(msg_id)
        if interval_s is None:
            return True
        key = (msg_id, component_id)
        due_s = self._due_s.get(key, now_s)
        if interval_s == float("inf") or now_s < due_s - EARLY * interval_s:
            return False
        self._due_s[key] = max(due_s, now_s - interval_s) + interval_s
        return True


@dataclass(slots=True)
class ArrivingRates:
    """The intervals at which messages of the autopilot arrive."""

    _times_s: dict[int, deque[float]] = field(default_factory=dict[int, deque[float]])

    def take(self, msg_id: int, now_s: float) -> None:
        """Notes an arrival."""
        times_s = self._times_s.get(msg_id)
        if times_s is None:
            times_s = self._times_s[msg_id] = deque(maxlen=MAX_ARRIVALS)
        times_s.append(now_s)

    def is_slower(self, msg_id: int, interval_us: float) -> bool:
        """Whether a message arrives less often than at this interval [us], so that the vehicle must be asked;
        also if it does not arrive at all, and for the vehicle's own interval."""
        times_s = self._times_s.get(msg_id)
        if times_s is None or len(times_s) < 2:
            return interval_us >= 0.0
        mean_s = (times_s[-1] - times_s[0]) / (len(times_s) - 1)
        return 0.0 < interval_us < FASTER * mean_s * 1e6
