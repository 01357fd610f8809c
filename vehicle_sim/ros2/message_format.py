"""`message_format_request`: the hash of a topic's type, by which a program checks its px4_msgs version."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from vehicle_sim.ros2.messages import MESSAGES
from vehicle_sim.ros2.topics import INPUTS, OUTPUTS

REQUEST: Final = "/fmu/in/message_format_request"
RESPONSE: Final = "/fmu/out/message_format_response"
PROTOCOL_VERSION: Final = 1
UNSET_HASH, UNSET_NAME = 3, "6"
"""Content of PX4's answers in fields that it does not set, as recorded."""
VERSIONED_TOPIC: Final = "vehicle_status_v1"
"""The only bridged topic with a version in its name, which the topic inside PX4 does not have."""


def _hashes() -> dict[str, int]:
    """Hash of the type by the name of the topic inside PX4."""
    found = {topic.name.rsplit("/", 1)[1]: topic.message.hash for topic in (*OUTPUTS, *INPUTS)}
    found["vehicle_status"] = found.pop(VERSIONED_TOPIC)
    found["vehicle_angular_velocity"] = MESSAGES["VehicleAngularVelocity"].hash
    return found


HASHES: Final = _hashes()


def answer(request: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of the MessageFormatResponse, except the time.

    PX4 looks at the text after the last slash only. A name without a slash has no such text.
    """
    fields: dict[str, Any] = {"protocol_version": PROTOCOL_VERSION, "message_hash": UNSET_HASH}
    if request["protocol_version"] != PROTOCOL_VERSION:
        return fields | {"topic_name": UNSET_NAME}
    name = request["topic_name"]
    found = HASHES.get(name.rpartition("/")[2]) if "/" in name else None
    fields["topic_name"] = name
    return fields if found is None else fields | {"success": True, "message_hash": found}


class MessageFormats:
    """Answers requests of one vehicle; of several simultaneous requests only the last."""

    def __init__(self, publish: Callable[[str, str, Mapping[str, Any]], None]) -> None:
        self._publish = publish
        self._request: Mapping[str, Any] | None = None
        self.receivers = {REQUEST: self._take}

    def _take(self, request: Mapping[str, Any]) -> None:
        self._request = request

    def answer_newest(self) -> None:
        """Answers a request that has arrived."""
        request, self._request = self._request, None
        if request is not None:
            self._publish(RESPONSE, "MessageFormatResponse", answer(request))
