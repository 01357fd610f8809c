"""Packs setpoints into MAVLink payloads: one encoder per message.

PX4 v1.16 follows local frames 1 (LOCAL_NED) and 8 (BODY_NED) and global frames 5, 6 and 11; of the global
frames, only 5 (altitude above mean sea level) does not depend on home. In frame 8, PX4 ignores positions, and
the whole velocity if one of the velocity's *ignore* bits is set. PX4 uses the fields whose *ignore* bit is 0.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Any

from gcs_server.mavlink import dialect as d
from missions.setpoints import (
    UNCONTROLLED,
    Acceleration,
    Attitude,
    DirectSetpoint,
    Partial3,
    Position,
    PositionGlobal,
    Rates,
    Trajectory,
    Velocity,
    VelocityBody,
    zeros_for_none,
)

MSG_LOCAL = d.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
MSG_GLOBAL = d.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT
MSG_ATTITUDE = d.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET
MSG_COMMAND_LONG = d.MAVLINK_MSG_ID_COMMAND_LONG
FRAME_LOCAL_NED = 1
FRAME_GLOBAL_AMSL = 5
FRAME_BODY_NED = 8

IGNORE_AXES = (1, 2, 4, 8, 16, 32, 64, 128, 256)
"""Bits of the axes of position, velocity and acceleration."""
IGNORE_YAW, IGNORE_YAW_RATE = 1024, 2048
ATTITUDE_IGNORE_RATES = 7
ATTITUDE_IGNORE_ROLL_AND_PITCH_RATE = 3
ATTITUDE_IGNORE_ATTITUDE = 128

_local = struct.Struct("<I11fHBBB")
_global = struct.Struct("<Iii9fHBBB")
_attitude = struct.Struct("<I8fBBB")
_time = struct.Struct("<I")
_command_long = struct.Struct("<7fHBBB")
LEVEL_Q = (1.0, 0.0, 0.0, 0.0)

Packed = tuple[int, bytes]
"""Message id, and payload without its time."""


def type_mask(
    position: Partial3, velocity: Partial3, acceleration: Partial3, yaw: float | None, yaw_rate: float | None
) -> int:
    """POSITION_TARGET_TYPEMASK: 2552 for a position with yaw, 1479 for a velocity with yaw rate, …"""
    mask = (IGNORE_YAW if yaw is None else 0) | (IGNORE_YAW_RATE if yaw_rate is None else 0)
    for bit, value in zip(IGNORE_AXES, (*position, *velocity, *acceleration), strict=True):
        if value is None:
            mask |= bit
    return mask


def _wrap_yaw(yaw: float | None) -> float:
    return math.remainder(yaw or 0.0, math.tau)


def _pack_local(
    frame: int,
    target: tuple[int, int],
    position: Partial3,
    velocity: Partial3,
    acceleration: Partial3,
    yaw: float | None,
    yaw_rate: float | None,
) -> Packed:
    return MSG_LOCAL, _local.pack(
        0,
        *zeros_for_none(position),
        *zeros_for_none(velocity),
        *zeros_for_none(acceleration),
        _wrap_yaw(yaw),
        yaw_rate or 0.0,
        type_mask(position, velocity, acceleration, yaw, yaw_rate),
        *target,
        frame,
    )


def _encode_position(s: Position, target: tuple[int, int]) -> Packed:
    return _pack_local(
        FRAME_LOCAL_NED,
        target,
        s.position_ned_m,
        UNCONTROLLED,
        UNCONTROLLED,
        s.yaw_ned_rad,
        s.yaw_rate_ned_rad_s,
    )


def _encode_velocity(s: Velocity, target: tuple[int, int]) -> Packed:
    return _pack_local(
        FRAME_LOCAL_NED,
        target,
        UNCONTROLLED,
        s.velocity_ned_m_s,
        UNCONTROLLED,
        s.yaw_ned_rad,
        s.yaw_rate_ned_rad_s,
    )


def _encode_velocity_body(s: VelocityBody, target: tuple[int, int]) -> Packed:
    return _pack_local(
        FRAME_BODY_NED,
        target,
        UNCONTROLLED,
        s.velocity_frd_m_s,
        UNCONTROLLED,
        s.yaw_ned_rad,
        s.yaw_rate_ned_rad_s,
    )


def _encode_acceleration(s: Acceleration, target: tuple[int, int]) -> Packed:
    return _pack_local(
        FRAME_LOCAL_NED,
        target,
        UNCONTROLLED,
        UNCONTROLLED,
        s.acceleration_ned_m_s2,
        s.yaw_ned_rad,
        s.yaw_rate_ned_rad_s,
    )


def _encode_trajectory(s: Trajectory, target: tuple[int, int]) -> Packed:
    return _pack_local(
        FRAME_LOCAL_NED,
        target,
        s.position_ned_m,
        s.velocity_ned_m_s,
        s.acceleration_ned_m_s2,
        s.yaw_ned_rad,
        s.yaw_rate_ned_rad_s,
    )


def _encode_position_global(s: PositionGlobal, target: tuple[int, int]) -> Packed:
    if s.alt_amsl_m is None:
        raise ValueError("alt_home_m must be converted to an altitude above mean sea level before it is sent")
    mask = type_mask((0.0, 0.0, 0.0), UNCONTROLLED, UNCONTROLLED, s.yaw_ned_rad, s.yaw_rate_ned_rad_s)
    return MSG_GLOBAL, _global.pack(
        0,
        round(s.lat_deg * 1e7),
        round(s.lon_deg * 1e7),
        s.alt_amsl_m,
        *(0.0,) * 6,
        _wrap_yaw(s.yaw_ned_rad),
        s.yaw_rate_ned_rad_s or 0.0,
        mask,
        *target,
        FRAME_GLOBAL_AMSL,
    )


def _encode_attitude(s: Attitude, target: tuple[int, int]) -> Packed:
    mask = ATTITUDE_IGNORE_RATES if s.yaw_rate_ned_rad_s is None else ATTITUDE_IGNORE_ROLL_AND_PITCH_RATE
    rates = (0.0, 0.0, s.yaw_rate_ned_rad_s or 0.0)
    return MSG_ATTITUDE, _attitude.pack(0, *s.q_ned_frd, *rates, s.thrust, *target, mask)


def _encode_rates(s: Rates, target: tuple[int, int]) -> Packed:
    return MSG_ATTITUDE, _attitude.pack(
        0, *LEVEL_Q, *s.rates_frd_rad_s, s.thrust, *target, ATTITUDE_IGNORE_ATTITUDE
    )


_ENCODERS: dict[type, Callable[[Any, tuple[int, int]], Packed]] = {
    Position: _encode_position,
    PositionGlobal: _encode_position_global,
    Velocity: _encode_velocity,
    VelocityBody: _encode_velocity_body,
    Acceleration: _encode_acceleration,
    Trajectory: _encode_trajectory,
    Attitude: _encode_attitude,
    Rates: _encode_rates,
}
MAVLINK_KINDS = frozenset(kind.type for kind in _ENCODERS)  # type: ignore[attr-defined]
"""Setpoint types for which there is a MAVLink message that PX4 follows."""


def encode(setpoint: DirectSetpoint, target: tuple[int, int]) -> Packed:
    """Message id and payload; the payload's time is zero.

    Args:
        setpoint: the setpoint to send.
        target: the vehicle's system id and its autopilot's component id.
    """
    return _ENCODERS[type(setpoint)](setpoint, target)


def with_time(payload: bytes, now_s: float) -> bytes:
    """The payload with `time_boot_ms` set."""
    return _time.pack(int(now_s * 1000) & 0xFFFFFFFF) + payload[_time.size :]


MAV_CMD_DO_SET_MODE = 176
MAV_MODE_FLAG_CUSTOM_MODE_ENABLED = 1
PX4_MAIN_MODE_AUTO = 4
PX4_AUTO_SUB_MODES = {"hold": 3, "land": 6}


def mode_command(mode: str, target: tuple[int, int], attempt: int) -> bytes:
    """The COMMAND_LONG payload that requests Hold or Land; `attempt` is the confirmation field."""
    return _command_long.pack(
        MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
        PX4_MAIN_MODE_AUTO,
        PX4_AUTO_SUB_MODES[mode],
        *(0.0,) * 4,
        MAV_CMD_DO_SET_MODE,
        *target,
        min(attempt, 255),
    )
