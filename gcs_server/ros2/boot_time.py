"""The vehicle's time since its boot, from the timestamps of its ROS 2 messages.

With time synchronization (`UXRCE_DDS_SYNCT`, the default) PX4 sends timestamps in microseconds since 1970, on
the clock of the uXRCE-DDS agent. Once a second, `timesync_status` contains the offset from these timestamps
to the time since boot. Without time synchronization, timestamps count from the boot.
"""

from __future__ import annotations

from typing import Final

MAX_UPTIME_US: Final = 10 * 365 * 86_400 * 1_000_000
"""Larger timestamps count from 1970."""
TIMESYNC_TIMEOUT_S: Final = 3.0
"""Time without `timesync_status` after which the first timestamp is used as the time of the boot [s]."""
MAX_OFFSET_US: Final = 2**62
"""Larger offsets are implausible and are ignored."""


class BootTime:
    """Time since boot of one vehicle."""

    def __init__(self) -> None:
        self._offset_us: int | None = None
        self._first_timestamp: tuple[float, int] | None = None
        """Arrival time of the first timestamp that counts from 1970 [s, monotonic], and this timestamp
        [µs]."""

    def synchronize(self, estimated_offset_us: int) -> None:
        """Stores the offset of `timesync_status` [µs]; it is added to timestamps that count from 1970."""
        if abs(estimated_offset_us) < MAX_OFFSET_US:
            self._offset_us = estimated_offset_us

    def boot_ms(self, timestamp_us: int, now_s: float) -> int | None:
        """Time since boot, in 32 bits as in MAVLink [ms]; None while it is not known.

        Args:
            timestamp_us: a message's timestamp.
            now_s: time of the server [s, monotonic].
        """
        if timestamp_us < MAX_UPTIME_US:
            return timestamp_us // 1000 & 0xFFFFFFFF
        if self._offset_us is None:
            if self._first_timestamp is None:
                self._first_timestamp = now_s, timestamp_us
            if now_s - self._first_timestamp[0] < TIMESYNC_TIMEOUT_S:
                return None
            self._offset_us = -self._first_timestamp[1]
        return max(0, timestamp_us + self._offset_us) // 1000 & 0xFFFFFFFF
