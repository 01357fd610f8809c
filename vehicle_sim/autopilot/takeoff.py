"""The take-off state: motor spool-up, then a ramp of the allowed climb rate from zero thrust to the full
rate."""

from __future__ import annotations

import math
from enum import IntEnum

GRAVITY_M_S2 = 9.80665
TILT_LIMIT_RISE_RAD_S = 0.2
"""Rate at which PX4 increases the tilt limit after the take-off ramp."""


class TakeoffState(IntEnum):
    """State of the take-off."""

    DISARMED = 0
    SPOOLUP = 1
    READY = 2
    RAMPUP = 3
    FLIGHT = 4


class TakeoffRamp:
    """PX4's take-off state machine for one vehicle."""

    def __init__(self) -> None:
        self.state = TakeoffState.DISARMED
        self.climb_limit_m_s = math.nan
        self._armed_at_s = 0.0
        self._progress = 0.0

    def update(
        self,
        now_s: float,
        dt_s: float,
        *,
        armed: bool,
        landed: bool,
        wants_to_climb: bool,
        spoolup_s: float,
        ramp_s: float,
        speed_m_s: float,
        velocity_gain: float,
    ) -> None:
        """Updates the state; `climb_limit_m_s` is NaN in flight, after the ramp.

        Args:
            velocity_gain: MPC_Z_VEL_P_ACC; the ramp starts at the speed error that gives zero thrust.
        """
        if not armed:
            self.state = TakeoffState.DISARMED
        elif self.state is TakeoffState.DISARMED:
            self.state, self._armed_at_s = TakeoffState.SPOOLUP, now_s
        if self.state is TakeoffState.SPOOLUP and now_s - self._armed_at_s >= spoolup_s:
            self.state = TakeoffState.READY
        if self.state is TakeoffState.READY and (wants_to_climb or not landed):
            self.state, self._progress = TakeoffState.RAMPUP, 0.0
        if self.state is TakeoffState.RAMPUP:
            self._progress = min(1.0, self._progress + dt_s / ramp_s) if ramp_s > dt_s else 1.0
            if self._progress >= 1.0:
                self.state = TakeoffState.FLIGHT
        elif self.state is TakeoffState.FLIGHT and landed:
            self.state = TakeoffState.READY
        start = -GRAVITY_M_S2 / velocity_gain if velocity_gain > 0.0 else -1.0
        if self.state is TakeoffState.FLIGHT:
            self.climb_limit_m_s = math.nan
        elif self.state is TakeoffState.RAMPUP:
            self.climb_limit_m_s = start + self._progress * (speed_m_s - start)
        else:
            self.climb_limit_m_s = start

    @property
    def flying(self) -> bool:
        """Whether the ramp is over."""
        return self.state is TakeoffState.FLIGHT

    @property
    def may_thrust(self) -> bool:
        """Whether the ramp has started; before that the controllers get no setpoint."""
        return self.state >= TakeoffState.RAMPUP
