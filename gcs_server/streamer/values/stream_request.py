"""What a client requests of a stream, what the stream sends, and its events."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

from missions.runner.script import Script
from missions.setpoints import DirectSetpoint, Path, Setpoint

StreamOwner = Literal["operator", "group", "mission"]
"""Owner of a stream's setpoints: a client (operator), the vehicle's group, or its offboard mission."""
OFFBOARD = "offboard"


def mode_label(mode: str) -> str:
    """The mode of a stream, for messages."""
    return "Offboard" if mode == OFFBOARD else "the mission's mode"


@dataclass(frozen=True, slots=True)
class OnExpiry:
    """The action of the stream when a setpoint has expired."""

    action: str = "hold"
    """hold, land, stop_stream."""
    hold_for_s: float = 5.0
    """For `hold`: time for which setpoints keep the position before the stream requests PX4's Hold mode
    [s]."""


@dataclass(frozen=True, slots=True)
class StreamRequest:
    """A setpoint with its validity, as requested by a client."""

    setpoint: Setpoint | Script
    """The setpoint, or the script of an offboard mission."""
    valid_for_s: float = 1.0
    on_expiry: OnExpiry = OnExpiry()
    client: str = ""
    client_key: str = ""
    """Distinguishes clients with the same name; empty if there is no client."""
    owner: StreamOwner = "operator"
    mode: str = OFFBOARD
    """Mode in which the vehicle flies the setpoint: Offboard, or a mode registered with PX4 (`external_1`
    …)."""

    @property
    def duration_s(self) -> float:
        """Time from the start of the setpoint until it expires [s]; the validity of a path starts at the
        path's end."""
        return self.valid_for_s + (self.setpoint.duration_s if isinstance(self.setpoint, Path) else 0.0)


WARNING, NOTICE, INFO = 4, 5, 6
"""MAV_SEVERITY."""


@dataclass(frozen=True, slots=True)
class StreamEvent:
    """One event of a stream."""

    code: str
    """expired, lost, jumped, leader_lost, fence, limited, held, landing, commanded, left_offboard, disarmed,
    interrupted, server_silent, not_confirmed, fault, separation, group, avoidance, avoidance_stopped,
    obstacle_sensor_lost."""
    severity: int
    text: str


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
