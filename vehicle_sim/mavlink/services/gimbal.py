"""Messages of the gimbal manager (protocol version 2); the commands are in `commands/gimbal.py`."""

from __future__ import annotations

from collections.abc import Callable

from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import Message
from vehicle_sim.mavlink.link import Link


class GimbalService:
    """Handles GIMBAL_MANAGER_SET_ATTITUDE and GIMBAL_MANAGER_SET_MANUAL_CONTROL."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._gimbal = context.autopilot.gimbal
        self.handlers: dict[str, Callable[[Link, Message], None]] = {
            "GIMBAL_MANAGER_SET_ATTITUDE": self.set_attitude,
            "GIMBAL_MANAGER_SET_MANUAL_CONTROL": self.set_manual_control,
        }

    def _may_control(self, message: Message) -> bool:
        gimbal = self._gimbal
        return (
            gimbal.enabled
            and message.target_system == self._context.system_id
            and message.target_component in (0, 1)
            and gimbal.controls(message.sender)
        )

    def set_attitude(self, link: Link, m: Message) -> None:
        """Handles GIMBAL_MANAGER_SET_ATTITUDE if the sender has control."""
        if self._may_control(m):
            q = tuple(m.q)
            rates = (m.angular_velocity_x, m.angular_velocity_y, m.angular_velocity_z)
            self._gimbal.set_attitude(m.flags, (q[0], q[1], q[2], q[3]), rates)

    def set_manual_control(self, link: Link, m: Message) -> None:
        """Handles GIMBAL_MANAGER_SET_MANUAL_CONTROL if the sender has control."""
        if self._may_control(m):
            self._gimbal.set_manual(m.flags, m.pitch, m.yaw, m.pitch_rate, m.yaw_rate)
