"""Sends a setpoint to the offboard receiver of a simulated vehicle."""

from __future__ import annotations

import math

from missions.frames import Vector3
from missions.setpoints import (
    NOTHING,
    Acceleration,
    Attitude,
    DirectSetpoint,
    Partial3,
    Position,
    Rates,
    Trajectory,
    Velocity,
)
from vehicle_sim.autopilot.offboard import LOCAL_NED, YAW_BIT, YAW_RATE_BIT, Offboard

IGNORE_YAW_RATE, IGNORE_RATES, IGNORE_ATTITUDE = 4, 7, 128
"""Bits of SET_ATTITUDE_TARGET's type_mask. With IGNORE_YAW_RATE cleared, the third rate is the yaw rate."""


def send(offboard: Offboard, setpoint: DirectSetpoint, start_ned_m: Vector3) -> None:
    """Sends a setpoint.

    Args:
        offboard: the vehicle's offboard receiver; its local origin is the vehicle's start position.
        setpoint: in the mission's local frame.
        start_ned_m: the vehicle's start position in the mission's local frame.

    Raises:
        ValueError: missions do not send this kind of setpoint.
    """
    if isinstance(setpoint, Attitude):
        rate = setpoint.yaw_rate_ned_rad_s
        mask = IGNORE_RATES if rate is None else IGNORE_RATES & ~IGNORE_YAW_RATE
        offboard.attitude(mask, setpoint.q_ned_frd, (0.0, 0.0, rate or 0.0), setpoint.thrust)
        return
    if isinstance(setpoint, Rates):
        level = (1.0, 0.0, 0.0, 0.0)
        offboard.attitude(IGNORE_ATTITUDE, level, setpoint.rates_frd_rad_s, setpoint.thrust)
        return
    if not isinstance(setpoint, Position | Velocity | Acceleration | Trajectory):
        raise ValueError(f"a mission sends no {setpoint.type}")
    position, velocity, acceleration = NOTHING, NOTHING, NOTHING
    if isinstance(setpoint, Position | Trajectory):
        n, e, d = (_minus(at, start) for at, start in zip(setpoint.position_ned_m, start_ned_m, strict=True))
        position = (n, e, d)
    if isinstance(setpoint, Velocity | Trajectory):
        velocity = setpoint.velocity_ned_m_s
    if isinstance(setpoint, Acceleration | Trajectory):
        acceleration = setpoint.acceleration_ned_m_s2
    yaw, rate = setpoint.yaw_ned_rad, setpoint.yaw_rate_ned_rad_s
    mask = _mask(position, 1) | _mask(velocity, 8) | _mask(acceleration, 64)
    mask |= (YAW_BIT if yaw is None else 0) | (YAW_RATE_BIT if rate is None else 0)
    offboard.local(
        LOCAL_NED, mask, _numbers(position), _numbers(velocity), _numbers(acceleration),
        math.nan if yaw is None else yaw, math.nan if rate is None else rate,
    )  # fmt: skip


def _minus(value: float | None, by: float) -> float | None:
    return None if value is None else value - by


def _mask(vector: Partial3, first_bit: int) -> int:
    return sum(first_bit << axis for axis, value in enumerate(vector) if value is None)


def _numbers(vector: Partial3) -> tuple[float, float, float]:
    x, y, z = (math.nan if value is None else value for value in vector)
    return (x, y, z)
