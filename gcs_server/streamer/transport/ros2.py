"""Packs setpoints into PX4's ROS 2 messages: OffboardControlMode and the setpoint's own topics.

PX4 stays in Offboard as long as it receives OffboardControlMode, whose flags only choose the controllers. PX4
follows setpoint topics in any mode, so the server sends setpoints only while the vehicle reports Offboard.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final, Protocol

from gcs_server.ros2.external_mode import CONTROLLERS, SENT_TYPES, Message, controllers_message
from gcs_server.ros2.message_types import HEADER, MESSAGES
from gcs_server.ros2.topics import COMMAND
from gcs_server.streamer.transport.mavlink import (
    MAV_CMD_DO_SET_MODE,
    MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
    PX4_AUTO_SUB_MODES,
    PX4_MAIN_MODE_AUTO,
)
from gcs_server.streamer.values.stream_request import OFFBOARD, ModeRequest, Outgoing
from gcs_server.vehicle.px4.modes import BY_NAME
from missions.frames import Vector3
from missions.setpoints import (
    UNCONTROLLED,
    Acceleration,
    Actuators,
    Attitude,
    DirectSetpoint,
    Partial3,
    Position,
    Rates,
    ThrustTorque,
    Trajectory,
    Velocity,
)

NAN: Final = math.nan
MOTOR_COUNT, SERVO_COUNT = 12, 8
"""Numbers of values in ActuatorMotors and ActuatorServos."""
CONTROL_MODE: Final = "/fmu/in/offboard_control_mode"
SETPOINT_TOPICS: Final[Mapping[str, str]] = {
    "TrajectorySetpoint": "/fmu/in/trajectory_setpoint",
    "VehicleAttitudeSetpoint": "/fmu/in/vehicle_attitude_setpoint",
    "VehicleRatesSetpoint": "/fmu/in/vehicle_rates_setpoint",
    "VehicleThrustSetpoint": "/fmu/in/vehicle_thrust_setpoint",
    "VehicleTorqueSetpoint": "/fmu/in/vehicle_torque_setpoint",
    "ActuatorMotors": "/fmu/in/actuator_motors",
    "ActuatorServos": "/fmu/in/actuator_servos",
}
"""Setpoint topic by message type."""
TOPIC_TYPES: Final[Mapping[str, str]] = {
    CONTROL_MODE: "OffboardControlMode",
    CONTROLLERS: SENT_TYPES[CONTROLLERS],
    COMMAND: "VehicleCommand",
    **{topic: kind for kind, topic in SETPOINT_TOPICS.items()},
}
"""Type of every topic that a stream sends."""
_time = struct.Struct("<Q")
Encoded = tuple[str, tuple[tuple[str, dict[str, Any]], ...]]
"""A flag of OffboardControlMode, and message types with their fields."""


class TopicSender(Protocol):
    """Sends to the ROS 2 topics of one vehicle."""

    def send(self, messages: Sequence[Message], required: Iterable[str] = ()) -> None:
        """Sends all messages or none: OffboardControlMode alone would keep Offboard active without setpoints.

        Args:
            messages: the messages, in the order in which they are sent.
            required: other topics to which the vehicle must subscribe.

        Raises:
            OSError: the vehicle does not subscribe to one of the topics, or a message cannot be sent now.
        """
        ...


def _nan_for_none(vector: Partial3) -> tuple[float, float, float]:
    x, y, z = (NAN if axis is None else axis for axis in vector)
    return x, y, z


def _trajectory_setpoint(
    s: Position | Velocity | Acceleration | Trajectory,
    position: Partial3 = UNCONTROLLED,
    velocity: Partial3 = UNCONTROLLED,
    acceleration: Partial3 = UNCONTROLLED,
) -> Encoded:
    controlled = {"position": position, "velocity": velocity, "acceleration": acceleration}
    flag = next((name for name, vector in controlled.items() if vector != UNCONTROLLED), "position")
    yaw, yaw_rate = s.yaw_ned_rad, s.yaw_rate_ned_rad_s
    fields: dict[str, Any] = {name: _nan_for_none(vector) for name, vector in controlled.items()}
    fields |= {
        "jerk": (NAN, NAN, NAN),
        "yaw": NAN if yaw is None else math.remainder(yaw, math.tau),
        "yawspeed": NAN if yaw_rate is None else yaw_rate,
    }
    return flag, (("TrajectorySetpoint", fields),)


def _encode_trajectory(s: Trajectory) -> Encoded:
    return _trajectory_setpoint(s, s.position_ned_m, s.velocity_ned_m_s, s.acceleration_ned_m_s2)


def _thrust_body(thrust: float) -> Vector3:
    """A collective thrust of 0 to 1 as `thrust_body` [FRD, normalised]."""
    return (0.0, 0.0, -thrust)


def _encode_attitude(s: Attitude) -> Encoded:
    rate = s.yaw_rate_ned_rad_s or 0.0
    fields = {"q_d": s.q_ned_frd, "thrust_body": _thrust_body(s.thrust), "yaw_sp_move_rate": rate}
    return "attitude", (("VehicleAttitudeSetpoint", fields),)


def _encode_rates(s: Rates) -> Encoded:
    roll, pitch, yaw = s.rates_frd_rad_s
    fields = {"roll": roll, "pitch": pitch, "yaw": yaw, "thrust_body": _thrust_body(s.thrust)}
    return "body_rate", (("VehicleRatesSetpoint", fields),)


def _encode_thrust_torque(s: ThrustTorque) -> Encoded:
    thrust, torque = {"xyz": s.thrust_frd}, {"xyz": s.torque_frd}
    return "thrust_and_torque", (("VehicleThrustSetpoint", thrust), ("VehicleTorqueSetpoint", torque))


def _encode_actuators(s: Actuators) -> Encoded:
    arrays = (("ActuatorMotors", s.motors, MOTOR_COUNT), ("ActuatorServos", s.servos, SERVO_COUNT))
    return "direct_actuator", tuple(
        (kind, {"control": tuple(NAN if v is None else v for v in values) + (NAN,) * (size - len(values))})
        for kind, values, size in arrays
        if values
    )


_ENCODERS: dict[type, Callable[[Any], Encoded]] = {
    Position: lambda s: _trajectory_setpoint(s, position=s.position_ned_m),
    Velocity: lambda s: _trajectory_setpoint(s, velocity=s.velocity_ned_m_s),
    Acceleration: lambda s: _trajectory_setpoint(s, acceleration=s.acceleration_ned_m_s2),
    Trajectory: _encode_trajectory,
    Attitude: _encode_attitude,
    Rates: _encode_rates,
    ThrustTorque: _encode_thrust_torque,
    Actuators: _encode_actuators,
}
ROS2_KINDS = frozenset(kind.type for kind in _ENCODERS)  # type: ignore[attr-defined]
"""Setpoint types for which PX4 has a ROS 2 message."""
_MESSAGE_TYPES: Final[Mapping[str, tuple[str, ...]]] = {
    Attitude.type: ("VehicleAttitudeSetpoint",),
    Rates.type: ("VehicleRatesSetpoint",),
    ThrustTorque.type: ("VehicleThrustSetpoint", "VehicleTorqueSetpoint"),
    Actuators.type: ("ActuatorMotors", "ActuatorServos"),
}
"""Message types of a setpoint type; all other setpoint types use TrajectorySetpoint, some after a
conversion."""


def encode(setpoint: DirectSetpoint) -> tuple[Message, tuple[Message, ...]]:
    """OffboardControlMode, and the setpoint's messages; their timestamps are zero.

    Raises:
        ValueError: PX4 has no ROS 2 message for this kind.
    """
    encoder = _ENCODERS.get(type(setpoint))
    if encoder is None:
        raise ValueError(f"no ROS 2 message of PX4 carries {setpoint.type}")
    flag, messages = encoder(setpoint)
    mode = CONTROL_MODE, MESSAGES["OffboardControlMode"].encode({flag: True})
    return mode, tuple((SETPOINT_TOPICS[kind], MESSAGES[kind].encode(fields)) for kind, fields in messages)


def level_of(setpoint: DirectSetpoint) -> str:
    """The flag of OffboardControlMode for a setpoint: the level of the control cascade at which the setpoint
    enters."""
    return _ENCODERS[type(setpoint)](setpoint)[0]


def topics_of(setpoint_type: str, *, in_offboard: bool) -> tuple[str, ...]:
    """The topics that a stream of this type uses.

    Args:
        setpoint_type: any type that ROS 2 carries.
        in_offboard: whether the stream flies in Offboard, or else in a mode that is registered with PX4.
    """
    mode_topic = CONTROL_MODE if in_offboard else CONTROLLERS
    messages = _MESSAGE_TYPES.get(setpoint_type, ("TrajectorySetpoint",))
    return (COMMAND, mode_topic, *(SETPOINT_TOPICS[each] for each in messages))


def with_time(data: bytes, unix_us: int) -> bytes:
    """The message with its timestamp set."""
    start = len(HEADER)
    return data[:start] + _time.pack(unix_us) + data[start + _time.size :]


class Ros2Transport:
    """Sends to one vehicle.

    Args:
        target: the vehicle's system id and its autopilot's component id.
        source: system and component id of this server, for mode requests.
        unix_us: the system clock [µs].
    """

    def __init__(
        self,
        target: tuple[int, int],
        source: tuple[int, int],
        unix_us: Callable[[], int],
    ) -> None:
        self._target, self._source, self._unix_us = target, source, unix_us
        self._mode_message: Message = (CONTROL_MODE, b"")
        self._loaded: DirectSetpoint | None = None
        self._setpoint: tuple[Message, ...] = ()

    def load(self, setpoint: DirectSetpoint) -> None:
        """See `SetpointLoader`."""
        self._mode_message, self._setpoint = encode(setpoint)
        self._loaded = setpoint

    def send(self, outgoing: Outgoing, sender: TopicSender) -> bool:
        """Sends all messages of a setpoint or mode request; returns False if one could not be sent."""
        now_us = self._unix_us()
        try:
            if isinstance(outgoing, ModeRequest):
                sender.send([(COMMAND, self._mode_command(outgoing, now_us))])
                return True
            mode_message = (
                self._mode_message if outgoing.mode == OFFBOARD else self._controllers_message(outgoing.mode)
            )
            messages = (mode_message, *(self._setpoint if outgoing.in_mode else ()))
            required = [topic for topic, _ in self._setpoint]
            sender.send([(topic, with_time(data, now_us)) for topic, data in messages], required)
        except OSError:
            return False
        return True

    def _controllers_message(self, mode: str) -> Message:
        """The controllers for the loaded setpoint in a mode that is registered with PX4."""
        level = "position" if self._loaded is None else level_of(self._loaded)
        return controllers_message(BY_NAME[mode].nav_state, level)

    def _mode_command(self, request: ModeRequest, now_us: int) -> bytes:
        return MESSAGES["VehicleCommand"].encode(
            {
                "timestamp": now_us,
                "command": MAV_CMD_DO_SET_MODE,
                "param1": MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
                "param2": PX4_MAIN_MODE_AUTO,
                "param3": PX4_AUTO_SUB_MODES[request.mode],
                "target_system": self._target[0],
                "target_component": self._target[1],
                "source_system": self._source[0],
                "source_component": self._source[1],
                "confirmation": min(request.attempt, 255),
                "from_external": True,
            }
        )
