"""Problems that a dry run found: stable code, message, step, time and position."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

CODES: dict[str, tuple[Literal["error", "warning"], str]] = {
    "item_refused": ("error", "the vehicle refuses an item of the plan"),
    "start_refused": ("error", "the vehicle cannot be armed, or does not start the mission"),
    "fence_touched": ("error", "the flight leaves the geofence"),
    "obstacle_hit": ("error", "the flight ends at an obstacle or at steep ground"),
    "ground_touched": ("error", "the flight touches rising ground"),
    "failsafe": ("error", "a failsafe of the vehicle takes over"),
    "mission_left": ("error", "the vehicle leaves the mission before its end"),
    "not_finished": ("error", "the flight did not finish within the allowed time"),
    "battery_empty": ("error", "the battery is empty before the end"),
    "battery_reserve": ("warning", "less than the battery's reserve is left at the end"),
    "battery_unknown": ("warning", "the battery's discharge rate is unknown"),
    "obstacle_near": ("warning", "the flight comes closer than 2 m to an obstacle"),
    "obstacle_avoided": ("warning", "the vehicle leaves its path to avoid an obstacle"),
    "avoidance_stopped": ("error", "obstacle avoidance finds no way, and the vehicle waits"),
    "separation": ("error", "two vehicles of the mission come too near to each other"),
    "ends_in_air": ("warning", "the flight ends in the air; the vehicle holds its position"),
}
"""Severity and meaning of each code."""


@dataclass(frozen=True, slots=True)
class DryRunFinding:
    """One problem of the simulated flight."""

    code: str
    message: str
    """Message for the pilot."""
    step: str | None = None
    """"item 3" of a plan, "step 4.2" of an offboard mission."""
    t_s: float | None = None
    """Time since the start."""
    position_ned_m: tuple[float, float, float] | None = None
    """Position of the vehicle."""

    @property
    def severity(self) -> Literal["error", "warning"]:
        """error: do not fly this plan; warning: the flight may differ from what the pilot expects."""
        return CODES[self.code][0]
