"""Metadata of a parameter (unit, range, choices), and the check of a value against it."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass

from gcs_server.errors import InvalidRequest
from gcs_server.vehicle.metadata_limits import Document, cut

MAX_CHOICES_SHOWN, MAX_CHOICE_LENGTH = 20, 60
"""Maximum number of choices in an error text, and maximum length of a choice [characters]."""
FORCE = 'Send "force": true to set it anyway.'


@dataclass(frozen=True, slots=True)
class Choice:
    """A value or a bit with a name."""

    value: int | float
    """The value; for a bit mask, the number of the bit."""
    label: str
    """Label in the metadata."""


@dataclass(frozen=True, slots=True)
class ParamMetadata:
    """One parameter."""

    name: str
    """Name as in MAVLink."""
    is_integer: bool
    """Whether the parameter is a 32-bit integer; otherwise it is a 32-bit float."""
    group: str
    """Group in the metadata."""
    category: str
    """Standard, Developer or System."""
    title: str | None = None
    """Short description."""
    details: str | None = None
    """Long description."""
    default: int | float | None = None
    """Default of the firmware; null if unknown."""
    min: int | float | None = None
    """Smallest recommended value."""
    max: int | float | None = None
    """Largest recommended value."""
    unit: str | None = None
    """Unit, as in the metadata."""
    decimals: int | None = None
    """Number of decimals to show."""
    increment: float | None = None
    """Recommended step."""
    choices: tuple[Choice, ...] = ()
    """The documented values, if only these are valid."""
    bits: tuple[Choice, ...] = ()
    """The documented bits, if the parameter is a bit mask."""
    reboot_required: bool = False
    """Whether a change takes effect only after a restart."""
    volatile: bool = False
    """Whether the vehicle changes the parameter by itself."""

    def check(self, value: float) -> None:
        """Checks a value against range and choices.

        Raises:
            InvalidRequest: the value does not fit; the error contains the range or the choices.
        """
        if self.choices:
            if not any(_is_equal(value, choice.value) for choice in self.choices):
                choices_text = _choices_text((c.value, c.label) for c in self.choices)
                raise InvalidRequest(
                    "value", f"{self.name} must be one of {choices_text}; not {value:g}.", remedy=FORCE
                )
            return
        if self.bits:
            known_bits = 0
            for bit in self.bits:
                known_bits |= 1 << int(bit.value)
            if value < 0 or value != int(value) or int(value) & ~known_bits:
                names = _choices_text((1 << int(b.value), b.label) for b in self.bits)
                raise InvalidRequest(
                    "value", f"{self.name} must be a sum of {names}; not {value:g}.", remedy=FORCE
                )
            return
        too_low = self.min is not None and value < self.min and not _is_equal(value, self.min)
        too_high = self.max is not None and value > self.max and not _is_equal(value, self.max)
        if too_low or too_high:
            raise InvalidRequest(
                "value", f"{self.name} must be {self.range_text()}, not {value:g}.", remedy=FORCE
            )

    def range_text(self) -> str:
        """The range as text."""
        unit = f" {self.unit}" if self.unit else ""
        if self.min is None:
            return f"at most {self.max:g}{unit}"
        if self.max is None:
            return f"at least {self.min:g}{unit}"
        return f"from {self.min:g} to {self.max:g}{unit}"


MetadataByName = Document[str, ParamMetadata]


def _choices_text(choices: Iterable[tuple[float, str]]) -> str:
    texts = [f"{value:g} ({cut(label, MAX_CHOICE_LENGTH)})" for value, label in choices]
    more = len(texts) - MAX_CHOICES_SHOWN
    return ", ".join(texts[:MAX_CHOICES_SHOWN]) + (f" and {more} more" if more > 0 else "")


def is_default(metadata: ParamMetadata, value: float) -> bool | None:
    """Whether a value is the firmware's default; None if the default is unknown."""
    return None if metadata.default is None else _is_equal(value, metadata.default)


def _is_equal(a: float, b: float) -> bool:
    """Compares with the 32-bit precision in which the vehicle stores values."""
    if a == b:
        return True
    try:
        return struct.pack("<f", a) == struct.pack("<f", b)
    except OverflowError:
        return False
