"""What the vehicle's metadata says of its parameters: unit, range, choices; and whether a value keeps to it.

Format: MAVLink's parameter metadata schema, version 1.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass

import msgspec

from gcs_server.errors import InvalidRequest

FORCE = 'Send "force": true to set it all the same.'


@dataclass(frozen=True, slots=True)
class Choice:
    """One value, or one bit, that has a name."""

    value: int | float
    """The value; of a bit mask, the bit's number."""
    label: str
    """As the metadata calls it."""


@dataclass(frozen=True, slots=True)
class ParamFacts:
    """One parameter."""

    name: str
    """As on the wire."""
    is_integer: bool
    """Whole number of 32 bits, else a 32-bit float."""
    group: str
    """What it belongs to."""
    category: str
    """Standard, Developer or System."""
    title: str | None = None
    """What it is, in short."""
    details: str | None = None
    """What it is, at length."""
    default: int | float | None = None
    """The firmware's; null: none is told."""
    min: int | float | None = None
    """Least sensible value."""
    max: int | float | None = None
    """Greatest sensible value."""
    unit: str | None = None
    """As the metadata writes it."""
    decimals: int | None = None
    """How many are worth showing."""
    increment: float | None = None
    """A sensible step."""
    choices: tuple[Choice, ...] = ()
    """Where only these are meant."""
    bits: tuple[Choice, ...] = ()
    """Where it is a bit mask."""
    reboot_required: bool = False
    """Whether a change takes effect only after a restart."""
    volatile: bool = False
    """Whether the vehicle changes it by itself."""

    def check(self, value: float) -> None:
        """Whether a value keeps to range and choices.

        Raises:
            InvalidRequest: naming the range, or the choices.
        """
        if self.choices:
            if not any(_same(value, choice.value) for choice in self.choices):
                known = ", ".join(f"{c.value:g} ({c.label})" for c in self.choices)
                raise InvalidRequest("value", f"{self.name} is one of {known}; not {value:g}.", remedy=FORCE)
            return
        if self.bits:
            known_bits = sum(1 << int(bit.value) for bit in self.bits)
            if value < 0 or int(value) & ~known_bits:
                names = ", ".join(f"{1 << int(b.value)} ({b.label})" for b in self.bits)
                raise InvalidRequest(
                    "value", f"{self.name} is a sum of {names}; not {value:g}.", remedy=FORCE
                )
            return
        too_low = self.min is not None and value < self.min and not _same(value, self.min)
        too_high = self.max is not None and value > self.max and not _same(value, self.max)
        if too_low or too_high:
            raise InvalidRequest(
                "value", f"{self.name} is meant to be {self.range_words()}, not {value:g}.", remedy=FORCE
            )

    def range_words(self) -> str:
        """The range for people."""
        unit = f" {self.unit}" if self.unit else ""
        if self.min is None:
            return f"at most {self.max:g}{unit}"
        if self.max is None:
            return f"at least {self.min:g}{unit}"
        return f"from {self.min:g} to {self.max:g}{unit}"


Facts = Mapping[str, ParamFacts]


class _Value(msgspec.Struct):
    value: float | int
    description: str = ""


class _Bit(msgspec.Struct):
    index: int
    description: str = ""


class _Entry(msgspec.Struct, rename="camel"):
    name: str
    type: str
    group: str = ""
    category: str = "Standard"
    short_desc: str | None = None
    long_desc: str | None = None
    default: float | int | None = None
    min: float | int | None = None
    max: float | int | None = None
    units: str | None = None
    decimal_places: int | None = None
    increment: float | None = None
    values: list[_Value] = []
    bitmask: list[_Bit] = []
    reboot_required: bool = False
    volatile: bool = False


class _Document(msgspec.Struct):
    version: int
    parameters: list[_Entry]


_document = msgspec.json.Decoder(_Document)


def parse(content: bytes) -> dict[str, ParamFacts]:
    """Reads the metadata document; by name.

    Raises:
        ValueError: not a document of a version that we know.
    """
    document = _document.decode(content)  # msgspec's errors are ValueErrors
    if document.version != 1:
        raise ValueError(f"a parameter document of version {document.version}; version 1 is known")
    return {entry.name: _facts(entry) for entry in document.parameters}


def _facts(entry: _Entry) -> ParamFacts:
    return ParamFacts(
        name=entry.name,
        is_integer=entry.type != "Float",
        group=entry.group,
        category=entry.category,
        title=entry.short_desc,
        details=entry.long_desc,
        default=entry.default,
        min=entry.min,
        max=entry.max,
        unit=None if entry.units in (None, "", "norm") else entry.units,
        decimals=entry.decimal_places,
        increment=entry.increment,
        choices=tuple(Choice(v.value, v.description) for v in entry.values),
        bits=tuple(Choice(b.index, b.description) for b in entry.bitmask),
        reboot_required=entry.reboot_required,
        volatile=entry.volatile,
    )


def is_default(facts: ParamFacts, value: float) -> bool | None:
    """Whether a value is the firmware's; None where that is not told."""
    return None if facts.default is None else _same(value, facts.default)


def _same(a: float, b: float) -> bool:
    """As the vehicle holds them: 32 bits."""
    if a == b:
        return True
    try:
        return struct.pack("<f", a) == struct.pack("<f", b)
    except OverflowError:
        return False
