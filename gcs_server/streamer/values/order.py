"""A setpoint with how long it is valid, what happens afterwards, and whose it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from missions.runner.script import Script
from missions.setpoints import Path, Setpoint

StreamOwner = Literal["operator", "group", "mission"]
"""Who sends a stream's setpoints: a client for this vehicle alone, the group that it flies in, or its
offboard mission."""


@dataclass(frozen=True, slots=True)
class OnExpiry:
    """What the stream does by itself when a setpoint has expired."""

    action: str = "hold"
    """hold, land, stop_stream."""
    hold_for_s: float = 5.0
    """With `hold`: how long position setpoints hold the position before PX4's Hold mode is requested."""


@dataclass(frozen=True, slots=True)
class Order:
    """A setpoint as it was asked for."""

    setpoint: Setpoint | Script
    """What is flown; a script is an offboard mission's."""
    valid_for_s: float = 1.0
    on_expiry: OnExpiry = OnExpiry()
    client: str = ""
    client_key: str = ""
    """Tells the client from others of the same name; empty where there is no client."""
    owner: StreamOwner = "operator"

    @property
    def lasts_s(self) -> float:
        """Until it expires: the validity of a path starts at its end."""
        return self.valid_for_s + (self.setpoint.duration_s if isinstance(self.setpoint, Path) else 0.0)
