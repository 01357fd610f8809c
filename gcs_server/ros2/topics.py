"""The topics of a vehicle that the server uses, and their names on the wire."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from gcs_server.ros2.message_types import MESSAGES, MessageType

MAX_NAMESPACE: Final = 64
"""Longest namespace [characters]."""
_NAMESPACE = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")
_STATUS = re.compile(r"rt/(?:(.+)/)?fmu/out/vehicle_status(?:_v(\d{1,4}))?")
STATUS_VERSION: Final = "1"
"""Version of `vehicle_status` in PX4 v1.16."""


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


STATUS: Final = "/fmu/out/vehicle_status_v1"
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
_BY_NAME: Final = {each.name: each for each in SUBSCRIPTIONS}
COMMAND: Final = "/fmu/in/vehicle_command"


def wire_name(topic: str, namespace: str) -> str:
    """The topic's name in DDS: `rt/px4_1/fmu/out/…`; the namespace may be empty."""
    return f"rt/{namespace}{topic}" if namespace else f"rt{topic}"


def wire_type(message: MessageType) -> str:
    """The type's name in DDS."""
    return f"px4_msgs::msg::dds_::{message.name}_"


def is_namespace(text: str) -> bool:
    """Whether ROS 2 allows this text as a namespace, written without its first slash."""
    return len(text) <= MAX_NAMESPACE and _NAMESPACE.fullmatch(text) is not None


def parse_status_topic(topic: str) -> tuple[str, str] | None:
    """Namespace and version of a `vehicle_status` topic, given its name in DDS; None for other topics.

    The version of a topic without a suffix is empty. Names that ROS 2 does not allow are ignored.
    """
    match = _STATUS.fullmatch(topic)
    if match is None:
        return None
    namespace, version = match[1] or "", match[2] or ""
    return (namespace, version) if not namespace or is_namespace(namespace) else None


def find_subscription(topic: str) -> tuple[str, Subscription] | None:
    """Namespace and subscription of a topic that the server reads, given its name in DDS; None for other
    topics."""
    start, output, name = topic.partition("/fmu/out/")
    subscription = _BY_NAME.get(output + name)
    namespace = start.removeprefix("rt").removeprefix("/")
    if subscription is None or start != ("rt" if not namespace else f"rt/{namespace}"):
        return None
    return (namespace, subscription) if not namespace or is_namespace(namespace) else None
