"""Lockstep: a client sets how far time may advance, so that the same client gets the same flight bit for bit.

The client sends SYSTEM_TIME with the `time_boot_ms` to go on to; what it sent before on that link has been
heard when time moves. The vehicle answers SYSTEM_TIME when it is there.
"""

from __future__ import annotations

from dataclasses import dataclass

from vehicle_sim.mavlink.framing import FrameParser


@dataclass(frozen=True, slots=True)
class Wanted:
    """The time up to which the simulation may advance, and the client that set it."""

    time_s: float
    row: int
    link: str


class Lockstep:
    """Listens to what arrives for the newest time asked for."""

    def __init__(self) -> None:
        self._parsers: dict[tuple[int, str], FrameParser] = {}
        self._wanted: Wanted | None = None

    def hear(self, row: int, link: str, data: bytes) -> None:
        """Bytes of one link."""
        for message in self._parsers.setdefault((row, link), FrameParser()).feed(data):
            if message.name == "SYSTEM_TIME":
                self._wanted = Wanted(message.time_boot_ms / 1000.0, row, link)

    def take(self) -> Wanted | None:
        """What was asked for since the last call."""
        wanted, self._wanted = self._wanted, None
        return wanted
