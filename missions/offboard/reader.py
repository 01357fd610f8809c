"""Reads an offboard mission from handwritten YAML or JSON; every error names its line.

Supported YAML: mappings, lists, strings and numbers. Anchors, tags and repeated keys are refused.
"""

from __future__ import annotations

import math
import re
from typing import Any

import yaml
from pydantic import ValidationError

from missions.bounded_json import decode, dump, load
from missions.errors import PlanError, field_path
from missions.offboard.document import OffboardMission, check_calls
from missions.offboard.meetings import check_meetings

MAX_BYTES = 2 * 1024 * 1024
MAX_VALUES = 60_000
MAX_DEPTH = 24
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_KEYWORDS: dict[str, Any] = {"true": True, "false": False, "null": None, "~": None, "": None}

ValuePath = tuple[str | int, ...]


def read(data: str | bytes) -> OffboardMission:
    """Reads a mission from a file.

    Raises:
        PlanError: The file is too large, not YAML, or not a mission; the error names line, step, field and
            fix.
    """
    text = decode(data)
    if len(text) > MAX_BYTES:
        reason = f"{len(text) / 1e6:.1f} MB are too large, {MAX_BYTES // 1_048_576} MiB is the maximum"
        raise PlanError("the file", reason, "Give its trajectories (`tables`) fewer rows.")
    lines: dict[ValuePath, int] = {}
    value = _parse(text, lines)
    try:
        mission = OffboardMission.model_validate_json(dump(value))
    except ValidationError as error:
        raise _plan_error(error, value, lines) from None
    check_calls(mission)
    check_meetings(mission)
    return mission


def read_json(data: str | bytes) -> OffboardMission:
    """Reads a mission sent as JSON, with at most MAX_VALUES values and MAX_DEPTH levels; errors have no line
    numbers.

    Raises:
        PlanError: The text exceeds a limit, is not JSON, or not a mission; the error names step, field and
            fix.
    """
    text = decode(data)
    value = load(text)
    if isinstance(value, dict) and "items" in value:
        fix = "Convert it to an offboard mission (POST /plans/convert)."
        raise PlanError("the mission", "it is a waypoint plan", fix)
    if _count_values(value, 0) > MAX_VALUES:
        raise PlanError("the mission", f"more than {MAX_VALUES} values", "Split the mission.")
    try:
        mission = OffboardMission.model_validate_json(text)
    except ValidationError as error:
        raise _plan_error(error, value, {}) from None
    check_calls(mission)
    check_meetings(mission)
    return mission


def _count_values(value: Any, depth: int) -> int:
    """Number of values, including nested ones."""
    if depth > MAX_DEPTH:
        raise PlanError("the mission", f"nested deeper than {MAX_DEPTH} levels", "Use `call`.")
    parts = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return 1 + sum(_count_values(part, depth + 1) for part in parts)


def _parse(text: str, lines: dict[ValuePath, int]) -> Any:
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)(text)
    try:
        loader.get_event()
        if loader.check_event(yaml.StreamEndEvent):
            raise PlanError("the file", "it is empty", "Write `name:` and `steps:`.")
        loader.get_event()
        value = _ValueReader(loader, lines).read_value(())
        loader.get_event()
        if not loader.check_event(yaml.StreamEndEvent):
            raise PlanError("the file", "it contains more than one document", "Keep one document.")
        return value
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        place = "the file" if mark is None else f"line {min(mark.line, text.count(chr(10))) + 1}"
        problem = str(getattr(error, "problem", None) or "it cannot be read")[:200]
        raise PlanError(
            place, f"not valid YAML ({problem})", "Check indentation, brackets and quotes."
        ) from None
    finally:
        loader.dispose()


class _ValueReader:
    """Converts YAML events to values, and records the line of each value."""

    def __init__(self, loader: Any, lines: dict[ValuePath, int]) -> None:
        self._loader = loader
        self._lines = lines
        self._count = 0

    def read_value(self, path: ValuePath) -> Any:
        """Reads the next value."""
        event = self._loader.get_event()
        line = event.start_mark.line + 1
        self._lines[path] = line
        self._count += 1
        if self._count > MAX_VALUES:
            raise PlanError(f"line {line}", f"more than {MAX_VALUES} values", "Split the mission.")
        if len(path) > MAX_DEPTH:
            raise PlanError(f"line {line}", f"nested deeper than {MAX_DEPTH} levels", "Use `call`.")
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) is not None:
            raise PlanError(f"line {line}", "anchors and aliases (& and *) are not supported", "Use `call`.")
        if getattr(event, "tag", None) is not None:
            raise PlanError(f"line {line}", f"the tag {event.tag[:60]} is not supported", "Remove the tag.")
        if isinstance(event, yaml.ScalarEvent):
            return _scalar(event, line)
        if isinstance(event, yaml.SequenceStartEvent):
            return self._list(path)
        return self._mapping(path)

    def _list(self, path: ValuePath) -> list[Any]:
        values: list[Any] = []
        while not self._loader.check_event(yaml.SequenceEndEvent):
            values.append(self.read_value((*path, len(values))))
        self._loader.get_event()
        return values

    def _mapping(self, path: ValuePath) -> dict[str, Any]:
        mapping: dict[str, Any] = {}
        while not self._loader.check_event(yaml.MappingEndEvent):
            event = self._loader.get_event()
            line = event.start_mark.line + 1
            if not isinstance(event, yaml.ScalarEvent) or getattr(event, "anchor", None) is not None:
                raise PlanError(f"line {line}", "a key is not a plain word", "Write `key: value`.")
            if event.value in mapping:
                raise PlanError(
                    f"line {line}", f"key {event.value[:60]!r} appears twice", "Keep one of them."
                )
            mapping[event.value] = self.read_value((*path, event.value))
        self._loader.get_event()
        return mapping


def is_text(text: str) -> bool:
    """Whether an unquoted scalar is read as a string, not as a number or a keyword like `true`."""
    return text.lower() not in _KEYWORDS and not _NUMBER.fullmatch(text)


def _scalar(event: yaml.ScalarEvent, line: int) -> Any:
    if event.style in ("'", '"', "|", ">"):
        return event.value
    text = event.value
    if is_text(text):
        return text
    if text.lower() in _KEYWORDS:
        return _KEYWORDS[text.lower()]
    if len(text) > 40:
        raise PlanError(f"line {line}", f"a number of {len(text)} digits", "Correct this value.")
    number = float(text)
    if not math.isfinite(number):
        raise PlanError(f"line {line}", f"the number {text} is too large", "Correct this value.")
    return int(text) if re.fullmatch(r"[-+]?\d+", text) else number


_FIXES = {
    "missing": "Add this field.",
    "extra_forbidden": "Remove this field, or correct its name.",
    "union_tag_invalid": "Use one of these steps.",
    "union_tag_not_found": "Add `step:` with the name of the step.",
    "too_long": "Split the mission.",
}


def _plan_error(error: ValidationError, value: Any, lines: dict[ValuePath, int]) -> PlanError:
    """The first validation error as a PlanError with line, step and field."""
    first: dict[str, Any] = dict(error.errors(include_url=False, include_input=False)[0])
    path = _path_in_file(first["loc"], value)
    path_with_line = path
    while path_with_line not in lines and path_with_line:
        path_with_line = path_with_line[:-1]
    message = str(first["msg"]).removeprefix("Value error, ").rstrip(".")[:300]
    if str(first["type"]) == "union_tag_not_found":
        message = "it has no `step` field"
    fix = _FIXES.get(str(first["type"]), "Correct this value.")
    line = f"line {lines[path_with_line]}" if path_with_line in lines else ""
    return PlanError(f"{line}{describe_path(path)}".removeprefix(", ") or "the mission", message, fix)


def _path_in_file(location: tuple[int | str, ...], value: Any) -> ValuePath:
    """The path in the file; Pydantic's location also contains the kind of each union member."""
    path: list[str | int] = []
    for part in location:
        if isinstance(value, dict) and part not in value and part in (value.get("step"), value.get("shape")):
            continue
        path.append(part)
        try:
            value = value[part]
        except (KeyError, IndexError, TypeError):
            value = None
    return tuple(path)


def describe_path(path: ValuePath) -> str:
    """A path as shown in messages: `, step 3.2, field points[0].corner_m`; steps are numbered from 1."""
    numbers: list[str] = []
    remaining_path = list(path)
    text = ""
    if len(remaining_path) > 2 and remaining_path[0] == "missions":
        text, remaining_path = f", list {remaining_path[1]!r}", remaining_path[2:]
        if isinstance(remaining_path[0], int):
            remaining_path = ["steps", *remaining_path]
    elif len(remaining_path) > 2 and remaining_path[0] == "roles":
        text, remaining_path = f", role {remaining_path[1]!r}", remaining_path[2:]
    while (
        len(remaining_path) > 1
        and remaining_path[0] in ("steps", "then", "otherwise")
        and isinstance(remaining_path[1], int)
    ):
        prefix = "" if remaining_path[0] == "steps" else f"{remaining_path[0]} "
        numbers.append(f"{prefix}{remaining_path[1] + 1}")
        remaining_path = remaining_path[2:]
    if numbers:
        text += f", step {'.'.join(numbers)}"
    return f"{text}, field {field_path(remaining_path)}" if remaining_path else text
