"""Sends a setpoint to the offboard receiver of a simulated vehicle."""

from __future__ import annotations

import math

from missions.frames import Vector3
from missions.setpoints import (
    Acceleration,
    Attitude,
    DirectSetpoint,
    Partial3,
    Position,
    Rates,
    Trajectory,
    Velocity,
)
from vehicle_sim.autopilot.offboard import NAN3, Offboard, trajectory_setpoint

IGNORE_YAW_RATE, IGNORE_RATES, IGNORE_ATTITUDE = 4, 7, 128
"""Bits of SET_ATTITUDE_TARGET's type_mask. With IGNORE_YAW_RATE cleared, the third rate is the yaw rate."""

# Tuples: `isinstance` is faster with a tuple than with a union.
_TRAJECTORIES = (Trajectory, Position, Velocity, Acceleration)
_WITH_POSITION, _WITH_VELOCITY = (Trajectory, Position), (Trajectory, Velocity)
_WITH_ACCELERATION = (Trajectory, Acceleration)


def send(offboard: Offboard, setpoint: DirectSetpoint, start_ned_m: Vector3) -> None:
    """Sends a setpoint.

    Args:
        offboard: the vehicle's offboard receiver; its local origin is the vehicle's start position.
        setpoint: in the mission's local frame.
        start_ned_m: the vehicle's start position in the mission's local frame.

    Raises:
        ValueError: missions do not send this kind of setpoint.
    """
    if isinstance(setpoint, _TRAJECTORIES):  # first, because most setpoints are of these kinds
        position, velocity, acceleration = NAN3, NAN3, NAN3
        if isinstance(setpoint, _WITH_POSITION):
            (n, e, d), (n0, e0, d0) = _none_as_nan(setpoint.position_ned_m), start_ned_m
            position = (n - n0, e - e0, d - d0)
        if isinstance(setpoint, _WITH_VELOCITY):
            velocity = _none_as_nan(setpoint.velocity_ned_m_s)
        if isinstance(setpoint, _WITH_ACCELERATION):
            acceleration = _none_as_nan(setpoint.acceleration_ned_m_s2)
        yaw, yaw_rate = setpoint.yaw_ned_rad, setpoint.yaw_rate_ned_rad_s
        yaw, yaw_rate = math.nan if yaw is None else yaw, math.nan if yaw_rate is None else yaw_rate
        offboard.trajectory(trajectory_setpoint(position, velocity, acceleration, yaw, yaw_rate))
    elif isinstance(setpoint, Attitude):
        yaw_rate = setpoint.yaw_rate_ned_rad_s
        mask = IGNORE_RATES if yaw_rate is None else IGNORE_RATES & ~IGNORE_YAW_RATE
        offboard.attitude(mask, setpoint.q_ned_frd, (0.0, 0.0, yaw_rate or 0.0), setpoint.thrust)
    elif isinstance(setpoint, Rates):
        level = (1.0, 0.0, 0.0, 0.0)
        offboard.attitude(IGNORE_ATTITUDE, level, setpoint.rates_frd_rad_s, setpoint.thrust)
    else:
        raise ValueError(f"a mission sends no {setpoint.type}")


def _none_as_nan(vector: Partial3) -> Vector3:
    """NaN for a value that is not controlled."""
    x, y, z = vector
    if x is not None and y is not None and z is not None:
        return vector  # type: ignore[return-value]
    return (math.nan if x is None else x, math.nan if y is None else y, math.nan if z is None else z)
