"""How a PX4 of a version answers which layouts its topics have."""

from __future__ import annotations

import re

from gcs_server.ros2.formats import USED, AnnouncedTopic, TopicFormat, VehicleFormats
from gcs_server.ros2.message_types import MESSAGES, VERSIONS

VERSIONED = {
    "1.15": {},
    "1.16": {"/fmu/out/vehicle_status": 1},
    "1.17": dict.fromkeys(
        (
            "/fmu/out/vehicle_status", "/fmu/out/vehicle_local_position", "/fmu/out/battery_status",
            "/fmu/out/home_position", "/fmu/out/arming_check_request", "/fmu/in/arming_check_reply",
            "/fmu/in/vehicle_attitude_setpoint",
        ),
        1,
    ),
}  # fmt: skip
"""Topics with a version in their names, of those that the server uses."""


def px4_name(topic: str, version: str) -> str:
    """The name that a version of PX4 gives a topic."""
    number = VERSIONED[version].get(topic, 0)
    return f"{topic}_v{number}" if number else topic


def px4_topics(version: str) -> list[AnnouncedTopic]:
    """The topics that the server uses, as a version of PX4 announces them."""
    return [AnnouncedTopic(topic, px4_name(topic, version), use.type) for topic, use in USED.items()]


def answer(request: bytes, hashes: dict[str, int]) -> bytes:
    """The answer to a request; `hashes` has the hash of each topic by its name inside PX4."""
    asked = MESSAGES["MessageFormatRequest"].decode(request)
    name = bytes(asked["topic_name"]).split(b"\0")[0].decode().rpartition("/")[2]
    fields = {
        "protocol_version": 1, "topic_name": asked["topic_name"], "success": name in hashes,
        "message_hash": hashes.get(name, 3),
    }  # fmt: skip
    return MESSAGES["MessageFormatResponse"].encode(fields)


def px4_hashes(version: str) -> dict[str, int]:
    """The hash of each topic in a version, by the topic's name inside PX4."""
    types = VERSIONS[version]
    hashes = {re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower(): message.hash for name, message in types.items()}
    if version == "1.15":
        # with angles beside the quaternion; the server does not send this layout
        hashes["vehicle_attitude_setpoint"] = 0x8FE976CB
    return hashes | {
        topic.rpartition("/")[2]: types[use.type].hash for topic, use in USED.items() if use.type in types
    }


def ask_everything(formats: VehicleFormats, hashes: dict[str, int], now_s: float = 0.0) -> int:
    """Answers the requests of the next 20 s; returns their number."""
    count = 0
    for tick in range(1000):
        request = formats.request(now_s + tick * 0.02, now_s + tick * 0.02)
        if request is not None:
            count += 1
            response = MESSAGES["MessageFormatResponse"].decode(answer(request, hashes))
            if response["success"]:
                formats.on_response(response)
    return count


def formats_of_version(version: str, namespace: str = "px4_1") -> VehicleFormats:
    """The formats of a vehicle that has answered everything."""
    formats = VehicleFormats(namespace)
    formats.announce(px4_topics(version))
    ask_everything(formats, px4_hashes(version))
    return formats


def address_formats(version: str) -> tuple[TopicFormat, ...]:
    """The formats of a vehicle's address."""
    return tuple(formats_of_version(version).usable.values())
