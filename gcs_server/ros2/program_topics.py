"""What a ROS 2 program sends to a guarded link, as the MAVLink messages that mean the same. No I/O, no clock.

PX4 stays in Offboard while OffboardControlMode comes; its flags choose which setpoint is flown, and a
setpoint that was sent once counts until the next one. So a setpoint is passed when it comes, and again with
each OffboardControlMode that comes without a new one. A program that asks for Offboard before its first
setpoint, as the example of PX4's guide, holds the place where the vehicle is.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from typing import Any, Final, Literal

from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import Frame, encode_frame, encode_payload, full_payload
from gcs_server.mavlink.dialect import MAVLink_message
from gcs_server.mavlink.tables import LAYOUTS
from gcs_server.ros2.formats import REQUEST
from gcs_server.ros2.message_types import Values
from gcs_server.ros2.topics import COMMAND

Way = Literal["mode", "setpoint", "command", "read", "sensor"]
CONTROL_MODE: Final = "/fmu/in/offboard_control_mode"
TRAJECTORY: Final = "/fmu/in/trajectory_setpoint"
ATTITUDE: Final = "/fmu/in/vehicle_attitude_setpoint"
RATES: Final = "/fmu/in/vehicle_rates_setpoint"
LOCAL_POSITION: Final = "/fmu/out/vehicle_local_position"
SETPOINT_OF_FLAG: Final[Mapping[str, str]] = {
    "position": TRAJECTORY,
    "velocity": TRAJECTORY,
    "acceleration": TRAJECTORY,
    "attitude": ATTITUDE,
    "body_rate": RATES,
}
"""The topic that is flown by the first flag that is set, as PX4 reads them."""
_SENSORS: Final = (
    "distance_sensor", "obstacle_distance", "sensor_optical_flow", "vehicle_mocap_odometry",
    "vehicle_visual_odometry", "onboard_computer_status",
)  # fmt: skip
WAYS: Final[Mapping[str, Way]] = {
    CONTROL_MODE: "mode",
    TRAJECTORY: "setpoint",
    ATTITUDE: "setpoint",
    RATES: "setpoint",
    COMMAND: "command",
    REQUEST: "read",
    **{f"/fmu/in/{name}": "sensor" for name in _SENSORS},
}
"""What becomes of each topic of a program; any other is refused. read, sensor: passed to the vehicle as it
is; a sensor whoever has control, as the vehicle may fly by it, but not on a link that only reads."""
NOT_PASSED: Final = "a guard does not pass this topic."
_UNLIMITED: Final = "no limit, fence or brake of this server can act on it."
_MODES: Final = "the setpoints of a program's own flight mode would not be checked: use Offboard."
REFUSED: Final[Mapping[str, str]] = {
    "/fmu/in/vehicle_thrust_setpoint": _UNLIMITED,
    "/fmu/in/vehicle_torque_setpoint": _UNLIMITED,
    "/fmu/in/actuator_motors": _UNLIMITED,
    "/fmu/in/actuator_servos": _UNLIMITED,
    "/fmu/in/goto_setpoint": _MODES,
    "/fmu/in/register_ext_component_request": _MODES,
    "/fmu/in/config_control_setpoints": _MODES,
    "/fmu/in/config_overrides_request": _MODES,
    "/fmu/in/vehicle_command_mode_executor": _MODES,
    "/fmu/in/manual_control_input": "it replaces the pilot's sticks.",
}
"""Why a topic is refused."""
FRESH_S: Final = 0.5
"""OffboardControlMode counts for so long; PX4 wants it twice a second [s]."""
PAIR_S: Final = 0.03
"""A setpoint that belongs to an OffboardControlMode comes within this time [s]."""
COMPONENT: Final = d.MAV_COMP_ID_ONBOARD_COMPUTER
_LOCAL_NED: Final = 1
_ACK: Final = LAYOUTS[d.MAVLINK_MSG_ID_COMMAND_ACK]
_INT32_NAN: Final = 2**31 - 1


class ProgramTopics:
    """One program.

    Args:
        system_id: MAVLink system id of its setpoints.
    """

    def __init__(self, system_id: int) -> None:
        self._system_id = system_id
        self._seq = 0
        self._setpoints: dict[str, MAVLink_message] = {}
        """By topic: the newest."""
        self._flown: str | None = None
        """The setpoint's topic that OffboardControlMode names."""
        self._mode_s = float("-inf")
        self._due_s: float | None = None
        """When the last setpoint is passed again, if none comes until then."""
        self._place: MAVLink_message | None = None
        """Where the vehicle was when Offboard was prepared without a setpoint."""
        self._sources: dict[int, tuple[int, int]] = {}
        """By command: system and component that its answer is for."""

    def take(self, topic: str, values: Values, now_s: float) -> bytes:
        """The frames of a message; empty: none yet.

        Args:
            topic: one whose way in `WAYS` is mode, setpoint or command.
            values: its fields.
            now_s: when it came [s, monotonic].
        """
        way = WAYS[topic]
        if way == "command":
            self._sources[values["command"]] = values["source_system"], values["source_component"]
            return self._frame(command_message(values), values["source_system"], values["source_component"])
        if way == "mode":
            flag = next((name for name in SETPOINT_OF_FLAG if values[name]), None)
            flown = None if flag is None else SETPOINT_OF_FLAG[flag]
            self._flown, self._mode_s, self._due_s = flown, now_s, now_s + PAIR_S
            return b""
        self._setpoints[topic] = setpoint_message(topic, values)
        if topic != self._flown or now_s - self._mode_s > FRESH_S:
            return b""
        self._due_s = None
        return self._frame(self._setpoints[topic])

    def due(self, now_s: float, newest_position: Callable[[], Values | None]) -> bytes:
        """The frame of the last setpoint, if an OffboardControlMode came without a new one.

        Args:
            now_s: the time [s, monotonic].
            newest_position: fields of the vehicle's newest VehicleLocalPosition; None: there is none.
        """
        if self._due_s is None or now_s < self._due_s:
            return b""
        self._due_s = None
        if self._flown is None:
            return b""
        setpoint = self._setpoints.get(self._flown)
        if setpoint is None:
            self._place = setpoint = self._place or _place(newest_position())
        return b"" if setpoint is None else self._frame(setpoint)

    def answer(self, frame: Frame) -> dict[str, Any] | None:
        """The fields of VehicleCommandAck for an answer to the program; None: ROS 2 has no message for it."""
        if frame.msg_id != d.MAVLINK_MSG_ID_COMMAND_ACK:
            return None
        fields = dict(zip(_ACK.fields, _ACK.unpacker.unpack(full_payload(frame)), strict=True))
        system, component = self._sources.get(fields["command"], (0, 0))
        return {
            "command": fields["command"],
            "result": fields["result"],
            "result_param1": fields["progress"],
            "result_param2": fields["result_param2"],
            "target_system": system,
            "target_component": component,
        }

    def _frame(
        self, message: MAVLink_message, system: int | None = None, component: int = COMPONENT
    ) -> bytes:
        self._seq = self._seq + 1 & 0xFF
        sender = self._system_id if system is None else system
        return encode_frame(message.get_msgId(), encode_payload(message), self._seq, sender, component & 0xFF)


def _place(position: Values | None) -> MAVLink_message | None:
    """A setpoint for the place where the vehicle is; None: it is not known."""
    if position is None or not position["xy_valid"] or not position["z_valid"]:
        return None
    nothing, here = (math.nan,) * 3, tuple(position[axis] for axis in "xyz")
    free = {"velocity": nothing, "acceleration": nothing, "yaw": math.nan, "yawspeed": math.nan}
    return setpoint_message(TRAJECTORY, {"position": here, **free})


def setpoint_message(topic: str, values: Values) -> MAVLink_message:
    """The MAVLink message of a setpoint, with the same NaN axes and the same quaternion."""
    if topic == TRAJECTORY:
        return _trajectory(values)
    attitude = topic == ATTITUDE
    thrust = values["thrust_body"]
    mask = 0b11 if attitude else 128
    mask |= 4 if attitude and not math.isfinite(values["yaw_sp_move_rate"]) else 0
    mask |= 32 if thrust[0] or thrust[1] else 0  # PX4 flies only the part along the body's axis
    rates = (0.0, 0.0, values["yaw_sp_move_rate"]) if attitude else _rates(values)
    q = values["q_d"] if attitude else (1.0, 0.0, 0.0, 0.0)
    return d.MAVLink_set_attitude_target_message(0, 0, 0, mask, list(q), *rates, -thrust[2], [0.0] * 3)


def _rates(values: Values) -> tuple[float, float, float]:
    return values["roll"], values["pitch"], values["yaw"]


def _trajectory(values: Values) -> MAVLink_message:
    fields = [*values["position"], *values["velocity"], *values["acceleration"]]
    mask = sum(1 << n for n, value in enumerate(fields) if math.isnan(value))
    mask |= 1024 if math.isnan(values["yaw"]) else 0
    mask |= 2048 if math.isnan(values["yawspeed"]) else 0
    x, y, z, vx, vy, vz, ax, ay, az, yaw, yaw_rate = (
        0.0 if math.isnan(each) else each for each in (*fields, values["yaw"], values["yawspeed"])
    )
    return d.MAVLink_set_position_target_local_ned_message(
        0, 0, 0, _LOCAL_NED, mask, x, y, z, vx, vy, vz, ax, ay, az, yaw, yaw_rate
    )


def command_message(values: Values) -> MAVLink_message:
    """COMMAND_LONG; COMMAND_INT where the fifth and sixth parameter are a place, which float32 would move by
    up to a metre."""
    target = values["target_system"], values["target_component"] & 0xFF
    p1, p2, p3, p4, p5, p6, p7 = (values[f"param{n}"] for n in range(1, 8))
    is_place = all(math.isnan(each) or abs(each) <= 180.0 for each in (p5, p6))
    if is_place and (_needs_double(p5) or _needs_double(p6)):
        x, y = _scaled(p5), _scaled(p6)
        return d.MAVLink_command_int_message(
            *target, d.MAV_FRAME_GLOBAL, values["command"], 0, 0, p1, p2, p3, p4, x, y, p7
        )
    return d.MAVLink_command_long_message(
        *target, values["command"], values["confirmation"], p1, p2, p3, p4, p5, p6, p7
    )


def _needs_double(value: float) -> bool:
    return not math.isnan(value) and struct.unpack("<f", struct.pack("<f", value))[0] != value


def _scaled(degrees: float) -> int:
    """1e-7 degrees; the largest number for NaN, as in PX4."""
    return _INT32_NAN if math.isnan(degrees) else round(degrees * 1e7)
