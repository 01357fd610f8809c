"""PX4's message types in each of its versions (`px4_msgs.txt`), their hashes, and their encoding.

On the wire a message is little-endian CDR: each value is aligned to its own size. PX4 has neither texts of
variable length nor sequences, so one `struct` format is enough for a type.

The rest of the server knows one layout for each type, that of `BASE`; `convert` has the others.
"""

from __future__ import annotations

import dataclasses
import struct
from collections.abc import Iterator, Mapping, Sequence
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
BASE: Final = "1.17"
"""The version whose layouts the server uses inside."""
ORIGINS: Final = {"1.16": BASE, "1.15": "1.16", "1.18": BASE, "main": "1.18"}
"""For each other version, the version from which its layouts are derived."""
_FNV_OFFSET, _FNV_PRIME = 0x811C9DC5, 0x01000193
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
    defaults: Values = dataclasses.field(default_factory=dict[str, Any])
    """Values of fields of other versions that this version lacks, if they are not zero."""

    @cached_property
    def hash(self) -> int:
        """The hash with which PX4 names the layout in message_format_response: FNV-1a over the declarations
        of the fields, each nested type's after the field that uses it."""
        value = _FNV_OFFSET
        for byte in self._declarations().encode():
            value = (value ^ byte) * _FNV_PRIME & 0xFFFFFFFF
        return value

    def _declarations(self) -> str:
        declarations: list[str] = []
        for each in self.fields:
            declarations.append(f"{each.type}{f'[{each.length}]' if each.length else ''} {each.name}\n")
            if each.type not in CODES:
                declarations.append(self.nested[each.type]._declarations())
        return "".join(declarations)

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

    def check(self, data: bytes) -> None:
        """Raises MalformedMessage if the bytes do not have the type's length, with or without the padding to
        four bytes at the end, or are not little-endian CDR."""
        if data[:2] != HEADER[:2]:
            raise MalformedMessage(f"encoding {data[:2].hex() or 'missing'} is not little-endian CDR")
        if len(data) - len(HEADER) not in (self.size, self.size + -self.size % 4):
            raise MalformedMessage(
                f"{len(data)} bytes instead of the {len(HEADER) + self.size} of {self.name}"
            )

    def decode(self, data: bytes) -> dict[str, Any]:
        """Decodes bytes with header into named values; arrays become tuples.

        Raises:
            MalformedMessage: see `check`.
        """
        self.check(data)
        numbers, values, index = self._struct.unpack_from(data, len(HEADER)), dict[str, Any](), 0
        for field in self.primitive_fields:
            values[field.name] = numbers[index : index + field.length] if field.length else numbers[index]
            index += field.length or 1
        return values


def convert(data: bytes, source: MessageType, target: MessageType) -> bytes:
    """A message of one version in the layout of another; what the source lacks has its default value.

    Raises:
        MalformedMessage: see `MessageType.check`.
    """
    source.check(data)
    if source.hash == target.hash:
        return data
    return target.encode({**source.defaults, **source.decode(data)})


def parse(text: str) -> dict[str, dict[str, MessageType]]:
    """Message types by version and name, from a text in the format of `px4_msgs.txt`."""
    sections: dict[str, list[str]] = {}
    for section in text.split("\n[")[1:]:
        name, _, body = section.partition("]\n")
        sections[name] = list(filter(None, body.splitlines()))
    base: dict[str, MessageType] = {}
    for name, lines in sections.items():
        if " " not in name:
            base[name] = _message_type(name, list(map(_field, lines)), base, {})
    versions = {BASE: base}
    for version, origin in ORIGINS.items():
        versions[version] = types = dict[str, MessageType]()
        for name, known in versions[origin].items():
            lines = sections.get(f"{name} {version}", [])
            if lines == ["?"]:
                continue
            if lines or any(types[inner] is not known.nested[inner] for inner in known.nested):
                fields, defaults = _changed(known, lines)
                types[name] = _message_type(name, fields, types, defaults)
            else:
                types[name] = known
    return versions


def _field(declaration: str) -> Field:
    kind, _, name = declaration.partition(" ")
    kind, _, length = kind.rstrip("]").partition("[")
    return Field(kind, name, int(length or 0))


def _changed(origin: MessageType, differences: Sequence[str]) -> tuple[list[Field], dict[str, Any]]:
    """The fields and defaults of a type with these differences; what it lacks is removed first."""
    fields, defaults = list(origin.fields), dict(origin.defaults)
    for line in (line[2:] for line in differences if line.startswith("- ")):
        name, _, value = line.partition(" = ")
        fields = [each for each in fields if each.name != name]
        defaults |= {name: int(value)} if value else {}
    for line in (line[2:] for line in differences if line.startswith("+ ")):
        declaration, _, other = line.partition(" after ")
        fields.insert([each.name for each in fields].index(other) + 1, _field(declaration))
    return fields, defaults


def _message_type(
    name: str, fields: Sequence[Field], types: Mapping[str, MessageType], defaults: Values
) -> MessageType:
    nested = {each.type: types[each.type] for each in fields if each.type not in CODES}
    return MessageType(name, tuple(fields), nested, defaults)


VERSIONS: Final = parse((Path(__file__).parent / "px4_msgs.txt").read_text(encoding="utf-8"))
"""Types by version of PX4 and by name."""
MESSAGES: Final = VERSIONS[BASE]
"""The types as the server uses them inside, by name."""
LAYOUTS: Final[Mapping[tuple[str, int], MessageType]] = {
    (name, message.hash): message for types in VERSIONS.values() for name, message in types.items()
}
"""All known layouts by name and hash of the type."""


def versions_of(message: MessageType) -> str:
    """The versions of PX4 with this layout, for people: v1.16, v1.17."""
    known = sorted(
        version
        for version, types in VERSIONS.items()
        if message.name in types and types[message.name].hash == message.hash
    )
    return ", ".join(version if version == "main" else f"v{version}" for version in known)
