"""What the dialect says of its messages: fields, types, units, enumerations; messages from plain values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gcs_server.errors import InvalidRequest
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import Frame, full_payload
from gcs_server.mavlink.tables import LAYOUTS, NAMES, Layout

IDS: dict[str, int] = {name: msg_id for msg_id, name in NAMES.items()}
_RANGES = {f"{sign}int{bits}_t": (bits, sign == "u") for bits in (8, 16, 32, 64) for sign in ("", "u")}
_RANGES["uint8_t_mavlink_version"] = (8, True)
Value = float | int | str | None | list[float | int | None]


@dataclass(frozen=True, slots=True)
class EnumValue:
    """One value of an enumeration."""

    value: int
    """The number."""
    name: str
    """Its name in the dialect."""


@dataclass(frozen=True, slots=True)
class MessageField:
    """A field of a message."""

    name: str
    """Name in the dialect."""
    type: str
    """Type of the value, or of each element: `float`, `uint16_t`, `char`."""
    length: int
    """Number of elements of an array, or of characters of a text; 0: one value."""
    unit: str | None
    """Unit in the dialect."""
    enum: str | None
    """Enumeration of its values."""
    values: tuple[EnumValue, ...]
    """The values of the enumeration."""


@dataclass(frozen=True, slots=True)
class MessageDefinition:
    """A message of the dialect."""

    id: int
    """Number of the message."""
    name: str
    """Name of the message."""
    fields: tuple[MessageField, ...]
    """Its fields, in the dialect's order."""


def layout_of(name: str) -> Layout:
    """The layout of a message. Raises InvalidRequest."""
    msg_id = IDS.get(name)
    if msg_id is None:
        raise InvalidRequest(
            "message",
            f"The dialect has no message {name[:60]!r}.",
            remedy="GET /mavlink/messages lists them.",
        )
    return LAYOUTS[msg_id]


def definition(name: str) -> MessageDefinition:
    """What the dialect says of a message. Raises InvalidRequest: there is no such message."""
    layout = layout_of(name)
    return MessageDefinition(layout.msg_id, layout.name, tuple(_fields(layout)))


def _fields(layout: Layout) -> list[MessageField]:
    kind: Any = layout.message_class
    lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    units, enums = kind.fieldunits_by_name, kind.fieldenums_by_name
    return [
        MessageField(
            name, type_name, lengths[name], units.get(name), enums.get(name), _values(enums.get(name))
        )
        for name, type_name in zip(kind.fieldnames, kind.fieldtypes, strict=True)
    ]


def _values(enum: str | None) -> tuple[EnumValue, ...]:
    entries: dict[int, Any] = d.enums.get(enum, {}) if enum is not None else {}
    return tuple(
        EnumValue(number, entry.name)
        for number, entry in sorted(entries.items())
        if not entry.name.endswith("_ENUM_END")
    )


def instance_of(frame: Frame) -> int | None:
    """What a message is of, such as the number of a battery; None: the dialect names no such field."""
    layout = LAYOUTS.get(frame.msg_id)
    return None if layout is None else instance_in(layout, full_payload(frame))


def instance_in(layout: Layout, payload: bytes) -> int | None:
    """What the message with this payload in full length is of; None: the dialect names no such field."""
    offset: int = getattr(layout.message_class, "instance_offset", -1)
    named = layout.message_class.instance_field is not None and 0 <= offset < len(payload)
    return payload[offset] if named else None


def values_of(frame: Frame) -> dict[str, Value]:
    """The fields of a frame as they came, in the dialect's order; a number that is not finite is None, a text
    ends before its first zero byte."""
    layout = LAYOUTS[frame.msg_id]
    flat = layout.unpacker.unpack(full_payload(frame))
    values: dict[str, Value] = {}
    position = 0
    for name, length in zip(layout.fields, layout.lengths, strict=True):
        if length == 1:
            values[name] = _plain(flat[position])
        else:
            values[name] = [_plain(value) for value in flat[position : position + length]]
        position += length
    kind: Any = layout.message_class
    return {name: values[name] for name in kind.fieldnames}


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.split(b"\0")[0].decode("utf-8", "replace")
    return None if isinstance(value, float) and not math.isfinite(value) else value


def payload_of(name: str, values: Mapping[str, object]) -> bytes:
    """The payload of a message in full length; a field that is not given is 0 or empty.

    Args:
        name: name of the message.
        values: by field: a number, None for NaN in a field of floats, a list for an array (a shorter one is
            filled with zeros), a text for characters.

    Raises:
        InvalidRequest: names the wrong field, and what it may have.
    """
    layout = layout_of(name)
    fields = {field.name: field for field in _fields(layout)}
    for given in values:
        if given not in fields:
            raise InvalidRequest(
                f"fields.{given[:40]}",
                f"{name} has no such field.",
                remedy=f"Its fields are {', '.join(fields)}.",
            )
    flat: list[object] = []
    for field_name in layout.fields:
        field = fields[field_name]
        value = values.get(field_name)
        if field.type == "char":
            flat.append(_characters(field, "" if value is None else value))
        elif field.length:
            flat += _array(field, [] if value is None else value)
        else:
            flat.append(_number(field, value, field_name in values))
    return layout.unpacker.pack(*flat)


def _characters(field: MessageField, value: object) -> bytes:
    length = max(field.length, 1)
    if not isinstance(value, str) or not value.isascii() or len(value) > length or "\0" in value:
        raise _wrong(field, f"a text of at most {length} ASCII characters")
    return value.encode()


def _array(field: MessageField, value: object) -> list[object]:
    if not isinstance(value, list) or len(value) > field.length:
        raise _wrong(field, f"a list of at most {field.length} values")
    padded = [*value, *[0] * (field.length - len(value))]
    return [_number(field, each, True) for each in padded]


def _number(field: MessageField, value: object, given: bool) -> object:
    if field.type in ("float", "double"):
        if value is None:
            return math.nan if given else 0.0
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise _wrong(field, "a number, or null for NaN")
        if field.type == "float" and abs(value) > 3.4028234e38:
            raise _wrong(field, "a number that a float can have")
        return float(value)
    bits, unsigned = _RANGES[field.type]
    low, high = (0, 2**bits - 1) if unsigned else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    if value is None and not given:
        return 0
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise _wrong(field, f"a whole number from {low} to {high}")
    return value


def _wrong(field: MessageField, expected: str) -> InvalidRequest:
    return InvalidRequest(f"fields.{field.name}", f"{field.name} must be {expected}.")
