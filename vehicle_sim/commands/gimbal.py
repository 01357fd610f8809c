"""Commands of the gimbal manager (protocol version 2), and the deprecated mount commands that PX4 accepts."""

from __future__ import annotations

import math

from vehicle_sim.commands.command import ACCEPTED, DENIED, UNSUPPORTED, Command, CommandHost, Handler

CONFIGURE, PITCHYAW = 1001, 1000
ROI_LOCATION, ROI_WPNEXT, ROI_NONE, ROI_SYSID, ROI, MOUNT_CONTROL = 195, 196, 197, 198, 201, 205
MOUNT_CONFIGURE = 204
MOUNT_RETRACT, MOUNT_NEUTRAL, MOUNT_MAVLINK, MOUNT_RC, MOUNT_GPS = 0, 1, 2, 3, 4
"""MAV_MOUNT_MODE."""
ROI_MODE_NONE, ROI_MODE_LOCATION = 0, 3
"""MAV_ROI."""


class GimbalCommands:
    """Handles gimbal commands: control of the gimbal, and its target."""

    def __init__(self, host: CommandHost) -> None:
        self._host = host
        self._gimbal = host.autopilot.gimbal
        self.commands: dict[int, Handler] = {
            CONFIGURE: self.configure,
            PITCHYAW: self.pitch_yaw,
            ROI_LOCATION: self.roi_location,
            ROI_WPNEXT: self.roi_none_or_next,
            ROI_NONE: self.roi_none_or_next,
            ROI_SYSID: lambda command: UNSUPPORTED,
            ROI: self.roi,
            MOUNT_CONTROL: self.mount,
            MOUNT_CONFIGURE: lambda command: ACCEPTED if self._gimbal.enabled else None,
        }

    def configure(self, command: Command) -> int | None:
        """Takes, transfers or releases primary control; secondary control is not simulated."""
        if not self._gimbal.enabled:
            return None
        system_id, component_id = _to_int(command.p1), _to_int(command.p2)
        self._gimbal.configure(system_id, component_id, command.sender, self._host.autopilot_id)
        return ACCEPTED

    def pitch_yaw(self, command: Command) -> int | None:
        """Sets pitch and yaw: angles [deg] or rates [deg/s]."""
        if not self._gimbal.enabled:
            return None
        if not self._gimbal.controls(command.sender):
            return DENIED
        pitch, yaw, pitch_rate, yaw_rate = (
            math.radians(value) for value in (command.p1, command.p2, command.p3, command.p4)
        )
        self._gimbal.set_pitch_yaw(_to_int(command.p5), pitch, yaw, pitch_rate, yaw_rate)
        return ACCEPTED

    def roi_location(self, command: Command) -> int:
        """Points the gimbal at a location (ROI), even if the sender does not control the gimbal."""
        self._gimbal.point_at(command.p5, command.p6, command.p7)
        return ACCEPTED

    def roi_none_or_next(self, command: Command) -> int:
        """Clears the ROI, or points the gimbal at the next waypoint."""
        if command.number == ROI_NONE:
            self._gimbal.clear_roi()
        else:
            self._gimbal.point_at_next_waypoint(command.p6, command.p5, command.p7)
        return ACCEPTED

    def roi(self, command: Command) -> int:
        """Handles the deprecated DO_SET_ROI. PX4 reads only the mode (param1); the location is always
        latitude 0, longitude 0, at sea level."""
        if _to_int(command.p1) == ROI_MODE_LOCATION:
            self._gimbal.point_at(0.0, 0.0, 0.0)
        if _to_int(command.p1) == ROI_MODE_NONE:
            self._gimbal.clear_roi()
        return ACCEPTED

    def mount(self, command: Command) -> int | None:
        """Handles the deprecated DO_MOUNT_CONTROL, even if the sender does not control the gimbal."""
        if not self._gimbal.enabled:
            return None
        mode = _to_int(command.p7)
        if mode in (MOUNT_RETRACT, MOUNT_NEUTRAL):
            self._gimbal.lock_roll_and_pitch(centred=True)
        elif mode == MOUNT_RC:
            self._gimbal.lock_roll_and_pitch(centred=False)
        elif mode == MOUNT_MAVLINK:
            self._gimbal.set_mount_angles(command.p1, command.p2, command.p3)
        elif mode == MOUNT_GPS:
            self._gimbal.point_at(command.p5, command.p6, command.p4)
        return ACCEPTED


def _to_int(value: float) -> int:
    return int(value) if math.isfinite(value) else 0
