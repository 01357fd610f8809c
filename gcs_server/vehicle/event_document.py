"""Reads the metadata document of a vehicle's events, entry by entry, within limits.

Format: MAVLink's events metadata schema, version 2. Messages contain `{2}`, `{3:.1}`, `{3:.1m/s}`, tags such
as `<param>NAME</param>` and `<profile name="dev">…</profile>`, and backslashes before literal characters.
Each message is split once, so that the time to fill in values is proportional to the length of the message.
"""

from __future__ import annotations

import re
from typing import Annotated

import msgspec

from gcs_server.vehicle.event_definitions import Argument, Definition, Slot, Template
from gcs_server.vehicle.metadata_limits import Document, OmittedEntries, cut

TYPES: dict[str, str] = {
    "uint8_t": "B", "int8_t": "b", "uint16_t": "H", "int16_t": "h", "uint32_t": "I", "int32_t": "i",
    "uint64_t": "Q", "int64_t": "q", "float": "f",
}  # fmt: skip
MAX_COMPONENTS, MAX_EVENTS, MAX_ENUMS, MAX_ENUM_ENTRIES = 16, 5_000, 1_000, 256
"""Maximum numbers; PX4 v1.16 has 2, 370, 16 and 31."""
MAX_ARGUMENTS = 40
"""An event has 40 bytes of arguments."""
MAX_SLOTS = 40
MAX_MESSAGE_LENGTH, MAX_DESCRIPTION_LENGTH, MAX_LABEL_LENGTH, MAX_NAME_LENGTH = 500, 2_000, 120, 80
"""Maximum lengths [characters]; PX4's longest texts have 117, 372, 60 and 50."""
MAX_ID = 0xFFFFFF
MAX_DECIMALS = 9

_token = re.compile(
    r"\\(?P<literal>.)"
    r"|</?(?:a|param|profile)\b[^<>]{0,200}>"
    r"|\{(?P<number>\d{1,3})(?::\.(?P<decimals>\d{1,3}))?(?P<unit>m_v|m\^2|m/s|m|C)?\}",
    re.DOTALL,
)
_blank = re.compile(r"\s+")


class _EnumEntry(msgspec.Struct):
    name: str = ""
    description: str | None = None


class _Enum(msgspec.Struct):
    type: str
    entries: Annotated[dict[str, _EnumEntry], msgspec.Meta(max_length=MAX_ENUM_ENTRIES)]
    is_bitfield: bool = False


class _Argument(msgspec.Struct):
    type: str
    name: str = ""


class _Event(msgspec.Struct):
    name: str
    message: str | None = None
    description: str | None = None
    arguments: Annotated[list[_Argument], msgspec.Meta(max_length=MAX_ARGUMENTS)] = []


class _Group(msgspec.Struct):
    events: dict[str, msgspec.Raw] = {}


class _Component(msgspec.Struct):
    namespace: str = ""
    enums: dict[str, msgspec.Raw] = {}
    event_groups: dict[str, msgspec.Raw] = {}


class _Document(msgspec.Struct):
    version: int
    components: dict[str, msgspec.Raw] = {}


class _EnumTable(msgspec.Struct, frozen=True):
    """A decoded enum."""

    format: str
    labels: dict[int, str]
    is_bitfield: bool


_document = msgspec.json.Decoder(_Document)
_component = msgspec.json.Decoder(_Component)
_group = msgspec.json.Decoder(_Group)
_event = msgspec.json.Decoder(_Event)
_enum = msgspec.json.Decoder(_Enum)


def parse(content: bytes | str) -> Document[int, Definition]:
    """Reads the metadata document. Keys: the event's id with the namespace's component in its top byte.

    Raises:
        ValueError: the content is not an events document, or its version is not supported.
    """
    document = _document.decode(content)
    if document.version != 2:
        raise ValueError(f"events document version {document.version} is not supported, only version 2")
    return _Reader().read(document)


class _Reader:
    def __init__(self) -> None:
        self._omitted = OmittedEntries("entry", "entries")
        self._enums: dict[str, _EnumTable] = {}
        self._definitions: dict[int, Definition] = {}

    def read(self, document: _Document) -> Document[int, Definition]:
        components: list[tuple[int, _Component]] = []
        for number, raw in list(document.components.items())[:MAX_COMPONENTS]:
            try:
                components.append((_number(number, 255), _component.decode(raw)))
            except (ValueError, RecursionError) as error:
                self._omitted.add(f"component {number}", error)
        self._count_omitted(len(document.components) - MAX_COMPONENTS, "components")
        for _, component in components:
            self._read_enums(component)
        for number, component in components:
            self._read_groups(number, component)
        return Document(self._definitions, self._omitted.text())

    def _read_enums(self, component: _Component) -> None:
        for name, raw in component.enums.items():
            if len(self._enums) >= MAX_ENUMS:
                self._count_omitted(1, "enums")
                continue
            try:
                enum = _enum.decode(raw)
                labels = {
                    _number(v, 2**63): cut(e.description or e.name, MAX_LABEL_LENGTH)
                    for v, e in enum.entries.items()
                }
                table = _EnumTable(TYPES[enum.type], dict(sorted(labels.items())), enum.is_bitfield)
            except (ValueError, KeyError, RecursionError) as error:
                self._omitted.add(f"enum {name}", error)
                continue
            self._enums[f"{component.namespace}::{name}"] = table

    def _read_groups(self, number: int, component: _Component) -> None:
        for name, raw in component.event_groups.items():
            try:
                group = _group.decode(raw)
            except (ValueError, RecursionError) as error:
                self._omitted.add(f"group {name}", error)
                continue
            for event_id, event in group.events.items():
                if len(self._definitions) >= MAX_EVENTS:
                    self._count_omitted(1, "events")
                    continue
                try:
                    self._definitions[number << 24 | _number(event_id, MAX_ID)] = self._definition(
                        event, name, component.namespace
                    )
                except (ValueError, RecursionError) as error:
                    self._omitted.add(f"event {event_id}", error)

    def _definition(self, raw: msgspec.Raw, group: str, namespace: str) -> Definition:
        event = _event.decode(raw)
        arguments: list[Argument] = []
        for each in event.arguments:
            argument = self._argument(each, namespace)
            if argument is None:  # after an unknown type, the offsets of further arguments are unknown
                break
            arguments.append(argument)
        name = cut(event.name, MAX_NAME_LENGTH)
        return Definition(
            name=name,
            group=cut(group, MAX_NAME_LENGTH),
            message=parse_template(name if event.message is None else event.message, MAX_MESSAGE_LENGTH),
            description=parse_template(event.description, MAX_DESCRIPTION_LENGTH)
            if event.description
            else None,
            arguments=tuple(arguments),
        )

    def _argument(self, argument: _Argument, namespace: str) -> Argument | None:
        kind, name = argument.type, cut(argument.name, MAX_NAME_LENGTH)
        if kind in TYPES:
            return Argument(name, TYPES[kind])
        for full_name in (kind, f"{namespace}::{kind}", f"common::{kind}"):
            if full_name in self._enums:
                table = self._enums[full_name]
                return Argument(name, table.format, table.labels, table.is_bitfield)
        return None

    def _count_omitted(self, count: int, entries: str) -> None:
        if count > 0:
            self._omitted.add(f"more {entries}", "there are too many", count)


def parse_template(text: str, max_length: int) -> Template:
    """Splits a message into texts and placeholders.

    Args:
        text: text in the document.
        max_length: maximum number of characters to read.
    """
    text = cut(text, max_length)
    pieces: list[str | Slot] = []
    slots = position = 0
    for match in _token.finditer(text):
        _add(pieces, text[position : match.start()])
        position = match.end()
        if match["literal"] is not None:
            _add(pieces, "\n" if match["literal"] == "n" else match["literal"])
        elif match["number"] is not None and slots < MAX_SLOTS:
            slots += 1
            decimals = None if match["decimals"] is None else min(int(match["decimals"]), MAX_DECIMALS)
            pieces.append(Slot(int(match["number"]) - 1, decimals, match["unit"]))
    _add(pieces, text[position:])
    return Template(tuple(_one_line(p) if isinstance(p, str) else p for p in pieces))


def _add(pieces: list[str | Slot], text: str) -> None:
    last = pieces[-1] if pieces else None
    if isinstance(last, str):
        pieces[-1] = last + text
    elif text:
        pieces.append(text)


def _one_line(text: str) -> str:
    return _blank.sub(lambda blank: " " if "\n" in blank[0] else blank[0], text)


def _number(text: str, max_value: int) -> int:
    """A number from a text; raises ValueError if it is not a number up to `max_value`."""
    if not (text.isascii() and text.isdigit() and len(text) <= 20 and int(text) <= max_value):
        raise ValueError(f"{cut(text, 30)!r} is not a number up to {max_value}")
    return int(text)
