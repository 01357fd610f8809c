"""Keeps the instances of a message apart: batteries 0 and 1, main and auxiliary outputs, several gimbals.

A message whose dialect has an instance field is kept by (message, instance), so that two batteries never
overwrite each other. A key is the message's id, with the instance in its highest byte: that of instance 0 is
the id itself. Only messages of the autopilot and of one gimbal are stored.
"""

from __future__ import annotations

from collections.abc import Iterable

from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import Frame, full_payload
from gcs_server.vehicle import gimbal_decoder

INSTANCE_AT = {
    d.MAVLINK_MSG_ID_BATTERY_STATUS: 32,
    d.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: 20,
    d.MAVLINK_MSG_ID_DISTANCE_SENSOR: 11,
}
"""Offset of the instance's byte in the payload; a test compares them with the dialect."""
DEVICE_AT = {d.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: 48, d.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS: 8}
"""Offset of gimbal_device_id."""
ANY_COMPONENT = frozenset(gimbal_decoder.IDS)
"""Messages that a separate gimbal may send instead of the autopilot."""
MAX_INSTANCES = 8
"""Most instances of one message; PX4 has four batteries at most. More are not kept."""
SILENT_AFTER_S = 10.0
"""An instance silent for this long is dropped while another instance is heard."""
OTHER_GIMBAL_AFTER_S = 3.0
"""A second gimbal is shown after the first has been silent for this long."""
ID_MASK = 0xFFFFFF


def message_of(key: int) -> int:
    """The message's id."""
    return key & ID_MASK


def instance_of(key: int) -> int:
    """Instance of a message; 0 if it has no instances."""
    return key >> 24


class Instances:
    """The message instances of one vehicle, and the gimbal to show."""

    def __init__(self) -> None:
        self._keys: dict[int, tuple[int, ...]] = {}
        self._gimbals: dict[int, tuple[tuple[int, int], float]] = {}

    def key_of(self, frame: Frame) -> int | None:
        """Key of a frame; None if there are too many instances."""
        at = INSTANCE_AT.get(frame.msg_id)
        if at is None:
            return frame.msg_id
        key = frame.msg_id | full_payload(frame)[at] << 24
        known = self._keys.get(frame.msg_id, ())
        if key not in known:
            if len(known) >= MAX_INSTANCES:
                return None
            self._keys[frame.msg_id] = tuple(sorted((*known, key)))
        return key

    def keys(self, msg_ids: Iterable[int]) -> tuple[int, ...]:
        """All keys of these messages, the lowest instance of each first."""
        return tuple([k for msg_id in msg_ids for k in self._keys.get(msg_id, (msg_id,))])

    def is_shown(self, frame: Frame) -> bool:
        """Whether a frame is from the shown gimbal: the lowest component and device that is heard."""
        at = DEVICE_AT.get(frame.msg_id)
        sender = (frame.component_id, 0 if at is None else full_payload(frame)[at])
        now_s = frame.received_monotonic_s
        shown, received_s = self._gimbals.get(frame.msg_id, (sender, now_s))
        if shown < sender and now_s - received_s < OTHER_GIMBAL_AFTER_S:
            return False
        self._gimbals[frame.msg_id] = (sender, now_s)
        return True


def heard(frames: Iterable[tuple[int, Frame]]) -> dict[int, Frame]:
    """Frames by key, without silent instances of which another instance is heard."""
    kept = dict(frames)
    newest: dict[int, float] = {}
    for key, frame in kept.items():
        msg_id = message_of(key)
        newest[msg_id] = max(newest.get(msg_id, float("-inf")), frame.received_monotonic_s)
    return {
        key: frame
        for key, frame in kept.items()
        if newest[message_of(key)] - frame.received_monotonic_s <= SILENT_AFTER_S
    }
