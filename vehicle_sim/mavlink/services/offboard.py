"""Passes SET_POSITION_TARGET_* and SET_ATTITUDE_TARGET to the offboard receiver."""

from __future__ import annotations

from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import Message
from vehicle_sim.mavlink.link import Link


class OffboardService:
    """Receives setpoints from any link; target system 0 means all vehicles, component 0 all components."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self.handlers = {
            "SET_POSITION_TARGET_LOCAL_NED": self.set_local_target,
            "SET_POSITION_TARGET_GLOBAL_INT": self.set_global_target,
            "SET_ATTITUDE_TARGET": self.set_attitude_target,
        }

    def _addresses_vehicle(self, message: Message) -> bool:
        return message.target_system in (0, self._context.system_id) and message.target_component in (0, 1)

    def set_local_target(self, link: Link, m: Message) -> None:
        """Handles SET_POSITION_TARGET_LOCAL_NED."""
        if self._addresses_vehicle(m):
            self._context.autopilot.offboard.receive_local_target(
                m.coordinate_frame, m.type_mask, (m.x, m.y, m.z), (m.vx, m.vy, m.vz), (m.afx, m.afy, m.afz),
                m.yaw, m.yaw_rate,
            )  # fmt: skip

    def set_global_target(self, link: Link, m: Message) -> None:
        """Handles SET_POSITION_TARGET_GLOBAL_INT."""
        if self._addresses_vehicle(m):
            self._context.autopilot.offboard.receive_global_target(
                m.coordinate_frame, m.type_mask, (m.lat_int / 1e7, m.lon_int / 1e7, m.alt),
                self._context.autopilot.home.alt_amsl_m, (m.vx, m.vy, m.vz), (m.afx, m.afy, m.afz), m.yaw,
                m.yaw_rate,
            )  # fmt: skip

    def set_attitude_target(self, link: Link, m: Message) -> None:
        """Handles SET_ATTITUDE_TARGET: thrust, with an attitude or body rates."""
        if self._addresses_vehicle(m):
            q = tuple(m.q)
            self._context.autopilot.offboard.attitude(
                m.type_mask, (q[0], q[1], q[2], q[3]), (m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate),
                m.thrust,
            )  # fmt: skip
