"""Lockstep: a client controls how far simulated time advances, so that flights are reproducible bit for bit.

The client sends SYSTEM_TIME on a link; its `time_boot_ms` is the time to advance to. The simulator handles
the earlier messages on this link, advances all vehicles to the time, and then sends SYSTEM_TIME on the link.
"""

from __future__ import annotations

from dataclasses import dataclass

from vehicle_sim.mavlink.framing import FrameParser


@dataclass(frozen=True, slots=True)
class TimeRequest:
    """The time up to which the simulation may advance, and the client that requested this time."""

    time_s: float
    row: int
    link: str


class Lockstep:
    """Reads the newest requested time from received messages."""

    def __init__(self) -> None:
        self._parsers: dict[tuple[int, str], FrameParser] = {}
        self._request: TimeRequest | None = None

    def feed(self, row: int, link: str, data: bytes) -> None:
        """Parses bytes received on one link."""
        for message in self._parsers.setdefault((row, link), FrameParser()).feed(data):
            if message.name == "SYSTEM_TIME":
                self._request = TimeRequest(message.time_boot_ms / 1000.0, row, link)

    def take(self) -> TimeRequest | None:
        """The newest request since the last call; None: no request."""
        request, self._request = self._request, None
        return request
