"""A scripted autopilot on a link that may lose packets.

The autopilot uses pymavlink's encoder and parser (the simulator's dialect module), so the tests check the
server's codec against independent code.
"""

import asyncio
import math
import random
import struct
from collections.abc import Callable
from typing import Any

from gcs_server.mavlink.codec import encode_frame
from gcs_server.scenarios.memory_link import MemoryLink
from tests.protocol.command_numbers import FORCE
from vehicle_sim.mavlink import generated_dialect as sim

HOLD_MODE, TAKEOFF_MODE, LAND_MODE, RTL_MODE = (4 << 16 | sub << 24 for sub in (3, 2, 6, 5))
MANUAL_MODE, POSITION_MODE, OFFBOARD_MODE = (main << 16 for main in (1, 3, 6))
ORBIT_MODE = 3 << 16 | 1 << 24
ON_GROUND, IN_AIR = sim.MAV_LANDED_STATE_ON_GROUND, sim.MAV_LANDED_STATE_IN_AIR
TAKING_OFF = sim.MAV_LANDED_STATE_TAKEOFF
INT32, REAL32 = sim.MAV_PARAM_TYPE_INT32, sim.MAV_PARAM_TYPE_REAL32
LATENCY_S = 0.005
COMMANDER_DELAY_S = 0.008
"""Time until PX4's commander changes the mode after a command."""


class FakeAutopilot:
    """Replies as PX4 does in the recordings, as far as these tests need."""

    def __init__(
        self,
        link: MemoryLink,
        *,
        system: int = 1,
        loss: float = 0.0,
        seed: int = 0,
        peer: str = "peer",
        uid: int = 0x4954414C44494E4F,  # of every PX4 in SITL
        booted_at_s: float = 900.0,  # time of the event loop, which starts at 1000 s
    ) -> None:
        self.link, self.peer, self.system, self.uid, self.booted_at_s = link, peer, system, uid, booted_at_s
        self.loss, self.random = loss, random.Random(seed)
        self.mav = sim.MAVLink(None, srcSystem=system, srcComponent=1)
        self.parser = sim.MAVLink(None)
        self.loop = asyncio.get_running_loop()
        self.armed, self.mode, self.landed_state = False, HOLD_MODE, ON_GROUND
        self.received_messages: list[Any] = []
        self.refusals: dict[int, int] = {}
        """Commands that the autopilot refuses, with the MAV_RESULT of the acknowledgement."""
        self.silent_commands: set[int] = set()
        """Commands that the autopilot ignores."""
        self.arm_denied = False
        self.vehicle_type, self.autopilot_type, self.sends_version = 2, 12, True
        self.home = (47.397742, 8.545594, 489.0)
        self.position = [47.397742, 8.545594, 489.0]
        self.has_position = True
        self.target = (47.397742, 8.545594, 489.0)
        self.target_yaw_rad = 0.0
        self.circle = (1.0, 47.397742, 8.545594, 489.0)
        """Radius, latitude, longitude, altitude of the orbit."""
        self.params: dict[str, tuple[int, float]] = {
            "MPC_XY_VEL_MAX": (REAL32, 12.0),
            "MC_ORBIT_RAD_MAX": (REAL32, 1000.0),
            "NAV_DLL_ACT": (INT32, 2),
        }
        self.commanding = (255, 190)
        """Sender of the newest command, to which acknowledgements are addressed."""
        self.gimbal_control = (0, 0)
        """System and component in control of the gimbal."""
        self.has_gimbal = True
        self.gimbal_q = [1.0, 0.0, 0.0, 0.0]
        self.gimbal_flags = 0
        self.handlers: list[Callable[[Any], bool]] = []
        """Called for each message before the autopilot; True: the message is handled."""
        self.event_sequence = 0
        self.alive = True
        """False: the autopilot sends nothing."""
        self.last_arrival_s = 0.0
        self._every(1.0, self.send_heartbeat)
        self._every(2.0, self.send_current_mode)
        self._every(1.0, self.send_extended_sys_state)
        self._every(0.1, self.send_global_position)
        self._every(2.0, self.send_home_position)
        self._every(2.0, self.send_gimbal_status)

    # --- link
    def _every(self, period_s: float, work: Callable[[], None]) -> None:
        def run() -> None:
            if self.alive:
                work()
            self.loop.call_later(period_s, run)

        self.loop.call_later(period_s * self.random.random() * 0.5, run)

    def send(self, message: Any) -> None:
        self.send_raw(message.pack(self.mav))

    def send_raw(self, raw: bytes) -> None:
        self.mav.seq = (self.mav.seq + 1) % 256
        if self.alive and self.random.random() >= self.loss:
            # Packets keep their order.
            self.last_arrival_s = max(self.loop.time() + LATENCY_S, self.last_arrival_s + 1e-6)
            self.loop.call_at(self.last_arrival_s, lambda: self.link.inject(raw, self.peer))

    def receive(self, data: bytes) -> None:
        if self.random.random() >= self.loss:
            for message in self.parser.parse_buffer(data) or []:
                self.loop.call_later(LATENCY_S, self.handle, message)

    # --- telemetry
    def boot_ms(self) -> int:
        return int((self.loop.time() - self.booted_at_s) * 1000)

    def send_heartbeat(self) -> None:
        base_mode = 29 | (128 if self.armed else 0)
        self.send(
            sim.MAVLink_heartbeat_message(self.vehicle_type, self.autopilot_type, base_mode, self.mode, 4, 3)
        )

    def send_current_mode(self) -> None:
        self.send(sim.MAVLink_current_mode_message(0, self.mode, self.mode))

    def send_extended_sys_state(self) -> None:
        self.send(sim.MAVLink_extended_sys_state_message(0, self.landed_state))

    def send_global_position(self) -> None:
        if self.has_position:
            lat, lon, alt = self.position
            self.send(
                sim.MAVLink_global_position_int_message(
                    self.boot_ms(),
                    int(lat * 1e7),
                    int(lon * 1e7),
                    int(alt * 1e3),
                    int((alt - 489.0) * 1e3),
                    0,
                    0,
                    0,
                    0,
                )
            )

    def send_home_position(self) -> None:
        lat, lon, alt = self.home
        self.send(
            sim.MAVLink_home_position_message(
                round(lat * 1e7), round(lon * 1e7), round(alt * 1e3), 0, 0, 0, [1, 0, 0, 0], 0, 0, 0
            )
        )

    def send_position_target(self) -> None:
        lat, lon, alt = self.target
        self.send(
            sim.MAVLink_position_target_global_int_message(
                self.boot_ms(),
                5,
                0,
                round(lat * 1e7),
                round(lon * 1e7),
                alt,
                *[0] * 6,
                self.target_yaw_rad,
                0,
            )
        )

    def send_orbit_status(self) -> None:
        if self.mode == ORBIT_MODE:
            radius, lat, lon, alt = self.circle
            message = sim.MAVLink_orbit_execution_status_message
            self.send(message(0, radius, 0, round(lat * 1e7), round(lon * 1e7), alt))

    def send_gimbal_status(self) -> None:
        if self.has_gimbal:
            self.send(
                sim.MAVLink_gimbal_manager_status_message(
                    self.boot_ms(), self.gimbal_flags, 1, *self.gimbal_control, 0, 0
                )
            )

    def send_gimbal_attitude(self) -> None:
        if self.has_gimbal:
            self.send(
                sim.MAVLink_gimbal_device_attitude_status_message(
                    0, 0, self.boot_ms(), self.gimbal_flags, self.gimbal_q, 0, 0, 0, 0, 0, 0, 1
                )
            )

    def send_text(self, text: str, severity: int = 2, text_id: int = 0) -> None:
        raw = text.encode()
        chunks = [raw[i : i + 50] for i in range(0, len(raw), 50)]
        for number, chunk in enumerate(chunks):
            self.send(sim.MAVLink_statustext_message(severity, chunk, text_id, number))

    def send_event(self, event_id: int, levels: int, arguments: bytes = b"") -> None:
        self.event_sequence += 1
        self.send(
            sim.MAVLink_event_message(
                0, 0, event_id, self.boot_ms(), self.event_sequence, levels, list(arguments.ljust(40, b"\0"))
            )
        )

    # --- behaviour
    def send_ack(self, command: int, result: int, progress: int = 0) -> None:
        self.send(sim.MAVLink_command_ack_message(command, result, progress, 0, *self.commanding))

    def handle(self, message: Any) -> None:
        self.received_messages.append(message)
        if any(handler(message) for handler in self.handlers):
            return
        kind = message.get_type()
        if kind in ("COMMAND_LONG", "COMMAND_INT"):
            self.handle_command(message)
        elif kind == "PARAM_REQUEST_READ":
            self.send_param_value(message.param_id)
        elif kind == "PARAM_SET" and message.param_id in self.params:
            self.params[message.param_id] = (message.param_type, self.decoded_value(message))
            self.send_param_value(message.param_id)
        elif kind == "GIMBAL_MANAGER_SET_ATTITUDE" and self.gimbal_control == (
            message.get_srcSystem(),
            message.get_srcComponent(),
        ):
            self.gimbal_q = list(message.q)

    def decoded_value(self, message: Any) -> float:
        if message.param_type == INT32:
            return struct.unpack("<i", bytes(message.get_msgbuf())[10:14])[0]
        return message.param_value

    def send_param_value(self, name: str) -> None:
        if name not in self.params:
            return
        param_type, value = self.params[name]
        bits = struct.pack("<i", int(value)) if param_type == INT32 else struct.pack("<f", value)
        payload = bits + struct.pack("<HH16sB", 929, 1, name.encode(), param_type)
        self.send_raw(encode_frame(sim.MAVLINK_MSG_ID_PARAM_VALUE, payload, self.mav.seq, self.system, 1))

    def handle_command(self, message: Any) -> None:
        self.commanding = (message.get_srcSystem(), message.get_srcComponent())
        params = [message.param1, message.param2, message.param3, message.param4]
        position = (
            (message.x / 1e7, message.y / 1e7, message.z)
            if message.get_type() == "COMMAND_INT"
            else (message.param5, message.param6, message.param7)
        )
        command = message.command
        if command in self.silent_commands:
            return
        if command == sim.MAV_CMD_REQUEST_MESSAGE:
            self.send_requested_message(int(params[0]))
        elif command in self.refusals:
            self.send_ack(command, self.refusals[command])
        elif command == sim.MAV_CMD_COMPONENT_ARM_DISARM:
            self.arm(params)
        elif command == sim.MAV_CMD_DO_SET_MODE:
            self.set_mode(params)
        elif command == sim.MAV_CMD_NAV_TAKEOFF:
            self.mode, self.target = TAKEOFF_MODE, (self.position[0], self.position[1], position[2])
            self.send_ack(command, 0)
        elif command == sim.MAV_CMD_DO_REPOSITION:
            self.reposition(params, position)
        elif command == sim.MAV_CMD_DO_ORBIT:
            self.mode, self.circle = ORBIT_MODE, (params[0], *position)
            self.send_ack(command, 0)
        elif command == sim.MAV_CMD_DO_CHANGE_SPEED:
            self.send_ack(command, 0)
        elif command == sim.MAV_CMD_DO_SET_HOME:
            self.home = tuple(self.position) if params[0] == 1 else position
            self.send_ack(command, 0)
        elif command == sim.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE and self.has_gimbal:
            if params[0] == -3.0:
                self.gimbal_control = (0, 0) if self.gimbal_control == (255, 190) else self.gimbal_control
            else:
                self.gimbal_control = (int(params[0]), int(params[1]))
            self.send_ack(command, 0)
        elif command == sim.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW and self.has_gimbal:
            self.send_ack(
                command,
                0 if self.gimbal_control == (message.get_srcSystem(), message.get_srcComponent()) else 2,
            )
        elif command in (sim.MAV_CMD_DO_SET_ROI_LOCATION, sim.MAV_CMD_DO_SET_ROI_NONE):
            self.send_ack(command, 0)

    def reposition(self, params: list[float], position: tuple[float, float, float]) -> None:
        values = zip(position, self.target, strict=True)
        self.target = tuple(old if math.isnan(new) else new for new, old in values)  # type: ignore[assignment]
        if not math.isnan(params[3]):
            self.target_yaw_rad = params[3]
        self.mode = HOLD_MODE
        self.send_ack(sim.MAV_CMD_DO_REPOSITION, 0)

    def arm(self, params: list[float]) -> None:
        if params[0] == 1 and self.arm_denied:
            self.send_ack(sim.MAV_CMD_COMPONENT_ARM_DISARM, 1)
            self.send_text("Arming denied: Resolve system health failures first\t", 2, 7)
            self.send_event(16910493, 0x22)
            return
        if params[0] == 0 and self.landed_state != ON_GROUND and params[1] != FORCE:
            self.send_ack(sim.MAV_CMD_COMPONENT_ARM_DISARM, 1)
            self.send_text("Disarming denied: not landed\t", 2)
            self.send_event(25868725, 0x22)
            return
        self.armed = params[0] == 1
        self.send_ack(sim.MAV_CMD_COMPONENT_ARM_DISARM, 0)
        if self.armed and self.mode == TAKEOFF_MODE:
            # PX4 discards the altitude of an earlier command.
            self.target = (*self.position[:2], self.home[2] + 2.5)
            self.loop.call_later(1.5, self.lift_off)

    def lift_off(self) -> None:
        if self.armed and self.mode == TAKEOFF_MODE:
            self.landed_state = TAKING_OFF

    def set_mode(self, params: list[float]) -> None:
        mode = int(params[1]) << 16 | int(params[2]) << 24
        self.send_ack(sim.MAV_CMD_DO_SET_MODE, 0)
        refused = self.armed and mode == MANUAL_MODE

        def reply_of_commander() -> None:
            self.send_ack(sim.MAV_CMD_DO_SET_MODE, 1 if refused else 0)
            if refused:
                self.send_text("Switching to Manual is currently not available\t", 2)
                self.send_event(27280279, 0x22, HOLD_MODE.to_bytes(4, "little") + b"\0")
            else:
                self.mode = mode

        self.loop.call_later(COMMANDER_DELAY_S, reply_of_commander)

    def send_requested_message(self, msg_id: int) -> None:
        send_message = {
            sim.MAVLINK_MSG_ID_HEARTBEAT: self.send_heartbeat,
            sim.MAVLINK_MSG_ID_CURRENT_MODE: self.send_current_mode,
            sim.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: self.send_extended_sys_state,
            sim.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: self.send_position_target,
            sim.MAVLINK_MSG_ID_HOME_POSITION: self.send_home_position,
            sim.MAVLINK_MSG_ID_ORBIT_EXECUTION_STATUS: self.send_orbit_status,
            sim.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS: self.send_gimbal_status,
            sim.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: self.send_gimbal_attitude,
            sim.MAVLINK_MSG_ID_AUTOPILOT_VERSION: self.send_autopilot_version,
        }.get(msg_id)
        if send_message is None:
            self.send_ack(sim.MAV_CMD_REQUEST_MESSAGE, sim.MAV_RESULT_DENIED)
            return
        send_message()
        self.send_ack(sim.MAV_CMD_REQUEST_MESSAGE, 0)

    def send_autopilot_version(self) -> None:
        if self.sends_version:
            self.send(
                sim.MAVLink_autopilot_version_message(
                    321791, 0x011000FF, 0x011000FF, 0, 1, [0] * 8, [0] * 8, [0] * 8, 0, 0, self.uid, [0] * 18
                )
            )

    def received_commands(self, command: int) -> list[Any]:
        return [
            m
            for m in self.received_messages
            if m.get_type().startswith("COMMAND_") and getattr(m, "command", None) == command
        ]
