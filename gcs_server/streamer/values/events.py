"""Events of a stream, with messages for the operator."""

from __future__ import annotations

from dataclasses import dataclass

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
