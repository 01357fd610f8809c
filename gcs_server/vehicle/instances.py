"""Distinguishes the instances of a message: batteries 0 and 1, main and auxiliary outputs, several gimbals.

A message is stored by (component, message, instance), so that the messages of two batteries or two components
never replace each other. A key has the message's id in bits 0 to 23, the instance in bits 24 to 31, and the
component from bit 32 on (0: the autopilot). For instance 0 of the autopilot, the key is the id itself.
"""

from __future__ import annotations

from collections.abc import Iterable

from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import Frame, payload_byte
from gcs_server.vehicle import gimbal_decoder

INSTANCE_OFFSET = {
    d.MAVLINK_MSG_ID_BATTERY_STATUS: 32,
    d.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: 20,
    d.MAVLINK_MSG_ID_DISTANCE_SENSOR: 11,
    d.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: 48,
    d.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS: 8,
    d.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION: 32,
}
"""Offset of the instance's byte in the payload; a test compares the offsets with the dialect."""
ANY_COMPONENT = frozenset(gimbal_decoder.IDS)
"""Messages that are stored from every component; all other messages are stored from the autopilot only."""
MAX_INSTANCES = 8
"""Maximum number of instances of one message from the autopilot, and from all other components together; PX4
has at most four batteries. Further instances are ignored, so that other components cannot displace the
autopilot's instances."""
NO_DATA_AFTER_S = 10.0
"""Time without a message after which an instance is ignored, while another instance is received [s]."""
ID_MASK = 0xFFFFFF


def message_of(key: int) -> int:
    """The message's id."""
    return key & ID_MASK


def instance_of(key: int) -> int:
    """Instance of a message; 0 if it has no instances."""
    return key >> 24 & 0xFF


def component_of(key: int) -> int:
    """Component id of the sender; 0: the autopilot."""
    return key >> 32


class Instances:
    """The message instances of one vehicle.

    Args:
        autopilot: the autopilot's component id.
    """

    def __init__(self, autopilot: int) -> None:
        self._autopilot = autopilot
        self._keys: dict[int, tuple[int, ...]] = {}

    def key_of(self, frame: Frame) -> int | None:
        """Key of a frame; None if the frame is not stored."""
        msg_id, instance_offset = frame.msg_id, INSTANCE_OFFSET.get(frame.msg_id)
        from_autopilot = frame.component_id == self._autopilot
        if from_autopilot and instance_offset is None:
            return msg_id
        if not from_autopilot and msg_id not in ANY_COMPONENT:
            return None
        component = 0 if from_autopilot else frame.component_id
        instance = 0 if instance_offset is None else payload_byte(frame, instance_offset)
        key = msg_id | instance << 24 | component << 32
        keys = self._keys.get(msg_id, ())
        if key not in keys:
            if sum((component_of(k) == 0) == from_autopilot for k in keys) >= MAX_INSTANCES:
                return None
            self._keys[msg_id] = tuple(sorted((*keys, key)))
        return key

    def keys(self, msg_ids: Iterable[int]) -> tuple[int, ...]:
        """All keys of these messages, sorted by component (the autopilot first) and instance. A message
        that was never received has one key, that of the autopilot."""
        return tuple([k for msg_id in msg_ids for k in self._keys.get(msg_id, (msg_id,))])


def active_instances(frames: Iterable[tuple[int, Frame]]) -> dict[int, Frame]:
    """Frames by key, without instances that are no longer received while another instance is received."""
    by_key = dict(frames)
    newest: dict[int, float] = {}
    for key, frame in by_key.items():
        msg_id = message_of(key)
        newest[msg_id] = max(newest.get(msg_id, float("-inf")), frame.received_monotonic_s)
    return {
        key: frame
        for key, frame in by_key.items()
        if newest[message_of(key)] - frame.received_monotonic_s <= NO_DATA_AFTER_S
    }
