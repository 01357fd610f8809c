"""Writes one vehicle's row of the shared set points, so that no mode touches arrays."""

from __future__ import annotations

import math

from vehicle_sim.autopilot.body import Body, Vector
from vehicle_sim.control.setpoints import ControlLevel

NAN3: Vector = (math.nan, math.nan, math.nan)


class SetpointRow:
    """The controllers' input of vehicle `row`."""

    def __init__(self, body: Body) -> None:
        self._all = body.simulation.setpoints
        self._i = body.row

    def trajectory(
        self,
        position_ned_m: Vector = NAN3,
        velocity_ned_m_s: Vector = NAN3,
        acceleration_ned_m_s2: Vector = NAN3,
        yaw_ned_rad: float = math.nan,
        yaw_rate_ned_rad_s: float = math.nan,
    ) -> None:
        """Position, velocity, acceleration, each NaN where not controlled."""
        s, i = self._all, self._i
        s.level[i] = ControlLevel.TRAJECTORY
        s.position_ned_m[i] = position_ned_m
        s.velocity_ned_m_s[i] = velocity_ned_m_s
        s.acceleration_ned_m_s2[i] = acceleration_ned_m_s2
        s.yaw_ned_rad[i] = yaw_ned_rad
        s.yaw_rate_ned_rad_s[i] = yaw_rate_ned_rad_s

    def attitude(
        self, q_ned_frd: tuple[float, float, float, float], thrust: float, yaw_rate_ned_rad_s: float
    ) -> None:
        """Attitude and collective thrust."""
        s, i = self._all, self._i
        s.level[i] = ControlLevel.ATTITUDE
        s.q_ned_frd[i] = q_ned_frd
        s.thrust[i] = thrust
        s.yaw_rate_ned_rad_s[i] = yaw_rate_ned_rad_s

    def rates(self, rates_frd_rad_s: Vector, thrust: float) -> None:
        """Body rates and collective thrust."""
        s, i = self._all, self._i
        s.level[i] = ControlLevel.RATES
        s.rates_frd_rad_s[i] = rates_frd_rad_s
        s.thrust[i] = thrust

    def idle(self) -> None:
        """No controller: motors turn at idle when armed."""
        self._all.clear(self._i)
        self._all.level[self._i] = ControlLevel.DISARMED

    def armed(self, armed: bool) -> None:
        """Whether the motors may turn."""
        self._all.armed[self._i] = armed

    def limits(
        self,
        *,
        ramping: bool,
        landed: bool,
        climb_limit_m_s: float,
        min_thrust: float,
        tilt_limit_rad: float,
    ) -> None:
        """What the take-off state allows the position controller."""
        s, i = self._all, self._i
        s.ramp_thrust[i] = ramping
        s.landed[i] = landed
        s.climb_limit_m_s[i] = climb_limit_m_s
        s.min_thrust[i] = min_thrust
        s.tilt_limit_rad[i] = tilt_limit_rad
