"""PX4's message types for Cyclone DDS. Samples contain packed bytes; `ros2.messages` packs and unpacks them.

Cyclone's own Python encoder would be too slow: it takes 30 µs to 300 µs for each of up to 900 messages per
second and vehicle.
"""

from __future__ import annotations

from functools import cache
from typing import Any, Self

from cyclonedds.idl import IdlStruct, make_idl_struct
from cyclonedds.idl import types as idl

from vehicle_sim.ros2.messages import CODES, Field, MessageType

_PRIMITIVES: dict[str, Any] = {
    "bool": bool, "char": idl.uint8, "int8": idl.int8, "uint8": idl.uint8, "int16": idl.int16,
    "uint16": idl.uint16, "int32": idl.int32, "uint32": idl.uint32, "int64": idl.int64,
    "uint64": idl.uint64, "float32": idl.float32, "float64": idl.float64,
}  # fmt: skip


class Sample(IdlStruct):
    """A sample as serialized bytes (CDR); `idl_type` creates a subclass for each message type."""

    cdr = b""
    """The bytes with encapsulation header. This attribute has no annotation, because Cyclone treats annotated
    attributes as fields."""

    def serialize(self, *_: Any, **__: Any) -> bytes:
        """The bytes that Cyclone sends."""
        return self.cdr

    @classmethod
    def deserialize(cls, data: bytes, *_: Any, **__: Any) -> Self:
        """A sample with the bytes that Cyclone received, which are not checked."""
        return cls.from_bytes(bytes(data))

    @classmethod
    def deserialize_key(cls, data: bytes, *_: Any, **__: Any) -> Self:
        """Called by Cyclone when a writer has ended; these types have no keys."""
        return cls.from_bytes(b"")

    @classmethod
    def from_bytes(cls, cdr: bytes) -> Self:
        """A sample with these bytes."""
        sample = cls()
        sample.cdr = cdr
        return sample


def _idl_field(message: MessageType, field: Field) -> Any:
    single = _PRIMITIVES[field.type] if field.type in CODES else idl_dataclass(message.nested[field.type])
    return idl.array[single, field.length] if field.length else single


@cache
def idl_dataclass(message: MessageType) -> type[IdlStruct]:
    """The type with Cyclone's own encoder: for nested types, and for comparison in tests."""
    fields = {field.name: _idl_field(message, field) for field in message.fields}
    return make_idl_struct(message.name, f"px4_msgs.msg.dds_.{message.name}_", fields)


@cache
def idl_type(message: MessageType, typename: str = "") -> type[Sample]:
    """The type of a topic; `typename` replaces its DDS type name (for services)."""
    fields = {field.name: _idl_field(message, field) for field in message.fields}
    sample_type: Any = make_idl_struct(
        message.name, typename or f"px4_msgs.msg.dds_.{message.name}_", fields, dataclassify=False,
        bases=(Sample,),
    )  # fmt: skip
    return sample_type
