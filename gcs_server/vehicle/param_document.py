"""Reads the metadata document of a vehicle's parameters, entry by entry, within limits.

Format: MAVLink's parameter metadata schema, version 1. An entry that does not conform to the schema is
omitted, and the reason is recorded. Long texts are shortened.
"""

from __future__ import annotations

from typing import Annotated

import msgspec

from gcs_server.vehicle.metadata_limits import Document, OmittedEntries, cut
from gcs_server.vehicle.param_metadata import Choice, ParamMetadata

MAX_PARAMETERS = 5_000
"""Maximum number of entries; PX4 v1.16 has 1,821."""
MAX_LABEL_LENGTH, MAX_WORD_LENGTH, MAX_TITLE_LENGTH, MAX_DETAILS_LENGTH = 300, 60, 300, 3_000
"""Maximum lengths [characters]; PX4's longest texts have 258, 35, 132 and 968."""
MAX_MAGNITUDE = 3.5e38
"""Larger than every 32-bit float."""

_Number = (
    Annotated[int, msgspec.Meta(ge=-(2**32), le=2**32)]
    | Annotated[float, msgspec.Meta(ge=-MAX_MAGNITUDE, le=MAX_MAGNITUDE)]
)


class _Value(msgspec.Struct):
    value: _Number
    description: str = ""


class _Bit(msgspec.Struct):
    index: Annotated[int, msgspec.Meta(ge=0, le=31)]
    description: str = ""


class _Entry(msgspec.Struct, rename="camel"):
    name: Annotated[str, msgspec.Meta(pattern="^[A-Za-z0-9_.-]{1,16}$")]
    type: str
    group: str = ""
    category: str = "Standard"
    short_desc: str | None = None
    long_desc: str | None = None
    default: _Number | None = None
    min: _Number | None = None
    max: _Number | None = None
    units: str | None = None
    decimal_places: Annotated[int, msgspec.Meta(ge=0, le=15)] | None = None
    increment: Annotated[float, msgspec.Meta(ge=0, le=MAX_MAGNITUDE)] | None = None
    values: Annotated[list[_Value], msgspec.Meta(max_length=256)] = []
    bitmask: Annotated[list[_Bit], msgspec.Meta(max_length=32)] = []
    reboot_required: bool = False
    volatile: bool = False


class _Name(msgspec.Struct):
    name: str = "an entry without a name"


class _Document(msgspec.Struct):
    version: int
    parameters: list[msgspec.Raw]


_document = msgspec.json.Decoder(_Document)
_entry = msgspec.json.Decoder(_Entry)
_name = msgspec.json.Decoder(_Name)


def parse(content: bytes) -> Document[str, ParamMetadata]:
    """Reads the metadata document; returns the parameters by name.

    Raises:
        ValueError: the content is not a parameter document, or its version is not supported.
    """
    document = _document.decode(content)  # msgspec's errors are ValueErrors
    if document.version != 1:
        raise ValueError(f"parameter document version {document.version} is not supported, only version 1")
    omitted = OmittedEntries("parameter", "parameters")
    parameters: dict[str, ParamMetadata] = {}
    for raw in document.parameters[:MAX_PARAMETERS]:
        try:
            entry = _entry.decode(raw)
        except (ValueError, RecursionError) as error:
            omitted.add(_name_of(raw), error)
            continue
        parameters[entry.name] = _metadata_of(entry)
    more = len(document.parameters) - MAX_PARAMETERS
    if more > 0:
        omitted.add("the rest", f"more than {MAX_PARAMETERS:,}", more)
    return Document(parameters, omitted.text())


def _name_of(raw: msgspec.Raw) -> str:
    try:
        return _name.decode(raw).name
    except (ValueError, RecursionError):
        return _Name().name


def _metadata_of(entry: _Entry) -> ParamMetadata:
    return ParamMetadata(
        name=entry.name,
        is_integer=entry.type != "Float",
        group=cut(entry.group, MAX_WORD_LENGTH),
        category=cut(entry.category, MAX_WORD_LENGTH),
        title=None if entry.short_desc is None else cut(entry.short_desc, MAX_TITLE_LENGTH),
        details=None if entry.long_desc is None else cut(entry.long_desc, MAX_DETAILS_LENGTH),
        default=entry.default,
        min=entry.min,
        max=entry.max,
        unit=None if entry.units in (None, "", "norm") else cut(entry.units, MAX_WORD_LENGTH),
        decimals=entry.decimal_places,
        increment=entry.increment,
        choices=tuple(Choice(v.value, cut(v.description, MAX_LABEL_LENGTH)) for v in entry.values),
        bits=tuple(Choice(b.index, cut(b.description, MAX_LABEL_LENGTH)) for b in entry.bitmask),
        reboot_required=entry.reboot_required,
        volatile=entry.volatile,
    )
