"""Priority and lifetime of each message on a link. No I/O.

Frames wait on a slow link. The order is: stop motors; mode changes and disarm; other commands and replies;
setpoints; everything else. Every message expires: a setpoint is replaced by the next one, and a command must
not reach the vehicle after the server has stopped waiting for the acknowledgement.
"""

from __future__ import annotations

import struct
from collections.abc import Hashable
from dataclasses import dataclass
from enum import IntEnum

from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import Frame
from gcs_server.mavlink.tables import TARGET_SYSTEM_OFFSET

SETPOINT_LIFETIME_S = 0.1
COMMAND_LIFETIME_S = 0.5
"""Not longer than the period after which an unanswered command is repeated [s]."""
STOP_LIFETIME_S = 1.0
"""Longer than the period at which stop motors is repeated, so that a copy always waits in the queue [s]."""
HEARTBEAT_LIFETIME_S = 1.0
OTHER_LIFETIME_S = 3.0


class Priority(IntEnum):
    """The classes of a link's send queue, most urgent first."""

    STOP = 0
    """Stop motors and flight termination; sent before all other messages."""
    MODE = 1
    """Mode changes, hold, land, return, disarm."""
    COMMAND = 2
    """Other commands, protocol replies, heartbeats."""
    SETPOINT = 3
    """Offboard setpoints, gimbal and stick inputs; a newer one replaces a waiting one."""
    OTHER = 4
    """Parameters, files, missions, and messages of other stations."""


@dataclass(frozen=True, slots=True)
class Urgency:
    """Priority and lifetime of a message in the send queue, and which waiting messages it replaces."""

    priority: Priority
    lifetime_s: float
    """Maximum time between creation and sending [s]."""
    key: Hashable = None
    """A message replaces a waiting message with the same key; None: it replaces none."""
    flight: Hashable = None
    """The vehicle whose flight the message changes; None: it changes no flight. A message with
    `flight` replaces waiting messages with the same `flight` that are not more urgent, except stop motors."""


_LONG, _INT = d.MAVLINK_MSG_ID_COMMAND_LONG, d.MAVLINK_MSG_ID_COMMAND_INT
_COMMAND_BYTES = 33
_CONFIRMATION_OFFSET = 32
_command = struct.Struct("<2f20xHBB")
"""Fields of both COMMAND_LONG and COMMAND_INT: parameters 1 and 2, command, target system and component."""
FORCE = 21196.0
"""Parameter 2 of MAV_CMD_COMPONENT_ARM_DISARM that disarms also in flight."""

SETPOINTS = frozenset(
    {
        d.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
        d.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT,
        d.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
    }
)
INPUTS = frozenset(
    {
        d.MAVLINK_MSG_ID_MANUAL_CONTROL,
        d.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE,
        d.MAVLINK_MSG_ID_SET_ACTUATOR_CONTROL_TARGET,
    }
)
"""Stick inputs, with the same lifetime as setpoints."""
GIMBAL_INPUTS = frozenset(
    {
        d.MAVLINK_MSG_ID_GIMBAL_MANAGER_SET_ATTITUDE,
        d.MAVLINK_MSG_ID_GIMBAL_MANAGER_SET_PITCHYAW,
        d.MAVLINK_MSG_ID_GIMBAL_MANAGER_SET_MANUAL_CONTROL,
    }
)
REPLIES = frozenset({d.MAVLINK_MSG_ID_COMMAND_ACK, d.MAVLINK_MSG_ID_TIMESYNC, d.MAVLINK_MSG_ID_PING})
MODE_COMMANDS = frozenset(
    {
        d.MAV_CMD_DO_SET_MODE,
        d.MAV_CMD_NAV_RETURN_TO_LAUNCH,
        d.MAV_CMD_NAV_LAND,
        d.MAV_CMD_DO_PAUSE_CONTINUE,
        d.MAV_CMD_OVERRIDE_GOTO,
    }
)
FLIGHT_COMMANDS = frozenset(
    {
        d.MAV_CMD_COMPONENT_ARM_DISARM,
        d.MAV_CMD_NAV_TAKEOFF,
        d.MAV_CMD_DO_REPOSITION,
        d.MAV_CMD_DO_ORBIT,
        d.MAV_CMD_MISSION_START,
    }
)
"""Commands that also change the flight, but are less urgent than a mode change."""


HEARTBEAT_URGENCY = Urgency(Priority.COMMAND, HEARTBEAT_LIFETIME_S, "heartbeat")


def classify(msg_id: int, payload: bytes) -> Urgency:
    """Urgency of a message from this server; the payload may lack trailing zeros."""
    if msg_id == d.MAVLINK_MSG_ID_HEARTBEAT:
        return HEARTBEAT_URGENCY
    if msg_id in (_LONG, _INT):
        return _classify_command(msg_id, payload)
    system = _target_system(msg_id, payload)
    if msg_id in SETPOINTS:
        return Urgency(Priority.SETPOINT, SETPOINT_LIFETIME_S, ("setpoint", system))
    if msg_id in INPUTS:
        return Urgency(Priority.SETPOINT, SETPOINT_LIFETIME_S, (msg_id, system))
    if msg_id in GIMBAL_INPUTS:
        offset = TARGET_SYSTEM_OFFSET[msg_id]
        return Urgency(Priority.SETPOINT, COMMAND_LIFETIME_S, ("gimbal", payload[offset : offset + 3]))
    if msg_id == d.MAVLINK_MSG_ID_SET_MODE:
        return Urgency(Priority.MODE, COMMAND_LIFETIME_S, (msg_id, system), ("flight", system))
    if msg_id in REPLIES:
        return Urgency(Priority.COMMAND, COMMAND_LIFETIME_S)
    return Urgency(Priority.OTHER, OTHER_LIFETIME_S, (msg_id, payload))


def classify_forwarded(frame: Frame) -> Urgency:
    """Urgency of a forwarded frame: frames keep their order, except for stop motors and setpoints. A newer
    command does not replace older ones, because only the station that sent them may withdraw them.
    """
    urgency = classify(frame.msg_id, frame.payload)
    sender = (frame.system_id, frame.component_id)
    if urgency.priority in (Priority.STOP, Priority.SETPOINT) or urgency.key == "heartbeat":
        return Urgency(urgency.priority, urgency.lifetime_s, (sender, urgency.key))
    if urgency.priority is Priority.OTHER:
        return Urgency(Priority.OTHER, OTHER_LIFETIME_S)
    return Urgency(Priority.COMMAND, urgency.lifetime_s)


def _classify_command(msg_id: int, payload: bytes) -> Urgency:
    full_payload = payload.ljust(_COMMAND_BYTES, b"\0")
    param_1, param_2, command, system, component = _command.unpack_from(full_payload)
    flight = ("flight", system)
    if _stops_motors(command, param_1, param_2):
        return Urgency(Priority.STOP, STOP_LIFETIME_S, (command, system, component), flight)
    disarms = command == d.MAV_CMD_COMPONENT_ARM_DISARM and abs(param_1) < 0.5
    if disarms or command in MODE_COMMANDS:
        return Urgency(Priority.MODE, COMMAND_LIFETIME_S, (command, system, component), flight)
    if command in FLIGHT_COMMANDS:
        return Urgency(Priority.COMMAND, COMMAND_LIFETIME_S, (command, system, component), flight)
    without_confirmation = full_payload[:_CONFIRMATION_OFFSET] if msg_id == _LONG else full_payload
    return Urgency(Priority.COMMAND, COMMAND_LIFETIME_S, (msg_id, without_confirmation))


def _stops_motors(command: int, param_1: float, param_2: float) -> bool:
    """Whether a command stops the motors. Handles NaN, because another station may send it."""
    if command == d.MAV_CMD_COMPONENT_ARM_DISARM:
        return abs(param_1) < 0.5 and abs(param_2 - FORCE) < 0.5
    return command == d.MAV_CMD_DO_FLIGHTTERMINATION and param_1 > 0.5


def _target_system(msg_id: int, payload: bytes) -> int:
    offset = TARGET_SYSTEM_OFFSET.get(msg_id)
    return payload[offset] if offset is not None and offset < len(payload) else 0
