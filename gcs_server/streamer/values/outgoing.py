"""What a stream has to send, whatever carries it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from missions.setpoints import DirectSetpoint


@dataclass(frozen=True, slots=True)
class SetpointDue:
    """The setpoint that was loaded last is to be sent now."""

    now_s: float
    """Monotonic."""


@dataclass(frozen=True, slots=True)
class ModeRequest:
    """The vehicle is asked to change its mode."""

    mode: str
    """hold or land."""
    attempt: int
    """Counts from 0."""


Outgoing = SetpointDue | ModeRequest


class SetpointLoader(Protocol):
    """The transport, as the pipeline sees it."""

    def load(self, setpoint: DirectSetpoint) -> None:
        """Prepares the setpoint that is sent from now on; called only when it changes.

        Raises:
            ValueError: the transport cannot carry it.
        """
        ...
