"""The times at which setpoints are sent (a fixed time grid, even if a setpoint was late), and the achieved
rate."""

from __future__ import annotations

import math
from collections import deque

_MAX_TIMES = 101
RATE_WINDOW_S = 2.0
"""Time over which the achieved rate is measured [s]."""
PAUSE_S = 0.5
"""Gap between two setpoints that counts as a pause [s]; at low rates, a pause is two periods. PX4 needs two
setpoints per second."""


class Cadence:
    """Times of setpoints on a grid of `1 / rate_hz`; missed setpoints are not sent later."""

    def __init__(self) -> None:
        self.rate_hz = 50.0
        self.next_s = 0.0
        """Time at which the next setpoint is due."""
        self.is_sending = True
        """Whether the link accepted the last setpoint."""
        self._sent_at: deque[float] = deque(maxlen=_MAX_TIMES)
        self._steady_from_s = 0.0

    def begin(self, rate_hz: float) -> None:
        """Starts a new stream."""
        self.rate_hz, self.is_sending = rate_hz, True
        self._sent_at.clear()

    def send_now(self, now_s: float) -> None:
        """Makes the next setpoint due now, and restarts the grid."""
        self.next_s = now_s

    def sent(self, now_s: float) -> None:
        """Records a sent setpoint."""
        self.is_sending = True
        if not self._sent_at or now_s - self._sent_at[-1] > max(PAUSE_S, 2.0 / self.rate_hz):
            self._steady_from_s = now_s
        self._sent_at.append(now_s)
        missed = math.floor((now_s - self.next_s) * self.rate_hz + 1e-6)
        self.next_s += (missed + 1) / self.rate_hz

    def not_sent(self, now_s: float) -> None:
        """Records that the link did not accept the last setpoint: `steady_s` starts again."""
        self._steady_from_s, self.is_sending = now_s, False

    def achieved_hz(self, now_s: float) -> float | None:
        """Rate of the last sent setpoints; None before two setpoints were sent within two seconds."""
        recent = [sent_s for sent_s in tuple(self._sent_at) if now_s - sent_s <= RATE_WINDOW_S]
        return (len(recent) - 1) / (recent[-1] - recent[0]) if len(recent) >= 2 else None

    @property
    def steady_s(self) -> float:
        """Time from the first to the last setpoint sent without a pause; 0 before the second setpoint."""
        return self._sent_at[-1] - self._steady_from_s if self._sent_at else 0.0

    def age_s(self, now_s: float) -> float | None:
        """Time since the last sent setpoint."""
        return now_s - self._sent_at[-1] if self._sent_at else None
