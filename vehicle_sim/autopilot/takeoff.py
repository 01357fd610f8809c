"""The states of a take-off. In the ramp, the allowed climb rate increases from the rate that gives zero
thrust to the maximum."""

from __future__ import annotations

import math
from enum import IntEnum

from vehicle_sim.kernels import kernel

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


@kernel
def climb_limit(progress: float, max_climb_m_s: float, velocity_gain: float) -> float:
    """The allowed climb rate at this progress of the ramp (0 to 1)."""
    start_m_s = -GRAVITY_M_S2 / velocity_gain if velocity_gain > 0.0 else -1.0
    return start_m_s + progress * (max_climb_m_s - start_m_s)


class TakeoffRamp:
    """PX4's take-off state machine for one vehicle.

    Args:
        progress: (1,) progress of the ramp, 0 to 1.
    """

    def __init__(self, progress: memoryview[float]) -> None:
        self.state = TakeoffState.DISARMED
        self.climb_limit_m_s = math.nan
        self.armed_at_s = 0.0
        self._progress = progress

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
            speed_m_s: maximum climb rate.
            velocity_gain: MPC_Z_VEL_P_ACC.
        """
        if not armed:
            self.state = TakeoffState.DISARMED
        elif self.state is TakeoffState.DISARMED:
            self.state, self.armed_at_s = TakeoffState.SPOOLUP, now_s
        if self.state is TakeoffState.SPOOLUP and now_s - self.armed_at_s >= spoolup_s:
            self.state = TakeoffState.READY
        if self.state is TakeoffState.READY and (wants_to_climb or not landed):
            self.state, self._progress[0] = TakeoffState.RAMPUP, 0.0
        if self.state is TakeoffState.RAMPUP:
            self._progress[0] = min(1.0, self._progress[0] + dt_s / ramp_s) if ramp_s > dt_s else 1.0
            if self._progress[0] >= 1.0:
                self.state = TakeoffState.FLIGHT
        elif self.state is TakeoffState.FLIGHT and landed:
            self.state = TakeoffState.READY
        if self.state is TakeoffState.FLIGHT:
            self.climb_limit_m_s = math.nan
            return
        progress = self._progress[0] if self.state is TakeoffState.RAMPUP else 0.0
        self.climb_limit_m_s = climb_limit(progress, speed_m_s, velocity_gain)

    @property
    def flying(self) -> bool:
        """Whether the vehicle is in flight, after the ramp."""
        return self.state is TakeoffState.FLIGHT

    @property
    def ramp_started(self) -> bool:
        """Whether the ramp has started; before the ramp PX4 commands a downward acceleration."""
        return self.state >= TakeoffState.RAMPUP
