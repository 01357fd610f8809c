"""Is the vehicle on the ground? PX4's multicopter detector, from estimate, thrust and what is asked of it.

Three stages, each held for a third of LNDMC_TRIG_TIME: ground contact (a descent is asked for, nothing moves,
little thrust), maybe landed (thrust at its minimum, no rotation), landed. Where there is a range finder that
does not see the ground, each takes three times as long.
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


LOW_THRUST = 0.3
"""Low is less than this part of the way from the least to the hover thrust,"""
LOW_THRUST_KNOWN_HOVER = 0.6
"""or this where the hover thrust is an estimate."""
MINIMUM_THRUST = 0.1
LANDED_SLACK = 2.5
"""Once landed, so much more motion and rotation is allowed."""
DESCENT_MARGIN = 1.1
"""A descent is asked for at this many times LNDMC_Z_VEL_MAX."""
NEAR_GROUND_M = 1.0
UNSEEN_GROUND_FACTOR = 3.0
NO_HEIGHT_S = 8.0
"""Without a vertical estimate, thrust at its minimum for so long is a landing."""


class Motion(NamedTuple):
    """What the detector looks at."""

    armed: bool
    thrust: float
    hover_thrust: float
    """Estimated, or MPC_THR_HOVER."""
    hover_thrust_known: bool
    """It is an estimate."""
    velocity_ned_m_s: tuple[float, float, float]
    down_by_position_m_s: float
    """Vertical velocity as the change of the position: noisier, but without the other's error."""
    vertical_known: bool
    rates_frd_rad_s: tuple[float, float, float]
    height_above_ground_m: float
    """By the range finder; NaN: it does not see the ground."""
    climb_rate_controlled: bool
    asked_down_m_s: float
    """Vertical velocity of the newest trajectory setpoint; NaN: none."""


@dataclass(frozen=True, slots=True)
class Limits:
    """LNDMC_* and thrust parameters."""

    climb_max_m_s: float
    horizontal_max_m_s: float
    rotation_max_rad_s: float
    trigger_s: float
    thrust_min: float
    thrust_min_by_hand: float


class LandDetector:
    """State of one vehicle."""

    def __init__(self) -> None:
        self._contact, self._maybe, self._landed = _Held(), _Held(), _Held()
        self._least_thrust = _Held()
        self._sees_ground = False
        """The range finder has seen the ground once: its silence means something."""

    @property
    def ground_contact(self) -> bool:
        """Something carries it."""
        return self._contact.state

    @property
    def maybe_landed(self) -> bool:
        """And it stands still without thrust."""
        return self._maybe.state

    @property
    def landed(self) -> bool:
        """For long enough."""
        return self._landed.state

    def update(self, now_s: float, motion: Motion, limits: Limits) -> None:
        """Look again; call at 50 Hz."""
        unseen = math.isnan(motion.height_above_ground_m)
        self._sees_ground |= not unseen
        factor = UNSEEN_GROUND_FACTOR if self._sees_ground and unseen else 1.0
        stage_s = limits.trigger_s / 3.0 * factor
        disarmed = not motion.armed
        self._contact.update(now_s, disarmed or self._touches(motion, limits), stage_s)
        self._maybe.update(now_s, disarmed or self._rests(now_s, motion, limits), stage_s)
        self._landed.update(now_s, disarmed or self.maybe_landed, stage_s)

    def _touches(self, motion: Motion, limits: Limits) -> bool:
        slack = LANDED_SLACK if self.landed else 1.0
        vn, ve, vd = motion.velocity_ned_m_s
        slowest = min(abs(vd), abs(motion.down_by_position_m_s))
        moves = (
            not motion.vertical_known
            or slowest >= limits.climb_max_m_s * slack
            or math.hypot(vn, ve) > limits.horizontal_max_m_s
        )
        part = LOW_THRUST_KNOWN_HOVER if motion.hover_thrust_known else LOW_THRUST
        low_thrust = motion.thrust <= _above_least(limits.thrust_min, motion.hover_thrust, part)
        down = motion.asked_down_m_s >= DESCENT_MARGIN * limits.climb_max_m_s
        meant = not motion.climb_rate_controlled or down or self.maybe_landed or self.landed
        near = not motion.height_above_ground_m >= NEAR_GROUND_M
        return near and low_thrust and meant and not moves

    def _rests(self, now_s: float, motion: Motion, limits: Limits) -> bool:
        least = limits.thrust_min_by_hand + 0.01
        if motion.climb_rate_controlled:
            least = _above_least(limits.thrust_min, motion.hover_thrust, MINIMUM_THRUST)
        idle = motion.thrust <= least
        self._least_thrust.update(now_s, idle, NO_HEIGHT_S)
        p, q, _ = motion.rates_frd_rad_s
        rotates = math.hypot(p, q) > limits.rotation_max_rad_s * (LANDED_SLACK if self.landed else 1.0)
        carried = self.ground_contact if motion.vertical_known else self._least_thrust.state
        return idle and not rotates and carried


class _Held:
    """True once its condition has held for a while, false as soon as it does not."""

    def __init__(self) -> None:
        self.state = True
        self._since_s = -math.inf

    def update(self, now_s: float, condition: bool, for_s: float) -> None:
        if not condition:
            self.state, self._since_s = False, math.inf
            return
        self._since_s = min(self._since_s, now_s)
        self.state = self.state or now_s - self._since_s >= for_s


def _above_least(least: float, hover: float, part: float) -> float:
    return least + (hover - least) * part
