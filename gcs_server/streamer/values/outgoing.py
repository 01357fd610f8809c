"""The setpoints and mode requests that a stream sends, independent of the transport."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from gcs_server.streamer.values.stream_request import OFFBOARD
from missions.setpoints import DirectSetpoint


@dataclass(frozen=True, slots=True)
class SetpointDue:
    """Tells the transport to send the setpoint that was loaded last."""

    now_s: float
    """Current time [s, monotonic]."""
    in_mode: bool = True
    """Whether the vehicle reports the mode in which it flies the setpoints. If not, only
    OffboardControlMode is sent over ROS 2, because PX4 would follow the setpoint topics in any mode."""
    mode: str = OFFBOARD
    """Mode in which the setpoints are flown: Offboard, or a mode registered with PX4 (`external_1` …)."""


@dataclass(frozen=True, slots=True)
class ModeRequest:
    """Tells the transport to send a request for a mode change."""

    mode: str
    """hold or land."""
    attempt: int
    """Number of the attempt, from 0."""


Outgoing = SetpointDue | ModeRequest


class SetpointLoader(Protocol):
    """The pipeline's interface to the transport."""

    def load(self, setpoint: DirectSetpoint) -> None:
        """Packs the setpoint to send; called only when the setpoint changes.

        Raises:
            ValueError: the transport cannot carry the setpoint.
        """
        ...
