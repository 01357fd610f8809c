"""PX4's message types for Cyclone DDS. Cyclone sends and receives samples as bytes; `message_types.py`
encodes and decodes the bytes, because Cyclone's own Python encoder takes 30 to 300 µs for a message."""

from __future__ import annotations

import threading
from functools import cache
from typing import Any, Self

from cyclonedds.idl import IdlStruct, make_idl_struct
from cyclonedds.idl import types as idl

from gcs_server.ros2.message_types import CODES, MessageType

_PRIMITIVES: dict[str, Any] = {
    "bool": bool, "char": idl.uint8, "int8": idl.int8, "uint8": idl.uint8, "int16": idl.int16,
    "uint16": idl.uint16,
    "int32": idl.int32, "uint32": idl.uint32, "int64": idl.int64, "uint64": idl.uint64,
    "float32": idl.float32, "float64": idl.float64,
}  # fmt: skip


class Sample(IdlStruct):
    """A sample as its bytes on the wire; `idl_type` creates a subclass for each type."""

    cdr = b""
    """The bytes with the encapsulation header. The attribute has no annotation, because Cyclone treats
    annotations as fields."""

    def serialize(self, *_: Any, **__: Any) -> bytes:
        """The bytes that Cyclone sends."""
        return self.cdr

    @classmethod
    def deserialize(cls, data: bytes, *_: Any, **__: Any) -> Self:
        """A sample with the bytes that Cyclone received, unchecked."""
        return cls.from_cdr(bytes(data))

    @classmethod
    def deserialize_key(cls, data: bytes, *_: Any, **__: Any) -> Self:
        """Called by Cyclone when a writer has ended; these types have no keys."""
        return cls.from_cdr(b"")

    @classmethod
    def from_cdr(cls, cdr: bytes) -> Self:
        """A sample with these bytes."""
        sample = cls()
        sample.cdr = cdr
        return sample


def _fields(message: MessageType) -> dict[str, Any]:
    fields: dict[str, Any] = {}
    for field in message.fields:
        element = _PRIMITIVES[field.type] if field.type in CODES else _nested(message.nested[field.type])
        fields[field.name] = idl.array[element, field.length] if field.length else element
    return fields


def _type_name(message: MessageType) -> str:
    return f"px4_msgs.msg.dds_.{message.name}_"


@cache
def _nested(message: MessageType) -> type[IdlStruct]:
    return make_idl_struct(message.name, _type_name(message), _fields(message))


@cache
def _sample_class(message: MessageType) -> type[Sample]:
    sample_class: Any = make_idl_struct(
        message.name, _type_name(message), _fields(message), dataclassify=False, bases=(Sample,)
    )  # fmt: skip
    sample_class.__idl__.fill_type_data()
    return sample_class


_lock = threading.Lock()
"""Held while a type is created and described: links have their own threads, and if a second thread uses a
type that Cyclone still describes, Cyclone refuses the topic."""


def idl_type(message: MessageType) -> type[Sample]:
    """The sample class for topics of this message type. Any thread may call it."""
    with _lock:
        return _sample_class(message)
