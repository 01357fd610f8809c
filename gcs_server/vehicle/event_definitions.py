"""Texts of events, from the vehicle's metadata and the values of an event.

`event_document.py` has already split each text into parts, which limits the work for one event.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass

from gcs_server.vehicle.metadata_limits import Document, cut

UNITS = {"m": " m", "m_v": " m", "m^2": " m²", "m/s": " m/s", "C": " °C"}
CHECK_GROUPS = ("arming_check", "health")
MAX_TEXT_LENGTH, MAX_VALUE_LENGTH = 1_000, 200
"""Maximum length of a message with its values, and of one value [characters]."""


@dataclass(frozen=True, slots=True)
class Slot:
    """A placeholder in a message."""

    index: int
    """Index of the event's argument, from 0."""
    decimals: int | None
    """Number of decimals to show; None: all."""
    unit: str | None
    """A key of `UNITS`."""


@dataclass(frozen=True, slots=True)
class Template:
    """A message, split into texts and placeholders."""

    pieces: tuple[str | Slot, ...]

    def fill(self, values: list[tuple[Argument, int | float]]) -> str:
        """The message with an event's values."""
        texts = (piece if isinstance(piece, str) else _value_at(piece, values) for piece in self.pieces)
        return cut("".join(texts).strip(), MAX_TEXT_LENGTH)


@dataclass(frozen=True, slots=True)
class Argument:
    """One value that an event carries."""

    name: str
    format: str
    """Format character for `struct`."""
    enum: Mapping[int, str] | None = None
    """Labels by value, in the order of their values."""
    is_bitfield: bool = False


@dataclass(frozen=True, slots=True)
class Definition:
    """The vehicle's definition of one kind of event."""

    name: str
    group: str
    message: Template
    description: Template | None
    arguments: tuple[Argument, ...]

    @property
    def is_check(self) -> bool:
        """Whether the event is a finding of the arming checks or of a component's health."""
        return self.group in CHECK_GROUPS

    def text(self, argument_bytes: bytes) -> str:
        """The message with this event's values."""
        return self.message.fill(self.values(argument_bytes))

    def remedy(self, argument_bytes: bytes) -> str | None:
        """The description, which contains the remedy; None: no description."""
        return self.description.fill(self.values(argument_bytes)) if self.description else None

    def values(self, argument_bytes: bytes) -> list[tuple[Argument, int | float]]:
        """Decodes the arguments of an EVENT, in order."""
        decoded: list[tuple[Argument, int | float]] = []
        offset = 0
        for argument in self.arguments:
            size = struct.calcsize(f"<{argument.format}")
            if offset + size > len(argument_bytes):
                break
            decoded.append((argument, struct.unpack_from(f"<{argument.format}", argument_bytes, offset)[0]))
            offset += size
        return decoded


Definitions = Document[int, Definition]
"""Keys: the event's id with the namespace's component in its top byte."""


def _value_at(slot: Slot, values: list[tuple[Argument, int | float]]) -> str:
    if not 0 <= slot.index < len(values):
        return "–"
    argument, value = values[slot.index]
    return cut(_formatted(argument, value, slot.decimals), MAX_VALUE_LENGTH) + UNITS.get(slot.unit or "", "")


def _formatted(argument: Argument, value: float, decimals: int | None) -> str:
    if argument.enum is not None:
        whole = int(value)
        if not argument.is_bitfield:
            return argument.enum.get(whole, str(whole))
        return ", ".join(label for bit, label in argument.enum.items() if whole & bit) or "none"
    if isinstance(value, float):
        return f"{value:.{decimals}f}" if decimals is not None else f"{value:.6g}"
    return str(value)
