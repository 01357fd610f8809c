"""The vehicle's own words for its events: its metadata, parsed, and filled with an event's arguments.

Format: MAVLink's events metadata schema, version 2. Messages hold `{2}`, `{3:.1}`, `{3:.1m/s}`, tags such as
`<param>NAME</param>` and `<profile name="dev">…</profile>`, and backslashes before what is meant literally.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

TYPES: dict[str, str] = {
    "uint8_t": "B", "int8_t": "b", "uint16_t": "H", "int16_t": "h", "uint32_t": "I", "int32_t": "i",
    "uint64_t": "Q", "int64_t": "q", "float": "f",
}  # fmt: skip
UNITS = {"m": " m", "m_v": " m", "m^2": " m²", "m/s": " m/s", "C": " °C"}
CHECK_GROUPS = ("arming_check", "health")

_argument = re.compile(r"\\(.)|\{(\d+)(?::\.(\d+))?(m_v|m\^2|m/s|m|C)?\}", re.DOTALL)
_tags = re.compile(r"</?(?:a|param|profile)\b[^>]*>")
_blank = re.compile(r"[ \t]*\n\s*")


@dataclass(frozen=True, slots=True)
class Argument:
    """One value that an event carries."""

    name: str
    format: str
    """For `struct`."""
    enum: Mapping[int, str] | None = None
    is_bitfield: bool = False


@dataclass(frozen=True, slots=True)
class Definition:
    """What the vehicle says of one kind of event."""

    name: str
    group: str
    message: str
    description: str | None
    arguments: tuple[Argument, ...]

    @property
    def is_check(self) -> bool:
        """Whether it is a finding of the arming checks or of a component's health."""
        return self.group in CHECK_GROUPS

    def text(self, arguments: bytes) -> str:
        """The message with this event's values."""
        return _filled(self.message, self.values(arguments))

    def remedy(self, arguments: bytes) -> str | None:
        """The description, which tells what to do; None where there is none."""
        return _filled(self.description, self.values(arguments)) if self.description else None

    def values(self, arguments: bytes) -> list[tuple[Argument, int | float]]:
        """As they lie in the message, one after the other."""
        read: list[tuple[Argument, int | float]] = []
        at = 0
        for each in self.arguments:
            size = struct.calcsize(f"<{each.format}")
            if at + size > len(arguments):
                break
            read.append((each, struct.unpack_from(f"<{each.format}", arguments, at)[0]))
            at += size
        return read


Definitions = Mapping[int, Definition]
"""By the event's id, the namespace's component in its top byte."""


def parse(content: bytes | str) -> Definitions:
    """Reads the metadata document.

    Raises:
        ValueError: not a document of a version that we know.
    """
    document: Any = json.loads(content)
    if not isinstance(document, dict) or document.get("version") != 2:
        raise ValueError("not an events document of version 2")
    components: Any = document.get("components") or {}
    enums: dict[str, Any] = {}
    for component in components.values():
        space = component.get("namespace", "")
        for name, enum in (component.get("enums") or {}).items():
            enums[f"{space}::{name}"] = enum
    found: dict[int, Definition] = {}
    for number, component in components.items():
        space = component.get("namespace", "")
        for group, content_of in (component.get("event_groups") or {}).items():
            for event_id, event in (content_of.get("events") or {}).items():
                arguments = [_read_argument(a, space, enums) for a in event.get("arguments") or ()]
                # an argument of a type that we do not know hides where those after it lie
                known = arguments[: arguments.index(None)] if None in arguments else arguments
                found[int(number) << 24 | int(event_id)] = Definition(
                    name=str(event["name"]),
                    group=str(group),
                    message=str(event.get("message", event["name"])),
                    description=event.get("description"),
                    arguments=tuple(a for a in known if a is not None),
                )
    return found


def _read_argument(argument: Any, space: str, enums: Mapping[str, Any]) -> Argument | None:
    name, kind = str(argument.get("name", "")), str(argument.get("type", ""))
    if kind in TYPES:
        return Argument(name, TYPES[kind])
    enum = enums.get(kind) or enums.get(f"{space}::{kind}") or enums.get(f"common::{kind}")
    if enum is None or enum.get("type") not in TYPES:
        return None
    labels = {int(v): str(e.get("description") or e.get("name")) for v, e in enum["entries"].items()}
    return Argument(name, TYPES[enum["type"]], labels, bool(enum.get("is_bitfield")))


def _filled(template: str, values: list[tuple[Argument, int | float]]) -> str:
    def one(match: re.Match[str]) -> str:
        literal, number, decimals, unit = match.groups()
        if literal is not None:
            return "\n" if literal == "n" else literal
        index = int(number) - 1
        if not 0 <= index < len(values):
            return "–"
        argument, value = values[index]
        return _spoken(argument, value, decimals) + UNITS.get(unit or "", "")

    plain = _tags.sub("", template.replace(r"\<", "\0"))
    return _blank.sub(" ", _argument.sub(one, plain)).replace("\0", "<").strip()


def _spoken(argument: Argument, value: float, decimals: str | None) -> str:
    if argument.enum is not None:
        whole = int(value)
        if not argument.is_bitfield:
            return argument.enum.get(whole, str(whole))
        return ", ".join(label for bit, label in sorted(argument.enum.items()) if whole & bit) or "none"
    if isinstance(value, float):
        return f"{value:.{int(decimals)}f}" if decimals is not None else f"{value:.6g}"
    return str(value)
