"""Decodes a gimbal from the messages of its manager and its device.

Frames, as PX4 v1.16 sends them: the quaternion of GIMBAL_DEVICE_ATTITUDE_STATUS and the yaw of
MOUNT_ORIENTATION (sent ten times as often) are relative to north while yaw is locked, otherwise to the nose.
MOUNT_ORIENTATION.yaw_absolute adds the heading in either case and is not used. In GIMBAL_MANAGER_INFORMATION
PX4 sends the limits in degrees; the limits of roll are meaningless.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping

from gcs_server.mavlink import dialect as d
from gcs_server.vehicle.numbers import MAX_MAGNITUDE, Unusable, number, rotation
from gcs_server.vehicle.samples import GimbalReading
from missions.frames import euler_from_q, q_from_euler, wrap_pi

_status = struct.Struct("<II5B")
_device = struct.Struct("<I4f3fIHBBffB")
_mount = struct.Struct("<I3f")
_information = struct.Struct("<II6fB")
_quaternion = struct.Struct("<I4f")
_euler = struct.Struct("<I3f")

FORMATS: dict[int, struct.Struct] = {
    d.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS: _status,
    d.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: _device,
    d.MAVLINK_MSG_ID_MOUNT_ORIENTATION: _mount,
    d.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION: _information,
}
IDS: tuple[int, ...] = (
    d.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS,
    d.MAVLINK_MSG_ID_MOUNT_ORIENTATION,
    d.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS,
    d.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION,
)
VEHICLE_FRAME = d.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME
EARTH_FRAME = d.GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME
YAW_LOCK = d.GIMBAL_DEVICE_FLAGS_YAW_LOCK
MAX_ANGLE_RAD = math.radians(720.0)
MIN_RANGE_RAD = math.radians(0.1)
"""Plausibility of reported angle limits: largest angle, and smallest difference of the two limits."""


def gimbal(
    payloads: Mapping[int, bytes], component_id: int, device_id: int
) -> tuple[GimbalReading, float] | None:
    """One gimbal, and the time of its attitude since boot [s]; None before the first attitude.

    Args:
        payloads: payloads of this gimbal, by message id, and of the vehicle's attitude (ATTITUDE_QUATERNION
            or ATTITUDE), which converts yaw between the two frames.
        component_id: component id of the gimbal's manager.
        device_id: device id at the manager.

    Raises:
        Unusable: the received attitude is not a rotation.
    """
    device = payloads.get(d.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS)
    mount = payloads.get(d.MAVLINK_MSG_ID_MOUNT_ORIENTATION)
    status = payloads.get(d.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS)
    if device is None and mount is None:
        return None
    flags, primary, secondary = _manager_status(status)
    time_ms, q, roll, pitch, yaw = -1, None, 0.0, 0.0, 0.0
    if device is not None:
        values = _device.unpack_from(device)
        q = rotation(values[1:5])
        if status is None or values[0] >= _status.unpack_from(status)[0]:
            flags = values[9]
        if q is not None:
            time_ms = values[0]
            roll, pitch, yaw = euler_from_q(q)
    if mount is not None:
        mount_ms, roll_deg, pitch_deg, yaw_deg = _mount.unpack_from(mount)
        if mount_ms > time_ms and all(
            -MAX_MAGNITUDE <= v <= MAX_MAGNITUDE for v in (roll_deg, pitch_deg, yaw_deg)
        ):
            time_ms = mount_ms
            roll, pitch, yaw = (math.radians(v) for v in (roll_deg, pitch_deg, yaw_deg))
            q = q_from_euler(roll, pitch, yaw)
    if q is None:
        raise Unusable(
            "the gimbal's attitude (GIMBAL_DEVICE_ATTITUDE_STATUS or MOUNT_ORIENTATION) is not a rotation"
        )
    in_earth_frame = yaw_in_earth_frame(flags)
    heading = _heading(payloads)
    yaw_ned = yaw if in_earth_frame else None if heading is None else wrap_pi(yaw + heading)
    yaw_frd = yaw if not in_earth_frame else None if heading is None else wrap_pi(yaw - heading)
    limits = _limits(payloads.get(d.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION))
    value = GimbalReading(
        gimbal_device_id=device_id,
        roll_rad=roll,
        pitch_rad=pitch,
        yaw_frd_rad=yaw_frd,
        yaw_ned_rad=yaw_ned,
        q=q,
        yaw_in_earth_frame=in_earth_frame,
        yaw_lock=bool(flags & YAW_LOCK),
        primary_control=primary,
        secondary_control=secondary,
        flags=flags,
        pitch_min_rad=limits[0],
        pitch_max_rad=limits[1],
        yaw_min_rad=limits[2],
        yaw_max_rad=limits[3],
        component_id=component_id,
    )
    return value, time_ms / 1e3


def yaw_in_earth_frame(flags: int) -> bool:
    """Whether a device's yaw is relative to north. If neither frame flag is set, yaw is relative to north
    while yaw is locked."""
    if flags & EARTH_FRAME:
        return True
    return False if flags & VEHICLE_FRAME else bool(flags & YAW_LOCK)


def control_of(status: bytes) -> tuple[int, int] | None:
    """(system id, component id) of the primary controller in GIMBAL_MANAGER_STATUS; None: not controlled."""
    return _manager_status(status)[1]


def device_id_of(status: bytes) -> int:
    """The device id, from GIMBAL_MANAGER_STATUS."""
    return _status.unpack_from(status)[2]


def _manager_status(status: bytes | None) -> tuple[int, tuple[int, int] | None, tuple[int, int] | None]:
    if status is None:
        return 0, None, None
    _, flags, _, system, component, second_system, second_component = _status.unpack_from(status)
    primary = (system, component) if system or component else None
    secondary = (second_system, second_component) if second_system or second_component else None
    return flags, primary, secondary


def _heading(payloads: Mapping[int, bytes]) -> float | None:
    payload = payloads.get(d.MAVLINK_MSG_ID_ATTITUDE_QUATERNION)
    q = None if payload is None else rotation(_quaternion.unpack_from(payload)[1:5])
    if q is not None:
        return euler_from_q(q)[2]
    payload = payloads.get(d.MAVLINK_MSG_ID_ATTITUDE)
    return None if payload is None else number(_euler.unpack_from(payload)[3])


def _limits(information: bytes | None) -> tuple[float | None, float | None, float | None, float | None]:
    if information is None:
        return None, None, None, None
    values = _information.unpack_from(information)
    if any(number(v) is None for v in values[4:8]):
        return None, None, None, None
    pitch_min, pitch_max, yaw_min, yaw_max = values[4:8]
    if max(abs(v) for v in values[4:8]) > 2 * math.pi + 0.01:  # PX4 sends degrees
        pitch_min, pitch_max, yaw_min, yaw_max = (math.radians(v) for v in values[4:8])
    pitch = _range(pitch_min, pitch_max)
    yaw = _range(yaw_min, yaw_max)
    return pitch[0], pitch[1], yaw[0], yaw[1]


def _range(low: float, high: float) -> tuple[float | None, float | None]:
    is_plausible = high - low > MIN_RANGE_RAD
    return (low, high) if is_plausible and max(-low, high) <= MAX_ANGLE_RAD else (None, None)
