"""PX4's log format ULog, version 1, as bytes: every message a file may hold and nothing about its contents.

Format: docs.px4.io, "ULog File Format". Little-endian, fields packed in the order they are declared.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

MAGIC = b"ULog\x01\x12\x35"
VERSION = 1
_HEAD = struct.Struct("<HB")
_DATA_HEAD = struct.Struct("<HBH")
TYPES: dict[str, tuple[str, str]] = {
    "int8_t": ("b", "<i1"), "uint8_t": ("B", "<u1"), "int16_t": ("h", "<i2"), "uint16_t": ("H", "<u2"),
    "int32_t": ("i", "<i4"), "uint32_t": ("I", "<u4"), "int64_t": ("q", "<i8"), "uint64_t": ("Q", "<u8"),
    "float": ("f", "<f4"), "double": ("d", "<f8"), "bool": ("?", "?"), "char": ("c", "S1"),
}  # fmt: skip
"""ULog's types as `struct` and NumPy call them."""
INCOMPAT_NOTHING = bytes(8)
HAS_DEFAULTS = b"\x01" + bytes(7)
SYSTEM_DEFAULT, AIRFRAME_DEFAULT = 1, 2
"""Bits of a default value: of the firmware, of this airframe."""


def message(kind: str, body: bytes) -> bytes:
    """A message of one kind (a letter)."""
    return _HEAD.pack(len(body), ord(kind)) + body


def header(start_us: int) -> bytes:
    """How a file begins; the time is the vehicle's since boot."""
    return MAGIC + bytes((VERSION,)) + struct.pack("<Q", start_us)


def flag_bits() -> bytes:
    """What a reader must know to read on: default values are told, nothing is appended."""
    return message("B", HAS_DEFAULTS + INCOMPAT_NOTHING + bytes(24))


def _key_value(declaration: str, value: bytes) -> bytes:
    key = declaration.encode("ascii")
    return bytes((len(key),)) + key + value


def info(name: str, value: str | int, kind: str = "uint32_t") -> bytes:
    """A fact about the log; a text, or a number of the given type."""
    if isinstance(value, str):
        text = value.encode("utf-8")
        return message("I", _key_value(f"char[{len(text)}] {name}", text))
    return message("I", _key_value(f"{kind} {name}", struct.pack("<" + TYPES[kind][0], value)))


def _parameter_body(name: str, value: float, *, integer: bool) -> bytes:
    kind = "int32_t" if integer else "float"
    return _key_value(f"{kind} {name}", struct.pack("<" + TYPES[kind][0], int(value) if integer else value))


def parameter(name: str, value: float, *, integer: bool) -> bytes:
    """A parameter: in the definitions as it was, among the data as it became."""
    return message("P", _parameter_body(name, value, integer=integer))


def default_parameter(name: str, value: float, *, integer: bool, kinds: int) -> bytes:
    """What a parameter was before anybody set it."""
    return message("Q", bytes((kinds,)) + _parameter_body(name, value, integer=integer))


def subscription(multi_id: int, msg_id: int, name: str) -> bytes:
    """Gives a topic the number its data carry."""
    return message("A", struct.pack("<BH", multi_id, msg_id) + name.encode("ascii"))


def logged(severity: int, time_us: int, text: str) -> bytes:
    """A sentence; severity is MAV_SEVERITY."""
    return message("L", struct.pack("<BQ", ord("0") + severity, time_us) + text.encode("utf-8"))


@dataclass(frozen=True, slots=True)
class Field:
    """One declared field; length 0: a scalar."""

    type: str
    name: str
    length: int


def _fields(declaration: str) -> tuple[Field, ...]:
    fields: list[Field] = []
    for part in declaration.split(";"):
        kind, _, name = part.strip().partition(" ")
        kind, _, length = kind.rstrip("]").partition("[")
        fields.append(Field(kind, name, int(length or 0)))
    return tuple(fields)


class Layout:
    """How a topic's samples lie in a file.

    Args:
        name: of the topic.
        declaration: `type name` or `type[n] name`, divided by semicolons; the time of the sample goes first.
        msg_id: number in the file.
        multi_id: instance of the topic.
    """

    def __init__(self, name: str, declaration: str, msg_id: int, multi_id: int = 0) -> None:
        self.name = name
        self.msg_id = msg_id
        self.multi_id = multi_id
        self.declaration = "uint64_t timestamp;" + declaration
        self.fields = _fields(self.declaration)
        codes = [f"{field.length or ''}{TYPES[field.type][0]}" for field in self.fields]
        self._struct = struct.Struct("<" + "".join(codes))
        self._head = _DATA_HEAD.pack(self._struct.size + 2, ord("D"), msg_id)

    @property
    def format(self) -> bytes:
        """The format message."""
        text = "".join(
            f"{f.type}{f'[{f.length}]' if f.length else ''} {f.name};" for f in self.fields
        )  # fmt: skip
        return message("F", f"{self.name}:{text}".encode("ascii"))

    @property
    def subscription(self) -> bytes:
        """The subscription message."""
        return subscription(self.multi_id, self.msg_id, self.name)

    @cached_property
    def dtype(self) -> np.dtype[Any]:
        """A whole data message as a NumPy record."""
        columns: list[Any] = [("message_size", "<u2"), ("message_type", "u1"), ("message_id", "<u2")]
        for field in self.fields:
            code = TYPES[field.type][1]
            columns.append((field.name, code, (field.length,)) if field.length else (field.name, code))
        return np.dtype(columns)

    def blank(self) -> np.ndarray[Any, np.dtype[Any]]:
        """One record of zeros with its head."""
        record = np.zeros((), dtype=self.dtype)
        record["message_size"] = self._struct.size + 2
        record["message_type"] = ord("D")
        record["message_id"] = self.msg_id
        return record

    def pack(self, values: Sequence[Any]) -> bytes:
        """One data message of the values in order, arrays spread out."""
        return self._head + self._struct.pack(*values)
