"""A simulated serial line with its driver: it sends at its baud rate, and it can stall."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

from gcs_server.mavlink.codec import FrameParser

DRIVER_BUFFER_BYTES = 4096
"""Size of the transmit buffer of Linux' serial drivers."""


class SimulatedSerialLine:
    """The driver and the serial line.

    Args:
        now_s: the writer's clock.
        baud: bits per second.
    """

    def __init__(self, now_s: Callable[[], float], baud: int = 57600) -> None:
        self._now_s = now_s
        self._bytes_per_s = baud / 10  # 8 data bits, a start bit and a stop bit
        self._buffered: deque[int] = deque()
        self._advanced_at_s = now_s()
        self._sendable_bytes = 0.0
        self._parser = FrameParser()
        self._sent_frames: list[tuple[float, object]] = []
        self.stalled_until_s = -math.inf

    def write(self, data: bytes) -> int:
        """Buffers bytes in the driver and returns their number.

        Raises:
            BlockingIOError: the buffer is full.
        """
        self._advance()
        free_bytes = DRIVER_BUFFER_BYTES - len(self._buffered)
        if free_bytes <= 0:
            raise BlockingIOError
        self._buffered.extend(data[:free_bytes])
        return min(free_bytes, len(data))

    def buffered_bytes(self) -> int:
        """Number of bytes in the driver's buffer."""
        self._advance()
        return len(self._buffered)

    def stall(self, for_s: float) -> None:
        """Sends nothing for this time."""
        self._advance()
        self.stalled_until_s = self._now_s() + for_s

    @property
    def sent_frames(self) -> list[tuple[float, object]]:
        """Sent frames in order, each with the time at which its last byte was sent."""
        self._advance()
        return self._sent_frames

    @property
    def parser(self) -> FrameParser:
        """The receiver's parser, with its counts of lost frames and invalid checksums."""
        return self._parser

    def _advance(self) -> None:
        now_s = self._now_s()
        begin_s = max(self._advanced_at_s, min(self.stalled_until_s, now_s))
        self._advanced_at_s = now_s
        if not self._buffered:
            self._sendable_bytes = 0.0
            return
        self._sendable_bytes += (now_s - begin_s) * self._bytes_per_s
        count = min(int(self._sendable_bytes), len(self._buffered))
        first_begin_s = now_s - self._sendable_bytes / self._bytes_per_s
        self._sendable_bytes -= count
        for n in range(count):
            at_s = first_begin_s + (n + 1) / self._bytes_per_s
            for frame in self._parser.feed(bytes([self._buffered.popleft()]), at_s):
                self._sent_frames.append((at_s, frame))
        if not self._buffered:
            self._sendable_bytes = 0.0
