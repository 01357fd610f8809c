"""Writes one vehicle's row of the shared setpoint arrays."""

from __future__ import annotations

import math

import numpy as np

from vehicle_sim.control.setpoints import ControlLevel
from vehicle_sim.state import BoolArray, FloatArray, IntArray
from vehicle_sim.vehicle_view import Vector, VehicleView

NAN3: Vector = (math.nan, math.nan, math.nan)


# Plain numbers, because NumPy is three times slower with members of an enumeration.
_TRAJECTORY = int(ControlLevel.TRAJECTORY)


def numbers(row: FloatArray) -> memoryview[float]:
    """A view to read and write single numbers, several times as fast as NumPy."""
    return row.data.cast("B").cast("d")


def _flags(row: BoolArray) -> memoryview[bool]:
    return row.data.cast("B").cast("?")


def _integers(row: IntArray) -> memoryview[int]:
    return row.data.cast("B").cast("q")


class SetpointRow:
    """The controllers' input of one vehicle."""

    def __init__(self, view: VehicleView) -> None:
        self._all = view.simulation.setpoints
        self._simulation = view.simulation
        self._i = view.row
        self._position = numbers(self._all.position_ned_m[self._i])
        self._velocity = numbers(self._all.velocity_ned_m_s[self._i])
        self._acceleration = numbers(self._all.acceleration_ned_m_s2[self._i])
        # The same for single numbers of all vehicles; writes that happen every tick bypass NumPy.
        every = self._all
        self._level, self._in_air = _integers(every.level), _flags(every.in_air)
        self._yaw, self._yaw_rate = numbers(every.yaw_ned_rad), numbers(every.yaw_rate_ned_rad_s)
        self._ramping, self._landed = _flags(every.ramp_thrust), _flags(every.landed)
        self._climb_limit, self._min_thrust = numbers(every.climb_limit_m_s), numbers(every.min_thrust)
        self._tilt_limit, self._descent_limit = (
            numbers(every.tilt_limit_rad),
            numbers(every.descent_limit_m_s),
        )

    def trajectory(
        self,
        position_ned_m: Vector = NAN3,
        velocity_ned_m_s: Vector = NAN3,
        acceleration_ned_m_s2: Vector = NAN3,
        yaw_ned_rad: float = math.nan,
        yaw_rate_ned_rad_s: float = math.nan,
    ) -> None:
        """Writes position, velocity and acceleration; NaN: not controlled."""
        i = self._i
        self._level[i] = _TRAJECTORY
        at, speed, push = self._position, self._velocity, self._acceleration
        at[0], at[1], at[2] = position_ned_m
        speed[0], speed[1], speed[2] = velocity_ned_m_s
        push[0], push[1], push[2] = acceleration_ned_m_s2
        self._yaw[i] = yaw_ned_rad
        self._yaw_rate[i] = yaw_rate_ned_rad_s

    def asked(self) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
        """The last written position, velocity and acceleration; NaN: not controlled."""
        return tuple(self._position), tuple(self._velocity), tuple(self._acceleration)

    @property
    def below_trajectory(self) -> bool:
        """Whether the last setpoint bypasses the position controller."""
        return self._level[self._i] < _TRAJECTORY

    @property
    def asked_down_m_s(self) -> float:
        """The last written vertical velocity; NaN: not controlled."""
        return self._velocity[2]

    def attitude(
        self, q_ned_frd: tuple[float, float, float, float], thrust: float, yaw_rate_ned_rad_s: float
    ) -> None:
        """Writes attitude and collective thrust."""
        s, i = self._all, self._i
        s.level[i] = ControlLevel.ATTITUDE
        s.q_ned_frd[i] = q_ned_frd
        s.thrust[i] = thrust
        s.yaw_rate_ned_rad_s[i] = yaw_rate_ned_rad_s

    def rates(self, rates_frd_rad_s: Vector, thrust: float) -> None:
        """Writes body rates and collective thrust."""
        s, i = self._all, self._i
        s.level[i] = ControlLevel.RATES
        s.rates_frd_rad_s[i] = rates_frd_rad_s
        s.thrust[i] = thrust

    def override_level(self, q_ned_frd: tuple[float, float, float, float] | None, rates_frd_rad_s: Vector,
               thrust: float) -> None:  # fmt: skip
        """Overrides with an attitude, or body rates, until the next output of the outer controllers."""
        s, i = self._all, self._i
        s.thrust[i] = thrust
        if q_ned_frd is not None:
            s.q_ned_frd[i] = q_ned_frd
            s.override_level[i] = ControlLevel.ATTITUDE
        else:
            s.rates_frd_rad_s[i] = rates_frd_rad_s
            s.override_level[i] = ControlLevel.RATES

    def override_motors(self, thrust: float, torque_frd: Vector, signals: tuple[float, ...]) -> None:
        """Overrides the motors with their signals, or by thrust and torque without any, for one step."""
        s, i = self._all, self._i
        if signals:
            s.motors[i, : len(signals)] = signals
            s.override_level[i] = ControlLevel.MOTORS
        else:
            s.thrust[i], s.torque_frd[i] = thrust, torque_frd
            s.override_level[i] = ControlLevel.THRUST_TORQUE

    def thrust_torque(self, thrust: float, torque_frd: Vector) -> None:
        """Writes collective thrust 0..1 and normalised torques, which bypass the rate controller."""
        s, i = self._all, self._i
        s.level[i] = ControlLevel.THRUST_TORQUE
        s.thrust[i] = thrust
        s.torque_frd[i] = torque_frd

    def motors(self, signals: tuple[float, ...]) -> None:
        """Writes motor signals, which bypass the mixer; NaN: stopped."""
        s, i = self._all, self._i
        s.level[i] = ControlLevel.MOTORS
        s.motors[i] = np.nan
        s.motors[i, : len(signals)] = signals

    def freeze_motors(self) -> None:
        """Writes the last motor signals again: all controllers are off."""
        pulses = self._simulation.motors_us[self._i].tolist()
        self.motors(tuple((each - 1000.0) / 1000.0 if each >= 1000.0 else math.nan for each in pulses))

    def idle(self) -> None:
        """Disables all controllers; armed motors run at idle."""
        self._all.clear(self._i)
        self._all.level[self._i] = ControlLevel.DISARMED

    def armed(self, armed: bool) -> None:
        """Sets whether the motors may run."""
        self._all.armed[self._i] = armed

    def in_air(self, in_air: bool) -> None:
        """Sets whether the land detector reports a flight."""
        self._in_air[self._i] = in_air

    def limits(
        self,
        *,
        ramping: bool,
        landed: bool,
        climb_limit_m_s: float,
        descent_limit_m_s: float,
        min_thrust: float,
        tilt_limit_rad: float,
    ) -> None:
        """Sets the limits of the position controller during take-off."""
        i = self._i
        self._ramping[i] = ramping
        self._landed[i] = landed
        self._climb_limit[i] = climb_limit_m_s
        self._descent_limit[i] = descent_limit_m_s
        self._min_thrust[i] = min_thrust
        self._tilt_limit[i] = tilt_limit_rad
