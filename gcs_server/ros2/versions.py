"""Finds the topics that a vehicle has only in message versions that the server does not know.

PX4 appends the version of a message to the topic's name (`vehicle_status_v1`; version 0 has no suffix). A
topic of another version never connects in DDS, so without this check nothing would explain why its messages
are missing. No I/O.
"""

from __future__ import annotations

import re
from typing import Final

from gcs_server.ros2.external_mode import (
    CHECK_REPLY,
    CHECK_REQUEST,
    COMPLETED,
    CONTROLLERS,
    OVERRIDES,
    REGISTER,
    REGISTER_REPLY,
    UNREGISTER,
)
from gcs_server.ros2.mode_executor import COMMAND as EXECUTOR_COMMAND
from gcs_server.ros2.mode_executor import MODE_COMPLETED
from gcs_server.ros2.topics import COMMAND, COMMAND_ACK, STATUS, TIMESYNC, is_namespace

_MODES: Final = "flight modes of missions"
USE_OF_TOPIC: Final = {
    STATUS: "all data and commands of this vehicle",
    TIMESYNC: "time since boot",
    COMMAND_ACK: "acknowledgements of commands",
    COMMAND: "commands",
    "/fmu/out/vehicle_land_detected": "landed state",
    "/fmu/out/failsafe_flags": "PX4's reasons for refused commands",
    "/fmu/out/home_position": "home position",
    "/fmu/out/position_setpoint_triplet": "the vehicle's target",
    "/fmu/out/vehicle_odometry": "angular velocity",
    "/fmu/out/vehicle_attitude": "attitude",
    "/fmu/out/vehicle_local_position": "local position",
    "/fmu/out/vehicle_global_position": "global position",
    "/fmu/out/vehicle_gps_position": "GPS data",
    "/fmu/out/battery_status": "battery state",
    REGISTER: _MODES,
    UNREGISTER: _MODES,
    REGISTER_REPLY: _MODES,
    CHECK_REQUEST: _MODES,
    CHECK_REPLY: _MODES,
    COMPLETED: "the end of a flight mode of a mission",
    CONTROLLERS: _MODES,
    OVERRIDES: "deferred failsafes",
    EXECUTOR_COMMAND: "take-off and landing in a flight mode of a mission",
    MODE_COMPLETED: "take-off in a flight mode of a mission",
    "/fmu/in/offboard_control_mode": "Offboard mode",
    "/fmu/in/trajectory_setpoint": "position, velocity and acceleration setpoints",
    "/fmu/in/vehicle_attitude_setpoint": "attitude setpoints",
    "/fmu/in/vehicle_rates_setpoint": "angular velocity setpoints",
    "/fmu/in/vehicle_thrust_setpoint": "thrust and torque setpoints",
    "/fmu/in/vehicle_torque_setpoint": "thrust and torque setpoints",
    "/fmu/in/actuator_motors": "motor setpoints",
    "/fmu/in/actuator_servos": "servo setpoints",
}
"""The data or function that is not available without a topic, for every topic that the server uses."""
MAX_TOPICS: Final = 512
"""Maximum number of topics whose versions are stored."""
MAX_NAMED: Final = 3
"""Maximum number of topics that a vehicle's problem text names."""
REMEDY: Final = (
    "Use PX4 v1.16, whose message versions this server knows, or connect the vehicle over MAVLink as well."
)
_TOPIC: Final = re.compile(r"rt(?:/(?P<namespace>.+?))?(?P<name>/fmu/(?P<direction>in|out)/[a-z0-9_]+)")


def _split_version(name: str) -> tuple[str, int]:
    """A topic's name without its version, and the version."""
    base, separator, version = name.rpartition("_v")
    return (base, int(version)) if separator and re.fullmatch(r"\d{1,4}", version) else (name, 0)


_KNOWN_NAMES: Final = {_split_version(name)[0]: name for name in USE_OF_TOPIC}
"""Name with the known version, by the name without a version."""


class TopicVersions:
    """The versions of the topics that the vehicles of a domain have."""

    def __init__(self) -> None:
        self._seen: dict[str, dict[str, set[int]]] = {}
        """Versions by namespace and by name without version."""
        self._topics = 0

    def add_topic(self, topic: str, *, publishes: bool) -> None:
        """Stores the version of a topic that another participant writes or reads; `topic` is its name in DDS.
        Topics that the server does not use are ignored."""
        match = _TOPIC.fullmatch(topic)
        if match is None or publishes != (match["direction"] == "out"):
            return
        namespace, (base, version) = match["namespace"] or "", _split_version(match["name"])
        if base not in _KNOWN_NAMES or (namespace and not is_namespace(namespace)):
            return
        seen = self._seen.get(namespace, {}).get(base, set[int]())
        if version not in seen and self._topics < MAX_TOPICS:
            self._topics += 1
            self._seen.setdefault(namespace, {})[base] = seen | {version}

    def problems(self, only: str | None = None) -> list[str]:
        """For each vehicle with topics only in unknown versions, a text about them.

        Args:
            only: the only namespace to report; None: all.
        """
        texts_of = {namespace: list(self.unusable(namespace).values()) for namespace in self._seen}
        return [
            _vehicle_text(texts)
            for namespace, texts in texts_of.items()
            if texts and only in (None, namespace)
        ]

    def unusable(self, namespace: str) -> dict[str, str]:
        """The topics that a vehicle has only in unknown versions: a text by each topic's known name."""
        return {
            _KNOWN_NAMES[base]: _topic_text(namespace, base, max(versions), known)
            for base, versions in self._seen.get(namespace, {}).items()
            if (known := _split_version(_KNOWN_NAMES[base])[1]) not in versions
        }


def _topic_text(namespace: str, base: str, version: int, known: int) -> str:
    prefix = f"/{namespace}" if namespace else ""
    name = f"{base}_v{version}" if version else base
    return (
        f"{prefix}{name} has version {version}, but this server knows version {known}. "
        f"Not available: {USE_OF_TOPIC[_KNOWN_NAMES[base]]}"
    )


def _vehicle_text(texts: list[str]) -> str:
    more = len(texts) - MAX_NAMED
    named = ". ".join(texts[:MAX_NAMED])
    return f"{named}.{f' Further topics with unknown versions: {more}.' if more > 0 else ''} {REMEDY}"
