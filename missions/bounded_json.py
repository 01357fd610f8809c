"""Reads untrusted JSON within limits that are checked before and during parsing."""

from __future__ import annotations

import codecs
import json
import math
import re
from typing import Any

from missions.errors import PlanError

MAX_FILE_BYTES = 8 * 1024 * 1024
"""A QGroundControl plan of 10,000 items takes about 5 MB."""
MAX_DEPTH = 32
MAX_VALUES = 250_000
"""The number of values is the number of commas and opening brackets outside strings. A QGroundControl plan of
10,000 items has 180,000."""
MAX_KEYS = 1000
"""Maximum number of keys in one object."""
MAX_LINES = 25_000
"""Maximum number of lines in a file with one item per line."""
UTF_16_MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
"""How a file in UTF-16 begins; Windows programs call this encoding Unicode."""
_MAX_DIGITS = 40
_STRING = re.compile(r'"(?:[^"\\]|\\.)*+"?', re.DOTALL)
_NOT_BRACKETS = re.compile(r"[^\[\]{}]+")


def decode(data: str | bytes, place: str = "the file") -> str:
    """The text of a file of bounded size, in UTF-8, or in UTF-16 with a byte order mark.

    Raises:
        PlanError: The file is too large or in another encoding.
    """
    if len(data) > MAX_FILE_BYTES:
        limit_mib, size_mb = MAX_FILE_BYTES // (1024 * 1024), len(data) / 1e6
        reason = f"{size_mb:.0f} MB are too large, {limit_mib} MiB is the maximum"
        raise PlanError(place, reason, "Split the plan into smaller ones.")
    if isinstance(data, str):
        return data
    name, encoding = ("UTF-16", "utf-16") if data.startswith(UTF_16_MARKS) else ("UTF-8", "utf-8-sig")
    try:
        return data.decode(encoding)
    except UnicodeDecodeError as error:
        reason = f"byte {error.start} is not {name} text"
        raise PlanError(place, reason, "Save the file as UTF-8.") from None


def decode_lines(data: str | bytes) -> str:
    """The text of a file with one item per line, of bounded size.

    Raises:
        PlanError: The file is too large, not UTF-8, or has too many lines.
    """
    text = decode(data)
    if text.count("\n") + text.count("\r") > MAX_LINES:
        raise PlanError("the file", f"more than {MAX_LINES} lines", "Split the plan into smaller ones.")
    return text


def check_json(data: str | bytes) -> str:
    """Returns the text if it is safe to parse: bounded in size, depth and number of values.

    Raises:
        PlanError: The text exceeds a limit.
    """
    text = decode(data)
    without_strings = _STRING.sub("0", text)
    if without_strings.count(",") + without_strings.count("[") + without_strings.count("{") > MAX_VALUES:
        raise PlanError("the file", f"more than {MAX_VALUES} values", "Split the plan into smaller ones.")
    depth = deepest = 0
    for bracket in _NOT_BRACKETS.sub("", without_strings):
        depth += 1 if bracket in "[{" else -1
        deepest = max(deepest, depth)
    if deepest > MAX_DEPTH:
        raise PlanError(
            "the file", f"nested deeper than {MAX_DEPTH} levels", "This is not a plan; choose another file."
        )
    return text


def load(data: str | bytes) -> Any:
    """Untrusted JSON as Python values: finite numbers, no repeated key in an object.

    Raises:
        PlanError: The text exceeds a limit or is not JSON; the error names the line and column.
    """
    text = check_json(data)
    try:
        return json.loads(
            text,
            parse_float=_finite_number,
            parse_int=_integer,
            parse_constant=_refuse_constant,
            object_pairs_hook=_unique_keys,
        )
    except json.JSONDecodeError as error:
        place = f"line {error.lineno}, column {error.colno}"
        raise PlanError(place, f"not valid JSON ({error.msg})", "Export the plan again.") from None


def dump(value: Any) -> str:
    """ASCII JSON text from which `load` reads the same values in the same order."""
    return json.dumps(value, allow_nan=False, separators=(",", ":"))


def _finite_number(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise PlanError(f"the number {text[:40]}", "it is out of range", "Correct this value.")
    return number


def _integer(text: str) -> int:
    if len(text) > _MAX_DIGITS:
        raise PlanError(f"the number {text[:20]}…", f"it has {len(text)} digits", "Correct this value.")
    return int(text)


def _refuse_constant(text: str) -> float:
    raise PlanError(f"the value {text}", "JSON has no such number", "Write null where there is no value.")


def _unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    if len(pairs) > MAX_KEYS:
        raise PlanError("the file", f"more than {MAX_KEYS} keys in one object", "Choose another file.")
    values = dict(pairs)
    if len(values) != len(pairs):
        keys = [key for key, _ in pairs]
        repeated = next(key for key in keys if keys.count(key) > 1)
        raise PlanError(f"key {repeated[:60]!r}", "it appears twice in one object", "Remove one of them.")
    return values
