"""Limits of JSON in requests, checked before it is parsed: whatever is nested deeper, or has more keys, than
any valid body, is refused, because each unknown key would produce a validation error.

The event loop checks bodies of a megabyte, so each function takes time in proportion to the text, and leaves
the work to functions of `bytes`.
"""

from __future__ import annotations

import itertools
import re

MAX_DEPTH = 32
MAX_VALUES = 100_000
"""Maximum number of commas and opening brackets; a path of 5000 points has 35,000."""
MAX_KEYS = 100
"""Maximum number of keys in one object; the largest valid object has 20."""
MAX_DIGITS = 399
REFUSED_REMEDY = "Send only what the API description allows, and less data at once."
_DIGITS_AS_ZEROS = bytes(ord("0") if chr(code) in "0123456789" else code for code in range(256))
_NOT_STRUCTURE = bytes(set(range(256)) - set(b"[]{}:"))
_INNERMOST = re.compile(rb"\{:*\}|\[\]")
_TOO_MANY_KEYS = re.compile(rb"\{:{%d}" % (MAX_KEYS + 1))


def json_fault(text: bytes) -> str | None:
    """Why this JSON text is refused; None if it may be parsed. Invalid JSON is reported by the parser."""
    try:
        text.decode()
    except UnicodeDecodeError:
        return "it is not UTF-8 text"
    if _has_long_number(text) and _has_long_number(_without_strings(text)):
        return f"it has a number of {MAX_DIGITS + 1} digits or more"
    opening = text.count(b"{") + text.count(b"[")
    if opening + text.count(b",") > MAX_VALUES:
        return f"it has more than {MAX_VALUES:,} values"
    if opening > MAX_DEPTH or text.count(b":") > MAX_KEYS:
        return _structure_fault(_without_strings(text).translate(None, _NOT_STRUCTURE))
    return None


def _has_long_number(text: bytes) -> bool:
    return b"0" * (MAX_DIGITS + 1) in text.translate(_DIGITS_AS_ZEROS)


def _without_strings(text: bytes) -> bytes:
    if b"\\" in text:
        text = text.replace(b"\\\\", b"").replace(b'\\"', b"")
    return b"".join(text.split(b'"')[::2])


def _structure_fault(structure: bytes) -> str | None:
    """Why brackets and colons are refused: removes the innermost objects and lists, again and again."""
    too_deep = f"it is nested deeper than {MAX_DEPTH} levels"
    for _ in range(MAX_DEPTH):
        if _TOO_MANY_KEYS.search(structure):
            return f"one of its objects has more than {MAX_KEYS} keys"
        remaining = _INNERMOST.sub(b"", structure)
        if remaining == structure:  # nothing remains, or brackets that do not match
            depths = itertools.accumulate(1 if each in b"[{" else -1 for each in structure.replace(b":", b""))
            return too_deep if max(depths, default=0) > MAX_DEPTH else None
        structure = remaining
    return too_deep if b"[" in structure or b"{" in structure else None
