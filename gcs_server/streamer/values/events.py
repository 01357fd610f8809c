"""Events of a stream for people."""

from __future__ import annotations

from dataclasses import dataclass

WARNING, NOTICE, INFO = 4, 5, 6
"""MAV_SEVERITY."""


@dataclass(frozen=True, slots=True)
class StreamEvent:
    """Something that happened to a stream."""

    code: str
    """expired, lost, jumped, leader_lost, fence, limited, held, landing, commanded, left_offboard, disarmed,
    server_silent, not_confirmed, fault, separation, group, avoidance, avoidance_stopped,
    obstacle_sensor_lost."""
    severity: int
    text: str
