"""Reads YAML files that users write; errors name the file, the line, the field and the fix."""

from __future__ import annotations

import difflib
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

MAX_BYTES = 2_000_000


class FileProblem(ValueError):
    """An invalid file; the text contains the place, the reason and the fix."""


def read_yaml(path: Path) -> Fields:
    """The fields in a YAML file.

    Raises:
        FileProblem: the file does not exist, is not YAML, or is not a mapping.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise FileProblem(f"{path}: larger than {MAX_BYTES // 1_000_000} MB; is it the right file?")
        text = path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise FileProblem(f"{path}: {reason}; name a file that can be read") from None
    return parse_yaml(text, str(path))


def parse_yaml(text: str, source: str) -> Fields:
    """The fields in a YAML text; error texts begin with `source`.

    Raises:
        FileProblem: the text is not YAML, or not a mapping.
    """
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f" line {mark.line + 1}" if mark is not None else ""
        problem = getattr(error, "problem", None) or "cannot be read"
        raise FileProblem(f"{source}{line}: not YAML ({problem})") from None
    if node is None:
        raise FileProblem(f"{source}: empty; write `name: …` and the other fields")
    return Fields(source, "", node)


class Fields:
    """The fields of one YAML mapping, by key.

    The methods check the fields that they read; `finish` reports fields that were not read.
    """

    def __init__(self, source: str, location: str, node: yaml.Node) -> None:
        self._source = source
        self._location = location
        """Place of the mapping in the file, such as "events[0].link"; empty: the whole file."""
        self._node = node
        self._read_keys: set[str] = set()
        self._nodes: dict[str, yaml.Node] = {}
        if not isinstance(node, yaml.MappingNode):
            raise self._problem(node, location, "must contain `name: value` lines")
        for key_node, value_node in node.value:
            key = str(key_node.value)
            if key in self._nodes:
                raise self._problem(key_node, self._location_of(key), "appears twice; keep one")
            self._nodes[key] = value_node

    def problem(self, key: str | None, text: str) -> FileProblem:
        """An error about one field (None: about the whole mapping)."""
        node = self._node if key is None else self._nodes.get(key, self._node)
        return self._problem(node, self._location if key is None else self._location_of(key), text)

    def problem_at(self, path: Sequence[str | int], text: str) -> FileProblem:
        """An error about the value at a path of keys and indexes, with the line of the nearest value."""
        node, location = self._node, self._location
        for part in path:
            location = f"{location}[{part}]" if isinstance(part, int) else f"{location}.{part}".lstrip(".")
            if isinstance(node, yaml.MappingNode):
                node = next((value for key, value in node.value if str(key.value) == part), node)
            elif isinstance(node, yaml.SequenceNode) and isinstance(part, int) and part < len(node.value):
                node = node.value[part]
        return self._problem(node, location, text)

    def value(self) -> dict[str, Any]:
        """All fields as plain values, for a reader that checks them itself."""
        return {key: self._optional_value(key) for key in self._nodes}

    def has(self, key: str) -> bool:
        """Whether the field exists."""
        return key in self._nodes

    def number(
        self, key: str, default: float | None = None, *, low: float = -1e6, high: float = 1e6
    ) -> float:
        """A number from `low` to `high`; the field is required if it has no default."""
        value = self._optional_value(key)
        if value is None:
            return self._checked_default(key, default, "a number")
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            bounds = f"from {_number_text(low)} to {_number_text(high)}"
            raise self.problem(key, f"is {_value_text(value)}; give a number {bounds}")
        return float(value)

    def integer(self, key: str, default: int | None = None, *, low: int, high: int) -> int:
        """An integer from `low` to `high`; the field is required if it has no default."""
        value = self.number(key, default, low=low, high=high)
        if not value.is_integer():
            raise self.problem(key, f"is {_number_text(value)}; give a whole number")
        return int(value)

    def numbers(self, key: str, count: int | None, expected: str) -> tuple[float, ...]:
        """A required list such as [1, 2, 3] with `count` numbers (None: at least one).

        `expected` describes the list in error texts.
        """
        values = self._value_of(self._required_node(key, expected))
        valid = isinstance(values, list) and values and (count is None or len(values) == count)
        valid = valid and all(_is_number(v) for v in values)
        if not valid:
            raise self.problem(key, f"is {_value_text(values)}; give {expected}")
        return tuple(float(v) for v in values)

    def rows(self, key: str) -> list[list[float]]:
        """A required table of numbers: at least two rows of equal length, at least two columns."""
        expected = "at least two lists of at least two numbers, all equally long"
        rows = self._value_of(self._required_node(key, expected))
        valid = isinstance(rows, list) and len(rows) > 1 and all(isinstance(row, list) for row in rows)
        valid = valid and len({len(row) for row in rows}) == 1 and len(rows[0]) > 1
        if not (valid and all(_is_number(v) for row in rows for v in row)):
            raise self.problem(key, f"must be {expected}")
        return [[float(v) for v in row] for row in rows]

    def flag(self, key: str, default: bool) -> bool:
        """A field that is true or false."""
        value = self._optional_value(key)
        if value is None:
            return default
        if not isinstance(value, bool):
            raise self.problem(key, f"is {_value_text(value)}; give true or false")
        return value

    def text(self, key: str, default: str | None = None, *, choices: Sequence[str] = ()) -> str:
        """A text; one of `choices` if there are any; the field is required if it has no default."""
        expected = f"one of {', '.join(choices)}" if choices else "a text"
        value = self._optional_value(key)
        if value is None:
            if default is None:
                raise self.problem(None, f"lacks {key}; give {expected}")
            return default
        if isinstance(value, bool) and choices:
            value = {True: "on", False: "off"}[value]
        if not isinstance(value, str) or (choices and value not in choices):
            raise self.problem(key, f"is {_value_text(value)}; give {expected}")
        return value

    def mapping(self, key: str) -> Fields | None:
        """A nested mapping; None: the field is missing."""
        self._read_keys.add(key)
        return Fields(self._source, self._location_of(key), self._nodes[key]) if key in self._nodes else None

    def items(self, key: str) -> list[Fields]:
        """A list of mappings; empty if the field is missing."""
        self._read_keys.add(key)
        node = self._nodes.get(key)
        if node is None:
            return []
        if not isinstance(node, yaml.SequenceNode):
            raise self.problem(key, "must be a list; begin each entry with a dash")
        location = self._location_of(key)
        return [Fields(self._source, f"{location}[{n}]", item) for n, item in enumerate(node.value)]

    def finish(self) -> None:
        """Reports the first unknown field.

        Raises:
            FileProblem: the mapping has an unknown field.
        """
        for key in self._nodes:
            if key not in self._read_keys:
                similar = difflib.get_close_matches(key, self._read_keys, 1)
                known_keys = ", ".join(sorted(self._read_keys))
                advice = f"did you mean {similar[0]}?" if similar else f"known here: {known_keys}"
                raise self.problem(key, f"is not known; {advice}")

    # --- helpers ---------------------------------------------------------------------------------------

    def _location_of(self, key: str) -> str:
        return f"{self._location}.{key}" if self._location else key

    def _problem(self, node: yaml.Node, location: str, text: str) -> FileProblem:
        return FileProblem(f"{self._source} line {node.start_mark.line + 1}: {location or 'the file'} {text}")

    def _required_node(self, key: str, expected: str) -> yaml.Node:
        self._read_keys.add(key)
        if key not in self._nodes:
            raise self.problem(None, f"lacks {key}; give {expected}")
        return self._nodes[key]

    def _checked_default(self, key: str, default: float | None, expected: str) -> float:
        if default is None:
            raise self.problem(None, f"lacks {key}; give {expected}")
        return default

    def _optional_value(self, key: str) -> Any:
        """The value of a field; None: the field is missing or empty."""
        self._read_keys.add(key)
        return self._value_of(self._nodes[key]) if key in self._nodes else None

    def _value_of(self, node: yaml.Node) -> Any:
        loader = yaml.SafeLoader("")
        try:
            return loader.construct_object(node, deep=True)
        except yaml.YAMLError:
            raise self._problem(
                node, self._location, "contains a value that is neither text nor number"
            ) from None
        finally:
            loader.dispose()


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _value_text(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}…"


def _number_text(value: float) -> str:
    return f"{value:g}"
