"""Byte layout of a topic's samples in a log or on a bus: named fields of fixed types in order."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

_DATA_HEAD = struct.Struct("<HBH")
TYPES: dict[str, tuple[str, str]] = {
    "int8_t": ("b", "<i1"), "uint8_t": ("B", "<u1"), "int16_t": ("h", "<i2"), "uint16_t": ("H", "<u2"),
    "int32_t": ("i", "<i4"), "uint32_t": ("I", "<u4"), "int64_t": ("q", "<i8"), "uint64_t": ("Q", "<u8"),
    "float": ("f", "<f4"), "double": ("d", "<f8"), "bool": ("?", "?"), "char": ("c", "S1"),
}  # fmt: skip
"""`struct` and NumPy codes of PX4's types."""


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


class TopicLayout:
    """Layout of one topic; `pack` and `blank` create the data messages of a log (ULog type D).

    Args:
        name: name of the topic.
        declaration: fields `type name` or `type[n] name` after the timestamp, separated by semicolons.
        msg_id: id of the topic in the log file.
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

    @cached_property
    def dtype(self) -> np.dtype[Any]:
        """A whole data message as a NumPy record."""
        columns: list[Any] = [("message_size", "<u2"), ("message_type", "u1"), ("message_id", "<u2")]
        for field in self.fields:
            code = TYPES[field.type][1]
            columns.append((field.name, code, (field.length,)) if field.length else (field.name, code))
        return np.dtype(columns)

    def blank(self) -> np.ndarray[Any, np.dtype[Any]]:
        """One record of zeros with its message header."""
        record = np.zeros((), dtype=self.dtype)
        record["message_size"] = self._struct.size + 2
        record["message_type"] = ord("D")
        record["message_id"] = self.msg_id
        return record

    def pack(self, values: Sequence[Any]) -> bytes:
        """Packs one data message from the values in order, with arrays flattened."""
        return self._head + self._struct.pack(*values)
