"""Findings about an offboard mission: stable code, message, step, and a fix if there is one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

CODES: dict[str, tuple[Literal["error", "warning"], str]] = {
    "takeoff_missing": ("error", "a step that flies before the vehicle has taken off"),
    "takeoff_in_air": ("error", "a take-off while the vehicle is flying"),
    "landing_missing": ("warning", "the mission ends in the air; the vehicle holds its position"),
    "estimate_missing": (
        "error",
        "a position requires the global position or the altitude of home, which is unknown",
    ),
    "step_invalid": ("error", "a step that cannot be flown"),
    "speed_too_high": ("warning", "a speed above the vehicle's limit; the limit is used"),
    "speed_exceeded": ("error", "a table or velocity faster than the vehicle's limits"),
    "acceleration_exceeded": ("error", "a table with more acceleration than the vehicle's limits"),
    "tilt_exceeded": ("error", "an attitude with more tilt than the vehicle's limit"),
    "duration_too_short": ("error", "a velocity that is not reached in its time"),
    "position_not_held": ("warning", "the position is not controlled during this step"),
    "altitude_too_high": ("warning", "more than 120 m above home"),
    "altitude_fence": ("error", "above GF_MAX_VER_DIST"),
    "altitude_below_home": (
        "warning",
        "at or below the altitude of home or of the start (an error if a path is lower by more than "
        "MPC_LAND_ALT3, unless elevation data show the ground there)",
    ),
    "radius_exceeded": ("error", "farther from home than GF_MAX_HOR_DIST"),
    "limit_exceeded": (
        "error",
        "beyond the operator's limits for this vehicle; the server keeps the vehicle inside the limits",
    ),
    "fence_crossed": ("error", "the path leaves the geofence"),
    "fence_unknown": ("error", "the geofence cannot be checked without a global position"),
    "obstacle_hit": ("error", "the path passes through an obstacle"),
    "obstacle_avoided": (
        "warning",
        "the path passes through an obstacle that only the vehicle's obstacle sensor can avoid",
    ),
    "obstacle_near": ("warning", "the path comes within 2 m of an obstacle"),
    "obstacle_invalid": ("error", "an obstacle whose sides cross or that has no area"),
    "obstacles_unknown": ("error", "the obstacles cannot be checked without a global position"),
    "terrain_hit": ("error", "the path goes below the ground"),
    "terrain_near": ("warning", "the path comes within 10 m of the ground"),
    "condition_never": ("warning", "a condition that can never become true"),
    "condition_unreported": ("warning", "a condition on a value that the vehicle does not report"),
    "gimbal_steep": ("warning", "the gimbal is commanded beyond straight up or down"),
    "separation": ("error", "the planned paths of two vehicles come too close"),
    "separation_unknown": (
        "warning",
        "the positions of the vehicles are unknown, so their separation cannot be checked",
    ),
    "parameters_unknown": ("warning", "vehicle parameters that are not known; PX4's defaults are used"),
    "endurance_exceeded": ("error", "more energy than the battery provides"),
}
"""Severity and meaning of each code."""


@dataclass(frozen=True, slots=True)
class MissionFinding:
    """One problem of a mission."""

    code: str
    message: str
    """Message for the pilot."""
    step: str | None = None
    """The step: "step 3", "step 4.2"; None: the whole mission."""
    fix: str | None = None
    limit: float | None = None
    """The limit that was exceeded: altitude above home [m], speed [m/s], tilt [rad] or shortest duration [s];
    None: no limit."""
    is_error: bool = False
    """Whether this case of a warning is an error."""
    obstacle: int | None = None
    """Index of the obstacle in the document; None: the finding is not about an obstacle."""

    @property
    def severity(self) -> Literal["error", "warning"]:
        """error: unsafe or impossible; warning: the flight may differ from what the pilot expects."""
        return "error" if self.is_error else CODES[self.code][0]
