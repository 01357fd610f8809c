"""The topics of a vehicle that the server uses, and their names on the wire.

Inside the server a topic has the name without a version (`/fmu/out/vehicle_status`); only DDS sees the
version (`formats.py`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final, NamedTuple

from gcs_server.ros2.message_types import MESSAGES, MessageType

MAX_NAMESPACE: Final = 64
"""Longest namespace [characters]."""
_NAMESPACE = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")
_TOPIC: Final = re.compile(
    r"rt(?:/(?P<namespace>.+?))?(?P<name>/fmu/(?P<direction>in|out)/[a-z0-9_]+?)(?:_v\d{1,4})?"
)


@dataclass(frozen=True, slots=True)
class Subscription:
    """A topic that the server reads.

    `every_s` is the minimum time between two readings. Between readings DDS keeps the newest `depth` samples.
    """

    name: str
    type: str
    every_s: float
    depth: int = 1

    @property
    def message(self) -> MessageType:
        """The type's layout."""
        return MESSAGES[self.type]


STATUS: Final = "/fmu/out/vehicle_status"
TIMESYNC: Final = "/fmu/out/timesync_status"
COMMAND_ACK: Final = "/fmu/out/vehicle_command_ack"
SUBSCRIPTIONS: Final = (
    Subscription(STATUS, "VehicleStatus", 0.0, 8),
    Subscription(TIMESYNC, "TimesyncStatus", 0.0),
    Subscription("/fmu/out/vehicle_land_detected", "VehicleLandDetected", 0.0, 4),
    Subscription("/fmu/out/failsafe_flags", "FailsafeFlags", 0.0),
    Subscription(COMMAND_ACK, "VehicleCommandAck", 0.0, 16),
    Subscription("/fmu/out/home_position", "HomePosition", 0.0),
    Subscription("/fmu/out/position_setpoint_triplet", "PositionSetpointTriplet", 0.0),
    Subscription("/fmu/out/vehicle_odometry", "VehicleOdometry", 0.02),
    Subscription("/fmu/out/vehicle_attitude", "VehicleAttitude", 0.02),
    Subscription("/fmu/out/vehicle_local_position", "VehicleLocalPosition", 0.04),
    Subscription("/fmu/out/vehicle_global_position", "VehicleGlobalPosition", 0.04),
    Subscription("/fmu/out/vehicle_gps_position", "SensorGps", 0.2),
    Subscription("/fmu/out/battery_status", "BatteryStatus", 0.5),
)
"""In the order of reading: a message comes after the messages that its conversion needs."""
COMMAND: Final = "/fmu/in/vehicle_command"


def wire_name(topic: str, namespace: str) -> str:
    """The topic's name in DDS: `rt/px4_1/fmu/out/…`; the namespace may be empty."""
    return f"rt/{namespace}{topic}" if namespace else f"rt{topic}"


def wire_type(message: MessageType) -> str:
    """The type's name in DDS."""
    return f"px4_msgs::msg::dds_::{message.name}_"


def ros_message(dds_type: str) -> str:
    """The message's name in px4_msgs of a type in DDS; other types keep their name."""
    return dds_type.removeprefix("px4_msgs::msg::dds_::").removesuffix("_")


def is_namespace(text: str) -> bool:
    """Whether ROS 2 allows this text as a namespace, written without its first slash."""
    return len(text) <= MAX_NAMESPACE and _NAMESPACE.fullmatch(text) is not None


class VehicleTopic(NamedTuple):
    """A topic of a vehicle, by its name in DDS."""

    namespace: str
    base: str
    """The name without namespace and version: PX4 appends the version of a message to the name of its topic
    (`vehicle_status_v1`; version 0 has no suffix)."""
    name: str
    """The name without namespace."""


def parse_topic(topic: str) -> VehicleTopic | None:
    """The parts of a topic's name in DDS; None for topics of other programs and names that ROS 2 does not
    allow."""
    match = _TOPIC.fullmatch(topic)
    if match is None:
        return None
    namespace = match["namespace"] or ""
    if namespace and not is_namespace(namespace):
        return None
    return VehicleTopic(namespace, match["name"], topic[match.start("name") :])


def status_namespace(topic: str) -> str | None:
    """The namespace of a `vehicle_status` topic of any version, given its name in DDS; None for other
    topics."""
    parsed = parse_topic(topic)
    return parsed.namespace if parsed is not None and parsed.base == STATUS else None
