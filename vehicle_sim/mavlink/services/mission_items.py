"""Checks of items as in PX4's mission protocol, and the id of a stored plan."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from typing import Any, Final

ACCEPTED, ERROR, UNSUPPORTED_FRAME, UNSUPPORTED, NO_SPACE, INVALID_SEQUENCE = 0, 1, 2, 3, 4, 13
CANCELLED = 15
"""MAV_MISSION_RESULT."""
MISSION, FENCE, RALLY, ALL = 0, 1, 2, 255
"""MAV_MISSION_TYPE."""
CAPACITY: Final[dict[int, int]] = {MISSION: 10_000, FENCE: 64, RALLY: 32}
"""Number of items that PX4 can store in SITL."""

FRAME_MISSION = 2
_GLOBAL_FRAMES = frozenset({0, 3})
_GLOBAL_INT_FRAMES = frozenset({5, 6})
_POLYGON_VERTICES = frozenset({5001, 5002})
_FENCE_ITEMS = frozenset({5000, 5001, 5002, 5003, 5004})
_RALLY_POINT = 5100
_GLOBAL_COMMANDS = _FENCE_ITEMS | {16, 17, 19, 21, 22, 31, 84, 85, 195, 201, 4501, _RALLY_POINT}
"""Commands that PX4 accepts only in a global frame."""
_MISSION_FRAME_COMMANDS = frozenset(
    {20, 93, 112, 114, 177, 178, 179, 187, 189, 196, 197, 200, 203, 204, 205, 206, 211, 214, 260, 530,
     532, 1000, 1001, 2000, 2001, 2003, 2500, 2501, 3000, 42600}
)  # fmt: skip
"""Commands that PX4 accepts only in the frame MAV_FRAME_MISSION."""
_MIN_POLYGON_VERTICES = 3

_CRC_ITEM, _CRC_FLOAT_ITEM = struct.Struct("<BHB4fiif"), struct.Struct("<BHB7f")
_POLYNOMIAL = 0xEDB88320


def _crc_table() -> tuple[int, ...]:
    table: list[int] = []
    for byte in range(256):
        entry = byte
        for _ in range(8):
            entry = (entry >> 1) ^ (_POLYNOMIAL if entry & 1 else 0)
        table.append(entry)
    return tuple(table)


_CRC_TABLE = _crc_table()


def check_item(mission_type: int, item: Mapping[str, Any], *, as_int: bool) -> int:
    """PX4's MAV_MISSION_RESULT for an item (fields of MISSION_ITEM or MISSION_ITEM_INT)."""
    frame, command = item["frame"], item["command"]
    if frame in _GLOBAL_FRAMES or (as_int and frame in _GLOBAL_INT_FRAMES):
        supported = command in _GLOBAL_COMMANDS
    elif frame == FRAME_MISSION:
        supported = command in _MISSION_FRAME_COMMANDS
    else:
        return UNSUPPORTED_FRAME
    if not supported:
        return UNSUPPORTED
    return ERROR if is_refused_silently(mission_type, item) else ACCEPTED


def is_refused_silently(mission_type: int, item: Mapping[str, Any]) -> bool:
    """Whether PX4 refuses an item without a status text: a fence item or rally point in a mission, or a
    polygon with too few vertices."""
    command = item["command"]
    if mission_type == MISSION:
        return command in _FENCE_ITEMS or command == _RALLY_POINT
    if mission_type == FENCE and command in _POLYGON_VERTICES:
        vertices = item["param1"]
        return not (math.isfinite(vertices) and int(vertices + 0.5) >= _MIN_POLYGON_VERTICES)
    return False


def opaque_id(items: Sequence[Mapping[str, Any]]) -> int:
    """PX4's id of a plan: a CRC32 over the items, with start value and final XOR zero; 0 for an empty plan.

    The CRC covers the received fields: positions in 1e-7 degrees, or in degrees if they were sent as floats.
    """
    crc = 0
    for item in items:
        layout = _CRC_ITEM if isinstance(item["x"], int) else _CRC_FLOAT_ITEM
        packed = layout.pack(
            item["frame"], item["command"], item["autocontinue"], item["param1"], item["param2"],
            item["param3"], item["param4"], item["x"], item["y"], item["z"],
        )  # fmt: skip
        for byte in packed:
            crc = _CRC_TABLE[(crc ^ byte) & 0xFF] ^ (crc >> 8)
    return crc
