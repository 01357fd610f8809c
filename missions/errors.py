"""The error of a plan that cannot be read or written: the part concerned, the reason and the fix."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError


class PlanError(Exception):
    """A plan that cannot be read, or that a format cannot store. Nothing has been changed.

    Attributes:
        place: The part concerned, for example "item 3 (waypoint), field lat_deg". Items are numbered from 1.
        reason: What is wrong, without a full stop.
        fix: How to correct the error, as a sentence.
        field: The field of the document, for example "coverage.side_overlap"; None: the error does not
            concern a single field.
    """

    def __init__(self, place: str, reason: str, fix: str, *, field: str | None = None) -> None:
        super().__init__(f"{place}: {reason}. {fix}")
        self.field = field
        self.place = place
        self.reason = reason
        self.fix = fix


_NOUNS = {"items": "item", "fence": "geofence zone", "rally_points": "rally point", "obstacles": "obstacle"}


def place_of(location: tuple[int | str, ...]) -> str:
    """The name of a value in messages, from the path of keys and indexes to the value; items are numbered
    from 1."""
    parts = list(location)
    if len(parts) >= 2 and parts[0] in _NOUNS and isinstance(parts[1], int):
        text = f"{_NOUNS[str(parts[0])]} {parts[1] + 1}"
        value_path = parts[2:]
        if (
            value_path
            and parts[0] in ("items", "fence")
            and isinstance(value_path[0], str)
            and len(value_path) > 1
        ):
            text, value_path = f"{text} ({value_path[0]})", value_path[1:]
        return f"{text}, field {field_path(value_path)}" if value_path else text
    return f"field {field_path(parts)}" if parts else "the plan"


def field_path(parts: list[int | str]) -> str:
    """Keys and indexes as `polygon[2].lat_deg`."""
    text = ""
    for part in parts:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text


_FIXES = {
    "missing": "Add this field.",
    "extra_forbidden": "Remove this field, or correct its name.",
    "finite_number": "Write a finite number.",
    "union_tag_invalid": "Use one of these kinds.",
    "union_tag_not_found": "Add the field that names the kind.",
    "too_long": "Split the plan into smaller ones.",
}


def from_validation(error: ValidationError, prefix: tuple[int | str, ...] = ()) -> PlanError:
    """The first error of a validation as a PlanError; `prefix` is the path to the validated value."""
    first: dict[str, Any] = dict(error.errors(include_url=False, include_input=False)[0])
    more = error.error_count() - 1
    reason = str(first["msg"])[:300].rstrip(".")
    if more:
        reason += f" (and {more} more)"
    fix = _FIXES.get(str(first["type"]), "Correct this value.")
    return PlanError(place_of(prefix + tuple(first["loc"])), reason, fix)
