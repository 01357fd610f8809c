"""What the vehicle's metadata says of a parameter: unit, range, choices; whether a value keeps to it."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass

from gcs_server.errors import InvalidRequest
from gcs_server.vehicle.foreign import Document, cut

MOST_NAMED, LONGEST_NAMED = 20, 60
"""Choices that a refusal names, and characters of each."""
FORCE = 'Send "force": true to set it anyway.'


@dataclass(frozen=True, slots=True)
class Choice:
    """One value, or one bit, that has a name."""

    value: int | float
    """The value; of a bit mask, the bit's number."""
    label: str
    """Label in the metadata."""


@dataclass(frozen=True, slots=True)
class ParamFacts:
    """One parameter."""

    name: str
    """As on the wire."""
    is_integer: bool
    """Whole number of 32 bits, else a 32-bit float."""
    group: str
    """Group in the metadata."""
    category: str
    """Standard, Developer or System."""
    title: str | None = None
    """Short description."""
    details: str | None = None
    """Long description."""
    default: int | float | None = None
    """The firmware's; null: none is told."""
    min: int | float | None = None
    """Least sensible value."""
    max: int | float | None = None
    """Greatest sensible value."""
    unit: str | None = None
    """As the metadata writes it."""
    decimals: int | None = None
    """Number of decimals to show."""
    increment: float | None = None
    """A sensible step."""
    choices: tuple[Choice, ...] = ()
    """The documented values, if only these are valid."""
    bits: tuple[Choice, ...] = ()
    """The documented bits, if it is a bit mask."""
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
                known = _named((c.value, c.label) for c in self.choices)
                raise InvalidRequest("value", f"{self.name} is one of {known}; not {value:g}.", remedy=FORCE)
            return
        if self.bits:
            known_bits = 0
            for bit in self.bits:
                known_bits |= 1 << int(bit.value)
            if value < 0 or value != int(value) or int(value) & ~known_bits:
                names = _named((1 << int(b.value), b.label) for b in self.bits)
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


Facts = Document[str, ParamFacts]


def _named(choices: Iterable[tuple[float, str]]) -> str:
    words = [f"{value:g} ({cut(label, LONGEST_NAMED)})" for value, label in choices]
    more = len(words) - MOST_NAMED
    return ", ".join(words[:MOST_NAMED]) + (f" and {more} more" if more > 0 else "")


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
