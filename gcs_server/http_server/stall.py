"""Detects clients that do not read."""

from __future__ import annotations

from gcs_server.api.refusals import UNREAD_DEADLINE_S
from gcs_server.clock import Clock


class StallDetector:
    """Detects that the client of one connection reads nothing.

    Args:
        clock: the server's clock.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._last_bytes = 0
        self._since_s = 0.0

    def is_stalled(self, unread_bytes: int) -> bool:
        """Whether the client has read nothing for `UNREAD_DEADLINE_S`; call periodically.

        Args:
            unread_bytes: bytes for the client that still wait in this process.
        """
        now_s = self._clock.monotonic_s()
        if not unread_bytes or unread_bytes < self._last_bytes or not self._last_bytes:
            self._since_s = now_s
        self._last_bytes = unread_bytes
        return bool(unread_bytes) and now_s - self._since_s > UNREAD_DEADLINE_S
