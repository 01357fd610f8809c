"""Base class of the telemetry builders; each builder method is named after its message."""

from __future__ import annotations

import math
from collections.abc import Callable

from vehicle_sim.autopilot.autopilot import Autopilot
from vehicle_sim.mavlink.dialect import BY_NAME

NAN = math.nan

Builder = Callable[[], bytes | None]


class MessageGroup:
    """A group of telemetry messages; for example, method `heartbeat` builds the payload of HEARTBEAT.

    A builder returns None if it has no data yet.
    """

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._view = autopilot.view

    def builders(self) -> dict[int, Builder]:
        """The builders by message id."""
        return {
            BY_NAME[name.upper()].id: getattr(self, name) for name in dir(self) if name.upper() in BY_NAME
        }


def packer(name: str) -> Callable[..., bytes]:
    """A function that packs a message from its fields in wire order."""
    return BY_NAME[name].packer.pack


def i16(value: float) -> int:
    """Rounds a value and limits it to the range of a signed 16-bit integer."""
    return max(-32768, min(32767, round(value)))
