"""The PX4 message types that the server reads or sends (`px4_msgs.txt`), and their encoding.

On the wire a message is little-endian CDR: each value is aligned to its own size. All types in
this module have a fixed size, so one `struct` format is enough for a type.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

CODES: Final = {
    "bool": ("?", 1), "char": ("B", 1), "int8": ("b", 1), "uint8": ("B", 1), "int16": ("h", 2),
    "uint16": ("H", 2),
    "int32": ("i", 4), "uint32": ("I", 4), "int64": ("q", 8), "uint64": ("Q", 8), "float32": ("f", 4),
    "float64": ("d", 8),
}  # fmt: skip
"""`struct` code and size [bytes] of each primitive type; a text is an array of bytes."""
HEADER: Final = b"\x00\x01\x00\x00"
"""Encapsulation header: plain CDR, little endian."""
Values = Mapping[str, Any]


class MalformedMessage(ValueError):
    """Bytes that are not a message of the type."""


@dataclass(frozen=True, slots=True)
class Field:
    """One field; length 0: a single value."""

    type: str
    name: str
    length: int


@dataclass(frozen=True, eq=False)
class MessageType:
    """One message type; `nested` contains the types of fields that are not primitive."""

    name: str
    fields: tuple[Field, ...]
    nested: Mapping[str, MessageType]

    @cached_property
    def primitive_fields(self) -> tuple[Field, ...]:
        """All primitive fields in wire order; those of nested types are called `outer.inner`
        or `outer[n].inner`."""
        return tuple(self._primitive_fields(""))

    def _primitive_fields(self, prefix: str) -> Iterator[Field]:
        for field in self.fields:
            if field.type in CODES:
                yield Field(field.type, prefix + field.name, field.length)
            elif field.length:
                for n in range(field.length):
                    yield from self.nested[field.type]._primitive_fields(f"{prefix}{field.name}[{n}].")
            else:
                yield from self.nested[field.type]._primitive_fields(f"{prefix}{field.name}.")

    @cached_property
    def _struct(self) -> struct.Struct:
        codes, offset = ["<"], 0
        for field in self.primitive_fields:
            code, size = CODES[field.type]
            padding = -offset % size
            codes.append("x" * padding + f"{field.length or 1}{code}")
            offset += padding + size * (field.length or 1)
        return struct.Struct("".join(codes))

    @property
    def size(self) -> int:
        """Bytes without the header and the padding at the end."""
        return self._struct.size

    def encode(self, values: Values) -> bytes:
        """Encodes named values into bytes with header; missing values are zero.

        Raises:
            struct.error: a value does not fit its field.
            OverflowError: a number does not fit a float32.
        """
        numbers: list[Any] = []
        for field in self.primitive_fields:
            value = values.get(field.name, (0,) * field.length if field.length else 0)
            if field.length:
                numbers.extend(value)
            else:
                numbers.append(value)
        return HEADER + self._struct.pack(*numbers)

    def decode(self, data: bytes) -> dict[str, Any]:
        """Decodes bytes with header into named values; arrays become tuples.

        Raises:
            MalformedMessage: the bytes are too short, or not little-endian CDR.
        """
        if data[:2] != HEADER[:2]:
            raise MalformedMessage(f"encoding {data[:2].hex() or 'missing'} is not little-endian CDR")
        if len(data) < len(HEADER) + self.size:
            raise MalformedMessage(
                f"{len(data)} bytes instead of the {len(HEADER) + self.size} of {self.name}"
            )
        numbers, values, index = self._struct.unpack_from(data, len(HEADER)), dict[str, Any](), 0
        for field in self.primitive_fields:
            values[field.name] = numbers[index : index + field.length] if field.length else numbers[index]
            index += field.length or 1
        return values


def parse(text: str) -> dict[str, MessageType]:
    """Message types by name, from a text in the format of `px4_msgs.txt`."""
    types: dict[str, MessageType] = {}
    for section in text.split("\n[")[1:]:
        name, _, body = section.partition("]\n")
        fields: list[Field] = []
        for line in filter(None, body.splitlines()):
            kind, _, field_name = line.partition(" ")
            kind, _, length = kind.rstrip("]").partition("[")
            fields.append(Field(kind, field_name, int(length or 0)))
        nested = {field.type: types[field.type] for field in fields if field.type not in CODES}
        types[name] = MessageType(name, tuple(fields), nested)
    return types


_FOLDER = Path(__file__).parent
MESSAGES: Final = parse((_FOLDER / "px4_msgs.txt").read_text(encoding="utf-8"))
"""Types that the server uses, by name."""
SHOWN: Final = parse((_FOLDER / "shown_msgs.txt").read_text(encoding="utf-8")) | MESSAGES
"""All known types by name, including those that the server only shows in the inspector."""
