"""Encodes the messages of PX4's log format ULog, version 1, independent of the logged content.

The format is described at docs.px4.io, "ULog File Format": little-endian, fields packed in the order of their
declaration.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

from vehicle_sim.topics.layout import FIELDS, TYPES, Field, TopicLayout, nested

MAGIC = b"ULog\x01\x12\x35"
VERSION = 1
_MESSAGE_HEADER = struct.Struct("<HB")
NO_INCOMPATIBLE_FLAGS = bytes(8)
DEFAULTS_FLAG = b"\x01" + bytes(7)
"""Incompatible and compatible flags of the flag message; DEFAULTS_FLAG: the log contains default values."""
SYSTEM_DEFAULT, AIRFRAME_DEFAULT = 1, 2
"""Bits for the sources of a default value: firmware and airframe."""


def message(letter: str, body: bytes) -> bytes:
    """A message; `letter` is the type of the message."""
    return _MESSAGE_HEADER.pack(len(body), ord(letter)) + body


def header(start_us: int) -> bytes:
    """The file header; the start time is the time since boot."""
    return MAGIC + bytes((VERSION,)) + struct.pack("<Q", start_us)


def flag_bits() -> bytes:
    """The flag message: the file contains default values and no appended data."""
    return message("B", DEFAULTS_FLAG + NO_INCOMPATIBLE_FLAGS + bytes(24))


def _key_value(key: str, value: bytes) -> bytes:
    encoded_key = key.encode("ascii")
    return bytes((len(encoded_key),)) + encoded_key + value


def info(name: str, value: str | int, number_type: str = "uint32_t") -> bytes:
    """An information message about the log: a text, or a number of the given type."""
    if isinstance(value, str):
        text = value.encode("utf-8")
        return message("I", _key_value(f"char[{len(text)}] {name}", text))
    return message("I", _key_value(f"{number_type} {name}", struct.pack("<" + TYPES[number_type][0], value)))


def _parameter_body(name: str, value: float, *, integer: bool) -> bytes:
    number_type = "int32_t" if integer else "float"
    number = struct.pack("<" + TYPES[number_type][0], int(value) if integer else value)
    return _key_value(f"{number_type} {name}", number)


def parameter(name: str, value: float, *, integer: bool) -> bytes:
    """A parameter message; initial values belong to the definitions section, changed values to the data
    section."""
    return message("P", _parameter_body(name, value, integer=integer))


def default_parameter(name: str, value: float, *, integer: bool, sources: int) -> bytes:
    """The default value of a parameter; `sources` are bits, for example AIRFRAME_DEFAULT."""
    return message("Q", bytes((sources,)) + _parameter_body(name, value, integer=integer))


def logged_text(severity: int, time_us: int, text: str) -> bytes:
    """A logged text; severity is MAV_SEVERITY."""
    return message("L", struct.pack("<BQ", ord("0") + severity, time_us) + text.encode("utf-8"))


def topic_format(layout: TopicLayout) -> bytes:
    """The format messages: names and types of a topic's fields, and those of its nested types."""
    own = _format(layout.name, layout.declared)
    return own + b"".join(_format(name, FIELDS[name]) for name in nested(layout.declared))


def _format(name: str, fields: Sequence[Field]) -> bytes:
    declarations = "".join(f"{f.type}{f'[{f.length}]' if f.length else ''} {f.name};" for f in fields)
    return message("F", f"{name}:{declarations}".encode("ascii"))


def subscription(layout: TopicLayout) -> bytes:
    """The subscription message: the id that the topic's data messages carry."""
    return message("A", struct.pack("<BH", layout.multi_id, layout.msg_id) + layout.name.encode("ascii"))
