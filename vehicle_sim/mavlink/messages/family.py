"""What all families of telemetry share: the vehicle, and builders that are named after their messages."""

from __future__ import annotations

import math
from collections.abc import Callable

from vehicle_sim.autopilot.autopilot import Autopilot
from vehicle_sim.mavlink.dialect import BY_NAME

NAN = math.nan

Builder = Callable[[], bytes | None]


class Family:
    """Messages that belong together: each method `heartbeat` builds the payload of HEARTBEAT.

    A builder that returns None has nothing to say yet.
    """

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._view = autopilot.view

    def builders(self) -> dict[int, Builder]:
        """By message id."""
        return {
            BY_NAME[name.upper()].id: getattr(self, name) for name in dir(self) if name.upper() in BY_NAME
        }


def packer(name: str) -> Callable[..., bytes]:
    """The packing of a message whose fields are given in the order of the wire."""
    return BY_NAME[name].packer.pack


def i16(value: float) -> int:
    """Rounded into what 16 bits hold."""
    return max(-32768, min(32767, round(value)))
