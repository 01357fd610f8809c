"""Setpoints of a stream in the flights of a future, as the simulated PX4 takes them in Offboard."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from missions.frames import Vector3
from missions.setpoints import (
    Acceleration,
    Actuators,
    Attitude,
    DirectSetpoint,
    Partial3,
    Position,
    Rates,
    ThrustTorque,
    Trajectory,
    Velocity,
)
from vehicle_sim.autopilot.offboard import collective_thrust, motor_setpoint, thrust_torque_setpoint
from vehicle_sim.control.setpoints import ControlLevel, Setpoints

if TYPE_CHECKING:
    from numpy.typing import NDArray

NAN3: Vector3 = (math.nan, math.nan, math.nan)


def write_setpoint(setpoints: Setpoints, rows: NDArray[np.bool_], setpoint: DirectSetpoint) -> None:
    """Writes a setpoint in the local frame to these flights.

    Raises:
        ValueError: the setpoint is in another frame.
    """
    match setpoint:
        case Attitude(q_ned_frd=q, thrust=thrust, yaw_rate_ned_rad_s=yaw_rate):
            setpoints.level[rows] = ControlLevel.ATTITUDE
            setpoints.q_ned_frd[rows] = q
            setpoints.thrust[rows] = thrust
            setpoints.yaw_rate_ned_rad_s[rows] = _or_nan(yaw_rate)
        case Rates(rates_frd_rad_s=rates, thrust=thrust):
            setpoints.level[rows] = ControlLevel.RATES
            setpoints.rates_frd_rad_s[rows] = rates
            setpoints.thrust[rows] = thrust
        case ThrustTorque(thrust_frd=thrust_frd, torque_frd=torque):
            setpoints.level[rows] = ControlLevel.THRUST_TORQUE
            setpoints.thrust[rows] = collective_thrust(thrust_frd)
            setpoints.torque_frd[rows] = thrust_torque_setpoint(thrust_frd, torque).torque_frd
        case Actuators(motors=motors):
            signals = motor_setpoint([_or_nan(each) for each in motors[:4]]).motors
            setpoints.level[rows] = ControlLevel.MOTORS
            setpoints.motors[rows] = np.nan
            setpoints.motors[rows, : len(signals)] = signals
        case Position() | Velocity() | Acceleration() | Trajectory():
            setpoints.level[rows] = ControlLevel.TRAJECTORY
            position, velocity, acceleration = _vectors(setpoint)
            setpoints.position_ned_m[rows] = position
            setpoints.velocity_ned_m_s[rows] = velocity
            setpoints.acceleration_ned_m_s2[rows] = acceleration
            setpoints.yaw_ned_rad[rows] = _or_nan(setpoint.yaw_ned_rad)
            setpoints.yaw_rate_ned_rad_s[rows] = _or_nan(setpoint.yaw_rate_ned_rad_s)
        case _:
            raise ValueError(f"a setpoint of kind {setpoint.type!r} is not in the local frame")


def _vectors(
    setpoint: Position | Velocity | Acceleration | Trajectory,
) -> tuple[Vector3, Vector3, Vector3]:
    """Position, velocity and acceleration; NaN: not controlled."""
    match setpoint:
        case Position(position_ned_m=position):
            return _nans(position), NAN3, NAN3
        case Velocity(velocity_ned_m_s=velocity):
            return NAN3, _nans(velocity), NAN3
        case Acceleration(acceleration_ned_m_s2=acceleration):
            return NAN3, NAN3, _nans(acceleration)
        case Trajectory(
            position_ned_m=position, velocity_ned_m_s=velocity, acceleration_ned_m_s2=acceleration
        ):
            return _nans(position), _nans(velocity), _nans(acceleration)


def _nans(vector: Partial3) -> Vector3:
    x, y, z = (_or_nan(each) for each in vector)
    return (x, y, z)


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value
