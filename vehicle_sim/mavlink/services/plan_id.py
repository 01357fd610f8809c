"""PX4's id of a stored plan: a CRC32 over the items as received, with start value and final XOR zero.

An empty plan has the id 0. The CRC covers positions in 1e-7 degrees, or in degrees if they were sent as
floats.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any

_INT_ITEM, _FLOAT_ITEM = struct.Struct("<BHB4fiif"), struct.Struct("<BHB7f")
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


def add_to_id(plan_id: int, item: Mapping[str, Any]) -> int:
    """The id of a plan with one more item (fields of MISSION_ITEM or MISSION_ITEM_INT)."""
    layout = _INT_ITEM if isinstance(item["x"], int) else _FLOAT_ITEM
    packed = layout.pack(
        item["frame"], item["command"], item["autocontinue"], item["param1"], item["param2"],
        item["param3"], item["param4"], item["x"], item["y"], item["z"],
    )  # fmt: skip
    for byte in packed:
        plan_id = _CRC_TABLE[(plan_id ^ byte) & 0xFF] ^ (plan_id >> 8)
    return plan_id
