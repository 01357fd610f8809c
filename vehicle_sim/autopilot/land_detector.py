"""Is the vehicle on the ground? PX4's multicopter detector from estimate, thrust and descent intent alone.

Three stages, each held for a third of LNDMC_TRIG_TIME: ground contact (thrust low or the descent blocked),
maybe landed (thrust at its minimum, no rotation), landed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple


class LandedState(IntEnum):
    """MAV_LANDED_STATE."""

    UNDEFINED = 0
    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


class Motion(NamedTuple):
    """What the detector looks at."""

    armed: bool
    thrust: float
    velocity_ned_m_s: tuple[float, float, float]
    rates_frd_rad_s: tuple[float, float, float]
    descends: bool
    """The mode wants to go down (or nothing is asked yet)."""


@dataclass(frozen=True, slots=True)
class Limits:
    """LNDMC_* and thrust parameters."""

    climb_max_m_s: float
    horizontal_max_m_s: float
    rotation_max_rad_s: float
    trigger_s: float
    thrust_min: float
    thrust_hover: float


class LandDetector:
    """State of one vehicle."""

    def __init__(self) -> None:
        self.landed = True
        self.ground_contact = True
        self.maybe_landed = True
        self._contact_since_s: float | None = None
        self._maybe_since_s: float | None = None
        self._landed_since_s: float | None = None

    def update(self, now_s: float, motion: Motion, limits: Limits) -> None:
        """Look again; call at 50 Hz."""
        if not motion.armed:
            self.landed = self.ground_contact = self.maybe_landed = True
            self._contact_since_s = self._maybe_since_s = self._landed_since_s = now_s - 10.0
            return
        span = limits.thrust_hover - limits.thrust_min
        low_thrust = motion.thrust <= limits.thrust_min + 0.3 * span
        minimum_thrust = motion.thrust <= limits.thrust_min + 0.1 * span
        vn, ve, vd = motion.velocity_ned_m_s
        slack = 2.5 if self.landed else 1.0
        moves_up_or_down = abs(vd) > limits.climb_max_m_s * slack
        moves_sideways = math.hypot(vn, ve) > limits.horizontal_max_m_s * slack
        p, q, _ = motion.rates_frd_rad_s
        rotates = math.hypot(p, q) > limits.rotation_max_rad_s * slack
        third_s = limits.trigger_s / 3.0
        touching = low_thrust and not moves_up_or_down and not moves_sideways and motion.descends
        if self.landed:
            touching = low_thrust
        self._contact_since_s = _since(touching, self._contact_since_s, now_s)
        self.ground_contact = _held(self._contact_since_s, now_s, third_s)
        maybe = self.ground_contact and minimum_thrust and not rotates
        if self.landed:
            maybe = minimum_thrust
        self._maybe_since_s = _since(maybe, self._maybe_since_s, now_s)
        self.maybe_landed = _held(self._maybe_since_s, now_s, third_s)
        self._landed_since_s = _since(self.maybe_landed, self._landed_since_s, now_s)
        self.landed = _held(self._landed_since_s, now_s, third_s)


def _since(condition: bool, since_s: float | None, now_s: float) -> float | None:
    return (now_s if since_s is None else since_s) if condition else None


def _held(since_s: float | None, now_s: float, for_s: float) -> bool:
    return since_s is not None and now_s - since_s >= for_s
