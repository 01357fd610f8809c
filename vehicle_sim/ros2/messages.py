"""The ROS 2 message types of each version of PX4: fields, constants, layout and hash, from `px4_msgs.txt`.

On the wire a message is little-endian CDR: each value is aligned to its own size. All types of PX4 have a
fixed size, so one `struct` format packs a message.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

CODES: Final = {
    "bool": ("?", 1), "char": ("s", 1), "int8": ("b", 1), "uint8": ("B", 1), "int16": ("h", 2),
    "uint16": ("H", 2), "int32": ("i", 4), "uint32": ("I", 4), "int64": ("q", 8), "uint64": ("Q", 8),
    "float32": ("f", 4), "float64": ("d", 8),
}  # fmt: skip
"""`struct` code and size [bytes] by primitive type."""
HEADER: Final = b"\x00\x01\x00\x00"
"""Encapsulation header: plain CDR, little endian."""
BASE, CHANGED = "1.16", "1.17"
"""The version of PX4 whose types the file has in full, and the version of its differences."""
MAX_FLOAT32: Final = (2.0 - 2.0**-23) * 2.0**127
_FNV_OFFSET, _FNV_PRIME = 0x811C9DC5, 0x01000193


class MalformedMessage(ValueError):
    """Bytes that are not a valid message of the type."""


@dataclass(frozen=True, slots=True)
class Field:
    """One field; length 0 means a single value, otherwise an array."""

    type: str
    name: str
    length: int


@dataclass(frozen=True, eq=False)
class MessageType:
    """One message type; `nested` contains the message types of its fields."""

    name: str
    fields: tuple[Field, ...]
    constants: Mapping[str, int]
    nested: Mapping[str, MessageType]

    @cached_property
    def flat(self) -> tuple[Field, ...]:
        """Primitive fields in wire order; nested fields are named `outer.inner` or `outer[n].inner`."""
        return tuple(self._flat(""))

    def _flat(self, prefix: str) -> Iterator[Field]:
        for field in self.fields:
            if field.type in CODES:
                yield Field(field.type, prefix + field.name, field.length)
            elif field.length:
                for n in range(field.length):
                    yield from self.nested[field.type]._flat(f"{prefix}{field.name}[{n}].")
            else:
                yield from self.nested[field.type]._flat(f"{prefix}{field.name}.")

    @cached_property
    def index(self) -> Mapping[str, int]:
        """Index of each field's first value in the argument of `pack`."""
        index: dict[str, int] = {}
        at = 0
        for field in self.flat:
            index[field.name] = at
            at += 1 if field.type == "char" else field.length or 1
        return index

    @cached_property
    def _struct(self) -> struct.Struct:
        codes, at = ["<"], 0
        for field in self.flat:
            code, size = CODES[field.type]
            padding = -at % size
            codes.append("x" * padding + (f"{field.length}{code}" if field.length else code))
            at += padding + size * (field.length or 1)
        return struct.Struct("".join(codes))

    @property
    def size(self) -> int:
        """Bytes without the header and the padding at the end."""
        return self._struct.size

    @cached_property
    def hash(self) -> int:
        """Hash that PX4 sends for this type in message_format_response: FNV-1a over the fields'
        declarations."""
        value = _FNV_OFFSET
        for byte in self._declarations().encode():
            value = (value ^ byte) * _FNV_PRIME & 0xFFFFFFFF
        return value

    @property
    def version(self) -> int:
        """Version of the type; from 1 on it is part of the names of its topics."""
        return self.constants.get("MESSAGE_VERSION", 0)

    def _declarations(self) -> str:
        declarations: list[str] = []
        for field in self.fields:
            declarations.append(f"{field.type}{f'[{field.length}]' if field.length else ''} {field.name}\n")
            if field.type not in CODES:
                declarations.append(self.nested[field.type]._declarations())
        return "".join(declarations)

    def blank(self) -> list[Any]:
        """Values for `pack`, all zero."""
        values: list[Any] = []
        for field in self.flat:
            values += [b""] if field.type == "char" else [0] * (field.length or 1)
        return values

    def pack(self, values: Sequence[Any]) -> bytes:
        """Packs the values of all `flat` fields, arrays expanded, into bytes with header.

        A float32 outside its range becomes infinite, as in C, so that a diverged estimate can be sent.

        Raises:
            struct.error: an integer does not fit its field.
        """
        try:
            return HEADER + self._struct.pack(*values)
        except OverflowError:
            return HEADER + self._struct.pack(*self._within_float32(values))

    def _within_float32(self, values: Sequence[Any]) -> list[Any]:
        limited = list(values)
        for field in self.flat:
            if field.type == "float32":
                first = self.index[field.name]
                for at in range(first, first + (field.length or 1)):
                    if abs(limited[at]) > MAX_FLOAT32:
                        limited[at] = math.copysign(math.inf, limited[at])
        return limited

    def encode(self, values: Mapping[str, Any]) -> bytes:
        """Encodes named values into bytes with header; missing values are zero.

        Raises:
            KeyError: no such field.
            struct.error: an integer does not fit its field.
        """
        flat_values, index = self.blank(), self.index
        for name, value in values.items():
            at = index[name]
            if isinstance(value, str):
                flat_values[at] = value.encode()
            elif isinstance(value, list | tuple):
                flat_values[at : at + len(value)] = value
            else:
                flat_values[at] = value
        return self.pack(flat_values)

    def decode(self, data: bytes) -> dict[str, Any]:
        """Decodes bytes with header into named values; a text ends at its first NUL.

        Raises:
            MalformedMessage: the data is too short or has another encoding.
        """
        if data[:2] != HEADER[:2]:
            raise MalformedMessage(f"{self.name}: encapsulation {data[:2].hex()} is not little-endian CDR")
        if len(data) < len(HEADER) + self.size:
            raise MalformedMessage(f"{self.name}: {len(data)} bytes; needs {len(HEADER) + self.size}")
        flat_values, values = self._struct.unpack_from(data, len(HEADER)), dict[str, Any]()
        at = 0
        for field in self.flat:
            if field.type == "char":
                values[field.name] = flat_values[at].split(b"\0")[0].decode("utf-8", "replace")
                at += 1
            elif field.length:
                values[field.name] = flat_values[at : at + field.length]
                at += field.length
            else:
                values[field.name] = flat_values[at]
                at += 1
        return values


def parse(text: str) -> dict[str, dict[str, MessageType]]:
    """Message types by version and name, from a text in the format of `px4_msgs.txt`; nested types must
    precede the types that use them."""
    sections: dict[str, list[str]] = {}
    for section in text.split("\n[")[1:]:
        name, _, body = section.partition("]\n")
        sections[name] = list(filter(None, body.splitlines()))
    base: dict[str, MessageType] = {}
    changed: dict[str, MessageType] = {}
    for name, lines in sections.items():
        type_name, _, version = name.partition(" ")
        if version:
            changed[type_name] = _derived(type_name, lines, base.get(type_name), changed)
            continue
        base[name] = _message_type(name, list(map(_field, _fields_in(lines))), _constants_in(lines), base)
        changed[name] = base[name]
        if any(changed[inner] is not base[inner] for inner in base[name].nested):
            changed[name] = _derived(name, [], base[name], changed)
    return {BASE: base, CHANGED: changed}


def _derived(
    name: str, lines: list[str], origin: MessageType | None, types: Mapping[str, MessageType]
) -> MessageType:
    """A type with these differences from another one, or a new type."""
    fields: list[Field] = []
    constants: dict[str, int] = {}
    if origin is not None:
        removed = {line[2:] for line in lines if line.startswith("- ")}
        fields = [each for each in origin.fields if each.name not in removed]
        constants = {each: value for each, value in origin.constants.items() if each not in removed}
    for line in _fields_in(lines):
        declaration, _, previous = line.removeprefix("+ ").partition(" after ")
        at = 1 + [each.name for each in fields].index(previous) if previous else len(fields)
        fields.insert(at, _field(declaration))
    return _message_type(name, fields, constants | _constants_in(lines), types)


def _fields_in(lines: list[str]) -> list[str]:
    return [line for line in lines if " = " not in line and not line.startswith("- ")]


def _constants_in(lines: list[str]) -> dict[str, int]:
    pairs = (line.split(" = ") for line in lines if " = " in line)
    return {name: int(value) for name, value in pairs}


def _field(declaration: str) -> Field:
    type_name, _, name = declaration.partition(" ")
    type_name, _, length = type_name.rstrip("]").partition("[")
    return Field(type_name, name, int(length or 0))


def _message_type(
    name: str, fields: list[Field], constants: dict[str, int], types: Mapping[str, MessageType]
) -> MessageType:
    nested = {field.type: types[field.type] for field in fields if field.type not in CODES}
    return MessageType(name, tuple(fields), constants, nested)


MESSAGES: Final = parse((Path(__file__).parent / "px4_msgs.txt").read_text(encoding="utf-8"))
"""Message types by version of PX4 ("1.16") and name."""
