"""Compares wanted parameters with a vehicle's: what would change, and what is refused and why. Pure."""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from gcs_server.errors import InvalidRequest
from gcs_server.vehicle.param_metadata import ParamMetadata
from gcs_server.vehicle.param_table import Param

MAX_FLOAT32 = struct.unpack("<f", b"\xff\xff\x7f\x7f")[0]

INDIVIDUAL = re.compile(
    r"MAV_(SYS|COMP)_ID|UXRCE_DDS_(KEY|NS_IDX)|(CAL|TC)_\w+|SENS_BOARD_[XYZ]_OFF|COM_FLIGHT_UUID"
)
"""Names of parameters that belong to one vehicle: two vehicles with one number cannot both be commanded."""


@dataclass(frozen=True, slots=True)
class WantedParam:
    """A value that somebody wants a parameter to have."""

    name: str
    value: float | None
    """None: the value could not be read; `problem` says why."""
    is_integer: bool | None = None
    """The type that the source names; None: it names none."""
    line: int | None = None
    """Line of the file, from 1; None: not from a file."""
    problem: str | None = None


@dataclass(frozen=True, slots=True)
class ReviewRow:
    """One parameter of a review."""

    name: str
    line: int | None
    """Line of the file, from 1; null: not from a file."""
    state: Literal["change", "same", "refused"]
    """change: it would be written; same: the vehicle has this value; refused: see `problem`."""
    old: float | int | None
    """The vehicle's value; null if not known or not a number."""
    new: float | int | None
    """The wanted value; null if it could not be read."""
    old_label: str | None
    """Label of the vehicle's value in its metadata; null: it has none."""
    new_label: str | None
    unit: str | None
    title: str | None
    """Short description in the vehicle's metadata."""
    reboot_required: bool
    """Whether the change takes effect only after a restart."""
    volatile: bool
    """Whether the vehicle changes the parameter by itself, as a statistic or a calibration."""
    individual: bool
    """Whether it belongs to one vehicle, as its number or calibration, and is seldom meant for another."""
    problem: str | None
    """Why it is refused."""


def review_row(
    wanted: WantedParam, current: Param | None, metadata: ParamMetadata | None, *, force: bool = False
) -> ReviewRow:
    """Compares one wanted value with the vehicle's.

    Args:
        wanted: the value.
        current: the vehicle's parameter; None: it has none of this name.
        metadata: the vehicle's own description; None: not known.
        force: accepts values outside the documented range and choices.
    """
    problem = _problem(wanted, current, metadata, force)
    new = wanted.value
    if new is not None and current is not None and current.is_integer and new == int(new):
        new = int(new)
    is_same = problem is None and current is not None and new is not None and same_value(current, new)
    old = None if current is None or not math.isfinite(current.value) else current.value
    return ReviewRow(
        name=wanted.name,
        line=wanted.line,
        state="refused" if problem is not None else "same" if is_same else "change",
        old=old,
        new=new,
        old_label=label_of(metadata, old),
        new_label=label_of(metadata, new),
        unit=None if metadata is None else metadata.unit,
        title=None if metadata is None else metadata.title,
        reboot_required=metadata is not None and metadata.reboot_required,
        volatile=metadata is not None and metadata.volatile,
        individual=INDIVIDUAL.fullmatch(wanted.name) is not None,
        problem=problem,
    )


def _problem(
    wanted: WantedParam, current: Param | None, metadata: ParamMetadata | None, force: bool
) -> str | None:
    value = wanted.value
    if wanted.problem is not None or value is None:
        return wanted.problem or "There is no value."
    if current is None:
        return "The vehicle has no parameter of this name."
    type_name = "a 32-bit integer" if current.is_integer else "a 32-bit float"
    if wanted.is_integer is not None and wanted.is_integer != current.is_integer:
        return f"On the vehicle it is {type_name}; here it has another type."
    if not math.isfinite(value):
        return "The value is not a number."
    if current.is_integer and (value != int(value) or not -(2**31) <= value < 2**31):
        return f"It is a 32-bit integer; {value:.9g} is not."
    if not current.is_integer and abs(value) > MAX_FLOAT32:
        return f"{value:.9g} does not fit a 32-bit float."
    if metadata is not None and not force:
        try:
            metadata.check(value)
        except InvalidRequest as error:
            return str(error)
    return None


def same_value(current: Param, value: float) -> bool:
    """Whether the vehicle has this value, with the precision in which it stores it."""
    if current.is_integer or not math.isfinite(current.value) or abs(value) > MAX_FLOAT32:
        return current.value == value
    return struct.pack("<f", current.value) == struct.pack("<f", value) or current.value == value


def label_of(metadata: ParamMetadata | None, value: float | None) -> str | None:
    """Label of a value in the metadata: of a choice, or of the set bits."""
    if metadata is None or value is None:
        return None
    label = next((choice.label for choice in metadata.choices if choice.value == value), None)
    if label is None and metadata.bits and value > 0 and value == int(value):
        names = [bit.label for bit in metadata.bits if int(value) >> int(bit.value) & 1]
        label = ", ".join(names) or None
    return label


def repeated(wanted: Sequence[WantedParam]) -> set[str]:
    """Names that are wanted with several values; none of them can be meant."""
    seen: dict[str, float | None] = {}
    found: set[str] = set()
    for each in wanted:
        if each.name in seen and seen[each.name] != each.value:
            found.add(each.name)
        seen[each.name] = each.value
    return found
