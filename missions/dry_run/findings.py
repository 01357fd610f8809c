"""What a dry run has shown to be wrong: place, time, plain sentence and stable code."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

CODES: dict[str, tuple[Literal["error", "warning"], str]] = {
    "item_refused": ("error", "the vehicle refuses an item of the plan"),
    "start_refused": ("error", "the vehicle cannot be armed, or does not start the mission"),
    "fence_touched": ("error", "the flight leaves the geofence"),
    "obstacle_hit": ("error", "the flight ends at an obstacle"),
    "failsafe": ("error", "a failsafe of the vehicle takes over"),
    "mission_left": ("error", "the vehicle leaves the mission before its end"),
    "not_finished": ("error", "the flight did not finish within the allowed time"),
    "battery_empty": ("error", "the battery is empty before the end"),
    "battery_reserve": ("warning", "less than the battery's reserve is left at the end"),
    "battery_unknown": ("warning", "how fast the battery drains is not known"),
    "obstacle_near": ("warning", "the flight comes within 2 m of an obstacle"),
    "separation": ("error", "two vehicles of the mission come too near to each other"),
    "ends_in_air": ("warning", "the flight ends in the air; the vehicle holds there"),
}
"""Every code: its severity, and what it means."""
NEAR_M = 2.0
"""`obstacle_near`."""


@dataclass(frozen=True, slots=True)
class DryRunFinding:
    """One thing."""

    code: str
    message: str
    """A sentence for a person."""
    step: str | None = None
    """Where: "item 3" of a plan, "step 4.2" of an offboard mission."""
    t_s: float | None = None
    """When, since the start."""
    position_ned_m: tuple[float, float, float] | None = None
    """Where the vehicle was."""

    @property
    def severity(self) -> Literal["error", "warning"]:
        """Whether the flight must not be flown so (error), or may surprise (warning)."""
        return CODES[self.code][0]
