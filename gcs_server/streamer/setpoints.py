"""What may be streamed, as frozen values, and the bytes PX4 reads it from.

Frame is always 1 (MAV_FRAME_LOCAL_NED), one of the two local frames that PX4 follows. Which fields it
follows is said by *ignore* bits (POSITION_TARGET_TYPEMASK).
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

Vector3 = tuple[float, float, float]

MSG_SET_POSITION_TARGET_LOCAL_NED = 84
MAV_FRAME_LOCAL_NED = 1

IGNORE_POSITION = 1 | 2 | 4
IGNORE_VELOCITY = 8 | 16 | 32
IGNORE_ACCELERATION = 64 | 128 | 256
IGNORE_YAW = 1024
IGNORE_YAW_RATE = 2048


@dataclass(frozen=True, slots=True)
class Setpoint:
    """One target: a position or a velocity, in the vehicle's local NED frame.

    Exactly one of `position_ned_m` and `velocity_ned_m_s` is given, and at most one of yaw and yaw rate;
    with neither, the heading at the moment it is taken is kept.
    """

    position_ned_m: Vector3 | None = None
    velocity_ned_m_s: Vector3 | None = None
    yaw_ned_rad: float | None = None
    yaw_rate_ned_rad_s: float | None = None

    @property
    def type(self) -> str:
        """`position` or `velocity`, as in the API."""
        return "position" if self.position_ned_m is not None else "velocity"

    @property
    def type_mask(self) -> int:
        """The ignore bits: 2552 for a position with yaw, 1479 for a velocity with yaw rate, …"""
        mask = IGNORE_ACCELERATION
        mask |= IGNORE_VELOCITY if self.position_ned_m is not None else IGNORE_POSITION
        if self.yaw_ned_rad is None:
            mask |= IGNORE_YAW
        if self.yaw_rate_ned_rad_s is None:
            mask |= IGNORE_YAW_RATE
        return mask


@dataclass(frozen=True, slots=True)
class OnExpiry:
    """What the thread does by itself when a setpoint has become too old."""

    action: str = "hold"
    """hold, land, stop_stream."""
    hold_for_s: float = 5.0
    """With `hold`: how long position setpoints hold the place before PX4's own Hold mode is asked for."""


@dataclass(frozen=True, slots=True)
class Order:
    """A setpoint, for how long it is good, what comes after, and whose it is."""

    setpoint: Setpoint
    valid_for_s: float = 1.0
    on_expiry: OnExpiry = OnExpiry()
    client: str = ""


class SetpointPacket:
    """A payload packed once and stamped with the time at each sending.

    Args:
        target_system: the vehicle's MAVLink system id.
        target_component: its autopilot's component id.
    """

    _layout = struct.Struct("<IfffffffffffHBBB")
    _time = struct.Struct("<I")

    def __init__(self, target_system: int, target_component: int) -> None:
        self._target = (target_system, target_component, MAV_FRAME_LOCAL_NED)
        self._buffer = bytearray(self._layout.size)

    def load(self, setpoint: Setpoint) -> None:
        """Packs everything but the time; ignored fields are zero."""
        self._layout.pack_into(
            self._buffer,
            0,
            0,
            *(setpoint.position_ned_m or (0.0, 0.0, 0.0)),
            *(setpoint.velocity_ned_m_s or (0.0, 0.0, 0.0)),
            0.0,
            0.0,
            0.0,
            math.remainder(setpoint.yaw_ned_rad or 0.0, math.tau),
            setpoint.yaw_rate_ned_rad_s or 0.0,
            setpoint.type_mask,
            *self._target,
        )

    def stamped(self, now_s: float) -> bytes:
        """The payload with `time_boot_ms` set."""
        self._time.pack_into(self._buffer, 0, int(now_s * 1000) & 0xFFFFFFFF)
        return bytes(self._buffer)


MSG_COMMAND_LONG = 76
MAV_CMD_DO_SET_MODE = 176
MAV_MODE_FLAG_CUSTOM_MODE_ENABLED = 1
PX4_MAIN_MODE_AUTO = 4
PX4_AUTO_SUB_MODES = {"hold": 3, "land": 6}
_command_long = struct.Struct("<fffffffHBBB")


def mode_command(mode: str, target_system: int, target_component: int, attempt: int) -> bytes:
    """The COMMAND_LONG payload that asks for Hold or Land; `attempt` becomes its confirmation field."""
    return _command_long.pack(
        MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
        PX4_MAIN_MODE_AUTO,
        PX4_AUTO_SUB_MODES[mode],
        0,
        0,
        0,
        0,
        MAV_CMD_DO_SET_MODE,
        target_system,
        target_component,
        min(attempt, 255),
    )
