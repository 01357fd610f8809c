"""What a stream sends, independent of the transport."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from missions.setpoints import DirectSetpoint


@dataclass(frozen=True, slots=True)
class SetpointDue:
    """Send the setpoint that was loaded last."""

    now_s: float
    """Monotonic."""
    in_offboard: bool = True
    """Whether the vehicle reports Offboard. Before, it must receive that setpoints exist, but over ROS 2 it
    would follow them in any mode."""


@dataclass(frozen=True, slots=True)
class ModeRequest:
    """Request a mode change."""

    mode: str
    """hold or land."""
    attempt: int
    """Counts from 0."""


Outgoing = SetpointDue | ModeRequest


class SetpointLoader(Protocol):
    """The pipeline's interface to the transport."""

    def load(self, setpoint: DirectSetpoint) -> None:
        """Packs the setpoint to send; called only when the setpoint changes.

        Raises:
            ValueError: the transport cannot carry it.
        """
        ...
