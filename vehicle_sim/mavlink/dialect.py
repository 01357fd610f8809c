"""Message layouts of the generated dialect as tables, which pack and unpack payloads.

This is the only module of the simulator that imports the dialect. It reads the dialect's classes once for
field order, struct format and CRC extra; pymavlink does not encode or decode messages.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from .generated_dialect import mavlink_map as _classes


@dataclass(frozen=True, slots=True)
class Layout:
    """The binary layout of one message."""

    id: int
    name: str
    fields: tuple[str, ...]
    """Field names in wire order."""
    array_lengths: tuple[int, ...]
    """0 for scalars and strings."""
    is_text: tuple[bool, ...]
    """Whether each field is a text."""
    packer: struct.Struct
    slots: tuple[tuple[str, int, bool], ...]
    """(field name, array length, whether the field is a text) in wire order."""
    id_bytes: bytes
    """The message id as bytes of a MAVLink 2 header."""
    crc_extra_byte: bytes


def _layout(cls: Any) -> Layout:
    types = dict(zip(cls.fieldnames, cls.fieldtypes, strict=True))
    field_names: tuple[str, ...] = tuple(cls.ordered_fieldnames)
    text_flags = tuple(types[name] == "char" for name in field_names)
    lengths = tuple(
        0 if is_text else length for length, is_text in zip(cls.array_lengths, text_flags, strict=True)
    )
    return Layout(
        cls.id,
        cls.msgname,
        field_names,
        lengths,
        text_flags,
        struct.Struct(cls.unpacker.format),
        tuple(zip(field_names, lengths, text_flags, strict=True)),
        int(cls.id).to_bytes(3, "little"),
        bytes((cls.crc_extra,)),
    )


LAYOUTS: dict[int, Layout] = {msg_id: _layout(cls) for msg_id, cls in _classes.items()}
BY_NAME: dict[str, Layout] = {layout.name: layout for layout in LAYOUTS.values()}


class Message:
    """A decoded message: its fields as attributes, its sender, and the raw frame for forwarding."""

    __slots__ = ("component_id", "id", "name", "raw", "system_id", "values")

    def __init__(
        self, layout: Layout, values: dict[str, Any], system_id: int, component_id: int, frame: bytes
    ) -> None:
        self.id = layout.id
        self.name = layout.name
        self.values = values
        self.system_id = system_id
        self.component_id = component_id
        self.raw = frame

    def __getattr__(self, name: str) -> Any:
        try:
            return self.values[name]
        except KeyError:
            raise AttributeError(f"{self.name} has no field {name}") from None

    @property
    def sender(self) -> tuple[int, int]:
        """(system id, component id)."""
        return self.system_id, self.component_id

    def __repr__(self) -> str:
        return f"{self.name}({self.values})"


def _fields(layout: Layout, flat: tuple[Any, ...]) -> Iterator[tuple[str, Any]]:
    index = 0
    for name, length, is_text in zip(layout.fields, layout.array_lengths, layout.is_text, strict=True):
        if length:
            yield name, list(flat[index : index + length])
            index += length
            continue
        value = flat[index]
        yield name, value.split(b"\0", 1)[0].decode("ascii", "replace") if is_text else value
        index += 1


def unpack(layout: Layout, payload: bytes) -> dict[str, Any]:
    """Fields by name; a payload truncated by MAVLink 2 is padded with zeros, extra bytes are ignored."""
    size = layout.packer.size
    return dict(_fields(layout, layout.packer.unpack(payload[:size].ljust(size, b"\0"))))


def pack(name: str, /, **fields: Any) -> tuple[Layout, bytes]:
    """Layout and payload of a message from its fields; missing fields are zero."""
    layout = BY_NAME[name]
    flat: list[Any] = []
    known_count = 0
    for field, length, is_text in layout.slots:
        value = fields.get(field)
        if field in fields:
            known_count += 1
        if length:
            items = list(value or ())[:length]
            flat += items + [0] * (length - len(items))
        elif is_text:
            flat.append(value.encode("ascii", "replace") if isinstance(value, str) else value or b"")
        else:
            flat.append(0 if value is None else value)
    if known_count != len(fields):
        unknown = sorted(fields.keys() - set(layout.fields))
        raise TypeError(f"{name} has no field {', '.join(unknown)}")
    return layout, layout.packer.pack(*flat)
