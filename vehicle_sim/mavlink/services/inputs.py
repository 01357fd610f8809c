"""Messages by which a client flies the vehicle: setpoints, sticks, a target to follow, and the gimbal."""

from __future__ import annotations

from collections.abc import Callable

from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import Message
from vehicle_sim.mavlink.link import Link


class InputService:
    """Passes messages of any link to the autopilot."""

    def __init__(self, context: Context) -> None:
        self._context, self._autopilot = context, context.autopilot
        self.handlers: dict[str, Callable[[Link, Message], None]] = {
            "SET_POSITION_TARGET_LOCAL_NED": self.set_local_target,
            "SET_POSITION_TARGET_GLOBAL_INT": self.set_global_target,
            "SET_ATTITUDE_TARGET": self.set_attitude_target,
            "MANUAL_CONTROL": self.manual_control,
            "FOLLOW_TARGET": self.follow_target,
            "GIMBAL_MANAGER_SET_ATTITUDE": self.set_gimbal_attitude,
            "GIMBAL_MANAGER_SET_MANUAL_CONTROL": self.set_gimbal_manual_control,
        }

    def _addresses_vehicle(self, message: Message) -> bool:
        """Whether a setpoint is for this vehicle: system 0 means all vehicles, component 0 all components."""
        return message.target_system in (0, self._context.system_id) and message.target_component in (0, 1)

    def set_local_target(self, link: Link, m: Message) -> None:
        """Handles SET_POSITION_TARGET_LOCAL_NED."""
        if self._addresses_vehicle(m):
            self._autopilot.offboard.receive_local_target(
                m.coordinate_frame, m.type_mask, (m.x, m.y, m.z), (m.vx, m.vy, m.vz), (m.afx, m.afy, m.afz),
                m.yaw, m.yaw_rate,
            )  # fmt: skip

    def set_global_target(self, link: Link, m: Message) -> None:
        """Handles SET_POSITION_TARGET_GLOBAL_INT."""
        if self._addresses_vehicle(m):
            self._autopilot.offboard.receive_global_target(
                m.coordinate_frame, m.type_mask, (m.lat_int / 1e7, m.lon_int / 1e7, m.alt),
                self._autopilot.home.alt_amsl_m, (m.vx, m.vy, m.vz), (m.afx, m.afy, m.afz), m.yaw,
                m.yaw_rate,
            )  # fmt: skip

    def set_attitude_target(self, link: Link, m: Message) -> None:
        """Handles SET_ATTITUDE_TARGET: thrust, with an attitude or body rates."""
        if self._addresses_vehicle(m):
            q = tuple(m.q)
            self._autopilot.offboard.attitude(
                m.type_mask, (q[0], q[1], q[2], q[3]), (m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate),
                m.thrust,
            )  # fmt: skip

    def manual_control(self, link: Link, m: Message) -> None:
        """Updates the stick input, and notifies the commander and its arming checks. MANUAL_CONTROL has a
        target system, but no component."""
        autopilot = self._autopilot
        if m.target == self._context.system_id and autopilot.sticks.receive(m.x, m.y, m.z, m.r):
            autopilot.commander.checks.manual_control_at_s = self._context.view.time_s
            autopilot.commander.on_stick_input()

    def follow_target(self, link: Link, m: Message) -> None:
        """Stores the target's position and velocity. It has no target system: all vehicles use it."""
        velocity = (m.vel[0], m.vel[1], m.vel[2])
        self._autopilot.navigator.follow.receive(m.lat / 1e7, m.lon / 1e7, m.alt, velocity)

    def _may_control_gimbal(self, message: Message) -> bool:
        gimbal = self._autopilot.gimbal
        return (
            gimbal.enabled
            and message.target_system == self._context.system_id
            and message.target_component in (0, 1)
            and gimbal.controls(message.sender)
        )

    def set_gimbal_attitude(self, link: Link, m: Message) -> None:
        """Handles GIMBAL_MANAGER_SET_ATTITUDE if the sender has control."""
        if self._may_control_gimbal(m):
            q = tuple(m.q)
            rates = (m.angular_velocity_x, m.angular_velocity_y, m.angular_velocity_z)
            self._autopilot.gimbal.set_attitude(m.flags, (q[0], q[1], q[2], q[3]), rates)

    def set_gimbal_manual_control(self, link: Link, m: Message) -> None:
        """Handles GIMBAL_MANAGER_SET_MANUAL_CONTROL if the sender has control."""
        if self._may_control_gimbal(m):
            self._autopilot.gimbal.set_manual(m.flags, m.pitch, m.yaw, m.pitch_rate, m.yaw_rate)
