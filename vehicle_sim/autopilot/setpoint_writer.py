"""Writes the setpoints of one vehicle into its row of the shared arrays."""

from __future__ import annotations

import math

import numpy as np

from vehicle_sim.control.setpoints import ControlLevel
from vehicle_sim.state import BoolArray, FloatArray, IntArray
from vehicle_sim.vehicle_view import Vector, VehicleView

NAN3: Vector = (math.nan, math.nan, math.nan)


# A plain number, because NumPy is three times slower with members of an enumeration.
_TRAJECTORY = int(ControlLevel.TRAJECTORY)


def float_view(row: FloatArray) -> memoryview[float]:
    """A memory view for single values; access is several times as fast as with NumPy."""
    return row.data.cast("B").cast("d")


def bool_view(row: BoolArray) -> memoryview[bool]:
    """A memory view for single flags."""
    return row.data.cast("B").cast("?")


def _int_view(row: IntArray) -> memoryview[int]:
    return row.data.cast("B").cast("q")


class SetpointWriter:
    """Writes the setpoints of one vehicle's controllers."""

    def __init__(self, view: VehicleView) -> None:
        self._setpoints = view.simulation.setpoints
        self._simulation = view.simulation
        self._row = view.row
        self._position = float_view(self._setpoints.position_ned_m[self._row])
        self._velocity = float_view(self._setpoints.velocity_ned_m_s[self._row])
        self._acceleration = float_view(self._setpoints.acceleration_ned_m_s2[self._row])
        # Views of the arrays of all vehicles, for the values that are written every tick.
        setpoints = self._setpoints
        self._level, self._in_air = _int_view(setpoints.level), bool_view(setpoints.in_air)
        self._yaw = float_view(setpoints.yaw_ned_rad)
        self._yaw_rate = float_view(setpoints.yaw_rate_ned_rad_s)
        self._ramping, self._landed = bool_view(setpoints.ramp_thrust), bool_view(setpoints.landed)
        self._climb_limit, self._min_thrust = (
            float_view(setpoints.climb_limit_m_s),
            float_view(setpoints.min_thrust),
        )
        self._tilt_limit, self._descent_limit = (
            float_view(setpoints.tilt_limit_rad),
            float_view(setpoints.descent_limit_m_s),
        )

    def trajectory(
        self,
        position_ned_m: Vector = NAN3,
        velocity_ned_m_s: Vector = NAN3,
        acceleration_ned_m_s2: Vector = NAN3,
        yaw_ned_rad: float = math.nan,
        yaw_rate_ned_rad_s: float = math.nan,
    ) -> None:
        """Writes position, velocity, acceleration, yaw and yaw rate; NaN: not controlled."""
        i = self._row
        self._level[i] = _TRAJECTORY
        position, velocity, acceleration = self._position, self._velocity, self._acceleration
        position[0], position[1], position[2] = position_ned_m
        velocity[0], velocity[1], velocity[2] = velocity_ned_m_s
        acceleration[0], acceleration[1], acceleration[2] = acceleration_ned_m_s2
        self._yaw[i] = yaw_ned_rad
        self._yaw_rate[i] = yaw_rate_ned_rad_s

    def last_trajectory(self) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
        """The last written position, velocity and acceleration; NaN: not controlled."""
        return tuple(self._position), tuple(self._velocity), tuple(self._acceleration)

    @property
    def below_trajectory(self) -> bool:
        """Whether the last setpoint bypasses the position controller."""
        return self._level[self._row] < _TRAJECTORY

    @property
    def setpoint_down_m_s(self) -> float:
        """The last written vertical velocity (down is positive); NaN: not controlled."""
        return self._velocity[2]

    def attitude(
        self, q_ned_frd: tuple[float, float, float, float], thrust: float, yaw_rate_ned_rad_s: float
    ) -> None:
        """Writes attitude, collective thrust and yaw rate (NaN: not controlled)."""
        s, i = self._setpoints, self._row
        s.level[i] = ControlLevel.ATTITUDE
        s.q_ned_frd[i] = q_ned_frd
        s.thrust[i] = thrust
        s.yaw_rate_ned_rad_s[i] = yaw_rate_ned_rad_s

    def rates(self, rates_frd_rad_s: Vector, thrust: float) -> None:
        """Writes body rates and collective thrust."""
        s, i = self._setpoints, self._row
        s.level[i] = ControlLevel.RATES
        s.rates_frd_rad_s[i] = rates_frd_rad_s
        s.thrust[i] = thrust

    def override_attitude(self, q_ned_frd: tuple[float, float, float, float] | None, rates_frd_rad_s: Vector,
               thrust: float) -> None:  # fmt: skip
        """Overrides the attitude (None: the body rates) until the next output of the outer controllers."""
        s, i = self._setpoints, self._row
        s.thrust[i] = thrust
        if q_ned_frd is not None:
            s.q_ned_frd[i] = q_ned_frd
            s.override_level[i] = ControlLevel.ATTITUDE
        else:
            s.rates_frd_rad_s[i] = rates_frd_rad_s
            s.override_level[i] = ControlLevel.RATES

    def override_motors(self, thrust: float, torque_frd: Vector, signals: tuple[float, ...]) -> None:
        """Overrides the motor signals for one step, or thrust and torque if there are no signals."""
        s, i = self._setpoints, self._row
        if signals:
            s.motors[i, : len(signals)] = signals
            s.override_level[i] = ControlLevel.MOTORS
        else:
            s.thrust[i], s.torque_frd[i] = thrust, torque_frd
            s.override_level[i] = ControlLevel.THRUST_TORQUE

    def thrust_torque(self, thrust: float, torque_frd: Vector) -> None:
        """Writes collective thrust 0..1 and normalised torques, which bypass the rate controller."""
        s, i = self._setpoints, self._row
        s.level[i] = ControlLevel.THRUST_TORQUE
        s.thrust[i] = thrust
        s.torque_frd[i] = torque_frd

    def motors(self, signals: tuple[float, ...]) -> None:
        """Writes motor signals, which bypass the mixer; NaN: stopped."""
        s, i = self._setpoints, self._row
        s.level[i] = ControlLevel.MOTORS
        s.motors[i] = np.nan
        s.motors[i, : len(signals)] = signals

    def freeze_motors(self) -> None:
        """Writes the last motor signals again, with all controllers off."""
        pulses_us = self._simulation.motors_us[self._row].tolist()
        self.motors(tuple((each - 1000.0) / 1000.0 if each >= 1000.0 else math.nan for each in pulses_us))

    def disable_controllers(self) -> None:
        """Disables all controllers; armed motors run at idle."""
        self._setpoints.clear(self._row)
        self._setpoints.level[self._row] = ControlLevel.DISARMED

    def set_armed(self, armed: bool) -> None:
        """Sets whether the motors may run."""
        self._setpoints.armed[self._row] = armed

    def set_in_air(self, in_air: bool) -> None:
        """Sets whether the land detector reports a flight."""
        self._in_air[self._row] = in_air

    def set_limits(
        self,
        *,
        ramping: bool,
        landed: bool,
        climb_limit_m_s: float,
        descent_limit_m_s: float,
        min_thrust: float,
        tilt_limit_rad: float,
    ) -> None:
        """Sets the limits of the position controller for this tick."""
        i = self._row
        self._ramping[i] = ramping
        self._landed[i] = landed
        self._climb_limit[i] = climb_limit_m_s
        self._descent_limit[i] = descent_limit_m_s
        self._min_thrust[i] = min_thrust
        self._tilt_limit[i] = tilt_limit_rad
