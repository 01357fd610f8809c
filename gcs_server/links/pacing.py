"""Decides when a link may send the next frame.

Only little data may wait in the buffers of the system and the driver, because urgent packets cannot overtake
these data, and they do not expire.
"""

from __future__ import annotations

import contextlib
import fcntl
import math
import socket
import struct
import termios
from collections import deque
from collections.abc import Callable
from typing import Protocol

RECHECK_PERIOD_S = 0.005
"""Time until a blocked link is tried again."""
BITS_PER_BYTE = 10
"""Start bit, eight data bits, stop bit."""
AHEAD_S = 0.005
"""The next frame may be written this long before the line becomes idle, because timers fire late [s]."""
TIMER_STEP_S = 0.0001
"""Shorter waits are skipped [s]."""
DRIVER_SLACK_BYTES = 64
"""Tolerance for drivers that count in blocks."""
UNPACED_DRIVER_BYTES = 512
"""Bytes that may wait in the driver of a device without a line speed (USB)."""
ACKED_WITHIN_S = 0.1
"""TCP: sending pauses if written bytes are not acknowledged within this time plus two round trips [s]."""
MAX_IN_FLIGHT_BYTES = 64_000
_RTT_OFFSET_BYTES = 68
"""Offset of `tcpi_rtt` [us] in Linux' struct tcp_info."""


class Pacer(Protocol):
    """Decides when the next frame may be written."""

    def wait_s(self, now_s: float) -> float:
        """Time until the next frame may be written [s]; 0: now."""
        ...

    def wrote(self, size_bytes: int, now_s: float) -> None:
        """Records bytes handed to the operating system."""
        ...


class Unpaced:
    """No pacing: writes as much as the socket accepts (UDP)."""

    def wait_s(self, now_s: float) -> float:
        return 0.0

    def wrote(self, size_bytes: int, now_s: float) -> None:
        return


class LinePacer:
    """Paces a serial line by its speed and by the number of bytes in the driver.

    Args:
        baud: line speed; infinity if the device has none.
        driver_bytes: returns the number of bytes that the driver has not sent yet.
    """

    def __init__(self, baud: float, driver_bytes: Callable[[], int]) -> None:
        self._bytes_per_s = baud / BITS_PER_BYTE
        self._driver_bytes = driver_bytes
        unlimited = math.isinf(baud)
        self._ahead_bytes = 0.0 if unlimited else self._bytes_per_s * AHEAD_S
        self._driver_limit_bytes = (
            UNPACED_DRIVER_BYTES if unlimited else self._ahead_bytes + DRIVER_SLACK_BYTES
        )
        self._line_bytes = 0.0
        """Bytes written but not sent yet, assuming that the line is never idle."""
        self._updated_s = 0.0
        """Time of the last change of `_line_bytes`."""

    def wait_s(self, now_s: float) -> float:
        if self._line_bytes:
            self._line_bytes = max(0.0, self._line_bytes - (now_s - self._updated_s) * self._bytes_per_s)
            self._updated_s = now_s
            ready_in_s = (self._line_bytes - self._ahead_bytes) / self._bytes_per_s
            if ready_in_s > TIMER_STEP_S:
                return ready_in_s
        return RECHECK_PERIOD_S if self._driver_bytes() > self._driver_limit_bytes else 0.0

    def wrote(self, size_bytes: int, now_s: float) -> None:
        if not math.isinf(self._bytes_per_s):
            self._line_bytes += size_bytes
            self._updated_s = now_s


class AckPacer:
    """Paces TCP: sends nothing while an acknowledgement is overdue, so that little data waits during a stall.

    Args:
        unacknowledged: returns the number of written bytes that are not acknowledged.
        round_trip_s: returns the round trip time measured by the system.
    """

    def __init__(self, unacknowledged: Callable[[], int], round_trip_s: Callable[[], float]) -> None:
        self._unacknowledged = unacknowledged
        self._round_trip_s = round_trip_s
        self._written = 0
        self._writes: deque[tuple[int, float]] = deque()
        """(total of written bytes, time) after each write that is not acknowledged."""

    def wait_s(self, now_s: float) -> float:
        writes = self._writes
        if not writes:
            return 0.0
        in_flight = self._unacknowledged()
        while writes and writes[0][0] <= self._written - in_flight:
            writes.popleft()
        if in_flight > MAX_IN_FLIGHT_BYTES:
            return RECHECK_PERIOD_S
        if not writes or now_s - writes[0][1] <= ACKED_WITHIN_S:
            return 0.0
        overdue = now_s - writes[0][1] > ACKED_WITHIN_S + 2 * self._round_trip_s()
        return RECHECK_PERIOD_S if overdue else 0.0

    def wrote(self, size_bytes: int, now_s: float) -> None:
        self._written += size_bytes
        self._writes.append((self._written, now_s))


def bytes_in_output_queue(fileno: int) -> int:
    """Bytes written to a descriptor and not yet sent (serial) or acknowledged (TCP); 0 if unknown."""
    try:
        return struct.unpack("i", fcntl.ioctl(fileno, termios.TIOCOUTQ, b"\0" * 4))[0]
    except (OSError, ValueError):
        return 0


def round_trip_s(sock: socket.socket) -> float:
    """Smoothed round trip time of a connection; 0 if unknown."""
    with contextlib.suppress(OSError, AttributeError, struct.error):
        info = sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _RTT_OFFSET_BYTES + 4)
        return struct.unpack_from("I", info, _RTT_OFFSET_BYTES)[0] / 1e6
    return 0.0
