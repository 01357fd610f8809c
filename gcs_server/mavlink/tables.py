"""Layout tables of all messages, built once from the dialect's classes."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

from gcs_server.mavlink.dialect import MAVLink_message, mavlink_map


@dataclass(frozen=True, slots=True)
class Layout:
    """Layout of one message."""

    msg_id: int
    name: str
    crc_extra: bytes
    """CRC_EXTRA of the message, one byte."""
    fields: tuple[str, ...]
    """Field names in wire order."""
    values_of: Callable[[MAVLink_message], tuple[Any, ...]]
    """Returns the values of a message's fields in wire order; the value of an array is a list."""
    lengths: tuple[int, ...]
    """Number of elements per field, in wire order; 1 for scalars and texts."""
    unpacker: struct.Struct
    order: tuple[int, ...]
    """For each argument of the message class's constructor, its position in wire order."""
    message_class: type[MAVLink_message]
    has_arrays: bool


def _layout(msg_id: int, cls: Any) -> Layout:
    wire_types = dict(zip(cls.fieldnames, cls.fieldtypes, strict=True))
    array_lengths = dict(zip(cls.ordered_fieldnames, cls.array_lengths, strict=True))
    texts = {n for n in cls.ordered_fieldnames if wire_types[n] == "char" and array_lengths[n]}
    return Layout(
        msg_id=msg_id,
        name=cls.msgname,
        crc_extra=bytes([cls.crc_extra]),
        fields=tuple(cls.ordered_fieldnames),
        values_of=_values_of(tuple(f"_{n}_raw" if n in texts else n for n in cls.ordered_fieldnames)),
        lengths=tuple(cls.lengths),
        unpacker=cls.unpacker,
        order=tuple(cls.orders),
        message_class=cls,
        has_arrays=any(length > 1 for length in cls.lengths),
    )


def _values_of(attributes: tuple[str, ...]) -> Callable[[MAVLink_message], tuple[Any, ...]]:
    getter = attrgetter(*attributes)
    return getter if len(attributes) > 1 else lambda message: (getter(message),)


RENAMED = frozenset({296})
"""Messages that have another name in PX4 v1.17 and therefore another checksum (GLOBAL_POSITION). The
server treats them as unknown."""
LAYOUTS: dict[int, Layout] = {
    msg_id: _layout(msg_id, cls) for msg_id, cls in mavlink_map.items() if msg_id not in RENAMED
}
CRC_EXTRA: dict[int, bytes] = {msg_id: layout.crc_extra for msg_id, layout in LAYOUTS.items()}
NAMES: dict[int, str] = {msg_id: layout.name for msg_id, layout in LAYOUTS.items()}


def _target_system_offset(layout: Layout) -> int | None:
    """Offset of `target_system` in the payload; None if the message has no such field."""
    if "target_system" not in layout.fields:
        return None
    formats = re.findall(r"\d*[a-zA-Z]", layout.unpacker.format)
    position = layout.fields.index("target_system")
    return struct.calcsize("<" + "".join(formats[:position]))


TARGET_SYSTEM_OFFSET: dict[int, int] = {
    msg_id: offset
    for msg_id, layout in LAYOUTS.items()
    if (offset := _target_system_offset(layout)) is not None
}
"""Offset of the target system in the payload of each addressed message."""
