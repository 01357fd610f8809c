"""`message_format_request`: a program asks for the hash of a topic's type, to check its px4_msgs version."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from vehicle_sim.ros2.messages import MESSAGES
from vehicle_sim.ros2.topics import INPUTS, OUTPUTS

REQUEST: Final = "/fmu/in/message_format_request"
RESPONSE: Final = "/fmu/out/message_format_response"
PROTOCOL_VERSION: Final = 1
UNSET_HASH, UNSET_NAME = 3, "6"
"""Recorded values of the fields that PX4 leaves unset in a response."""
VERSIONED_TOPIC: Final = "vehicle_status_v1"
"""The only bridged topic with a version in its name; inside PX4 the name has no version."""


def _hashes() -> dict[str, int]:
    """Hash of each topic's message type, by the name of the topic inside PX4."""
    hashes = {topic.name.rsplit("/", 1)[1]: topic.message.hash for topic in (*OUTPUTS, *INPUTS)}
    hashes["vehicle_status"] = hashes.pop(VERSIONED_TOPIC)
    hashes["vehicle_angular_velocity"] = MESSAGES["VehicleAngularVelocity"].hash
    return hashes


HASHES: Final = _hashes()


def response(request: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of the MessageFormatResponse, except the time.

    PX4 looks up the part of the name after the last slash; a name without a slash is unknown to PX4.
    """
    fields: dict[str, Any] = {"protocol_version": PROTOCOL_VERSION, "message_hash": UNSET_HASH}
    if request["protocol_version"] != PROTOCOL_VERSION:
        return fields | {"topic_name": UNSET_NAME}
    name = request["topic_name"]
    message_hash = HASHES.get(name.rpartition("/")[2]) if "/" in name else None
    fields["topic_name"] = name
    return fields if message_hash is None else fields | {"success": True, "message_hash": message_hash}


class MessageFormats:
    """Replies to the requests to one vehicle; of several requests in one step only the last gets a reply."""

    def __init__(self, publish: Callable[[str, str, Mapping[str, Any]], None]) -> None:
        self._publish = publish
        self._request: Mapping[str, Any] | None = None
        self.receivers = {REQUEST: self._store_request}

    def _store_request(self, request: Mapping[str, Any]) -> None:
        self._request = request

    def reply_to_newest(self) -> None:
        """Replies to the newest request since the last call."""
        request, self._request = self._request, None
        if request is not None:
            self._publish(RESPONSE, "MessageFormatResponse", response(request))
