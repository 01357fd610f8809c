"""Messages of the gimbal manager, sent while it takes commands by MAVLink, and of the gimbal device, sent
while the gimbal module runs.
"""

from __future__ import annotations

import math

from vehicle_sim.mavlink.dialect import pack
from vehicle_sim.mavlink.messages.message_group import MessageGroup

CAPABILITIES = 132530
"""GIMBAL_MANAGER_CAP_FLAGS, as PX4 reports them."""


class GimbalMessages(MessageGroup):
    """Builders of the gimbal messages."""

    def mount_orientation(self) -> bytes | None:
        gimbal = self._autopilot.gimbal
        if not gimbal.running:
            return None
        angles = gimbal.actual
        return pack(
            "MOUNT_ORIENTATION",
            time_boot_ms=self._view.time_boot_ms(),
            roll=math.degrees(angles.roll_rad),
            pitch=math.degrees(angles.pitch_rad),
            yaw=math.degrees(angles.yaw_rad),
            yaw_absolute=math.degrees(gimbal.yaw_ned_rad) % 360.0,
        )[1]

    def gimbal_manager_information(self) -> bytes | None:
        gimbal, parameter = self._autopilot.gimbal, self._view.parameter
        if not gimbal.enabled:
            return None
        pitch, yaw, roll = (parameter(f"MNT_RANGE_{axis}") for axis in ("PITCH", "YAW", "ROLL"))
        return pack(
            "GIMBAL_MANAGER_INFORMATION",
            time_boot_ms=self._view.time_boot_ms(),
            cap_flags=CAPABILITIES,
            gimbal_device_id=gimbal.device_id,
            roll_min=-roll, roll_max=roll, pitch_min=-pitch, pitch_max=pitch, yaw_min=-yaw, yaw_max=yaw,
        )[1]  # fmt: skip

    def gimbal_manager_status(self) -> bytes | None:
        gimbal = self._autopilot.gimbal
        if not gimbal.enabled:
            return None
        return pack(
            "GIMBAL_MANAGER_STATUS",
            time_boot_ms=self._view.time_boot_ms(),
            flags=int(gimbal.flags),
            gimbal_device_id=gimbal.device_id,
            primary_control_sysid=gimbal.primary[0],
            primary_control_compid=gimbal.primary[1],
        )[1]

    def gimbal_device_attitude_status(self) -> bytes | None:
        gimbal = self._autopilot.gimbal
        if not gimbal.running:
            return None
        rates = gimbal.rates
        return pack(
            "GIMBAL_DEVICE_ATTITUDE_STATUS",
            time_boot_ms=self._view.time_boot_ms(),
            flags=int(gimbal.flags),
            q=gimbal.device_quaternion(),
            angular_velocity_x=rates.roll_rad_s,
            angular_velocity_y=rates.pitch_rad_s,
            angular_velocity_z=rates.yaw_rad_s,
            gimbal_device_id=gimbal.device_id,
        )[1]
