"""Byte layout of a topic's samples in a log: the topic's fields in order, each with a name and a type."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

_DATA_HEADER = struct.Struct("<HBH")
TYPES: dict[str, tuple[str, str]] = {
    "int8_t": ("b", "<i1"), "uint8_t": ("B", "<u1"), "int16_t": ("h", "<i2"), "uint16_t": ("H", "<u2"),
    "int32_t": ("i", "<i4"), "uint32_t": ("I", "<u4"), "int64_t": ("q", "<i8"), "uint64_t": ("Q", "<u8"),
    "float": ("f", "<f4"), "double": ("d", "<f8"), "bool": ("?", "?"), "char": ("c", "S1"),
}  # fmt: skip
"""`struct` and NumPy codes of PX4's types."""


@dataclass(frozen=True, slots=True)
class Field:
    """One field of a topic; length 0: a scalar, otherwise an array. Its type is in `TYPES`, or a topic."""

    type: str
    name: str
    length: int


def _fields(declaration: str) -> tuple[Field, ...]:
    fields: list[Field] = []
    for field_text in declaration.split(";"):
        type_text, _, name = field_text.strip().partition(" ")
        type_name, _, length = type_text.rstrip("]").partition("[")
        fields.append(Field(type_name, name, int(length or 0)))
    return tuple(fields)


def _read_fields() -> dict[str, tuple[Field, ...]]:
    lines = (Path(__file__).parent.parent / "data/topics.txt").read_text(encoding="utf-8").splitlines()
    return {name: _fields(declaration) for name, _, declaration in (line.partition(":") for line in lines)}


FIELDS = _read_fields()
"""Fields of each topic, in PX4's order; a line of the file is the format of a topic as in a ULog. A name
with a version of PX4, as `battery_status 1.17`, is for that version, and one without for all others."""


def nested(fields: Sequence[Field]) -> list[str]:
    """The types of these fields that are topics themselves."""
    return list(dict.fromkeys(field.type for field in fields if field.type not in TYPES))


def _flat(fields: Sequence[Field], prefix: str = "") -> Iterator[Field]:
    """The fields, with those of nested types in their place: `current.lat`."""
    for field in fields:
        if field.type in TYPES:
            yield Field(field.type, f"{prefix}{field.name}", field.length)
        else:
            yield from _flat(FIELDS[field.type], f"{prefix}{field.name}.")


class TopicLayout:
    """Layout of one topic; `pack` and `blank` create the data messages of a log (ULog type D).

    Args:
        name: name of the topic; its fields are in `data/topics.txt`.
        msg_id: id of the topic in the log file.
        version: version of PX4, as "1.17".
        multi_id: instance of the topic.
    """

    def __init__(self, name: str, msg_id: int, version: str, multi_id: int = 0) -> None:
        self.name = name
        self.msg_id = msg_id
        self.multi_id = multi_id
        self.declared = FIELDS.get(f"{name} {version}", FIELDS[name])
        """Fields with nested types."""
        self.fields = tuple(_flat(self.declared))
        struct_codes = [f"{field.length or ''}{TYPES[field.type][0]}" for field in self.fields]
        self._struct = struct.Struct("<" + "".join(struct_codes))
        self._header = _DATA_HEADER.pack(self._struct.size + 2, ord("D"), msg_id)

    @cached_property
    def dtype(self) -> np.dtype[Any]:
        """NumPy type of a data message, with its header."""
        columns: list[Any] = [("message_size", "<u2"), ("message_type", "u1"), ("message_id", "<u2")]
        for field in self.fields:
            code = TYPES[field.type][1]
            columns.append((field.name, code, (field.length,)) if field.length else (field.name, code))
        return np.dtype(columns)

    def blank(self) -> np.ndarray[Any, np.dtype[Any]]:
        """A data message whose fields are zero."""
        record = np.zeros((), dtype=self.dtype)
        record["message_size"] = self._struct.size + 2
        record["message_type"] = ord("D")
        record["message_id"] = self.msg_id
        return record

    def pack(self, values: Sequence[Any]) -> bytes:
        """Packs one data message; `values` are in the order of the fields, with arrays flattened."""
        return self._header + self._struct.pack(*values)
