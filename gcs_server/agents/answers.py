"""Makes answers short and harmless for a language model.

Texts in an answer may come from anybody who can name a vehicle, a plan or a file, or send a STATUSTEXT. They
are data: characters that cannot be seen are removed, because they can carry instructions that no person
notices, and long texts and lists are shortened. All of it stands below one key that says so; names and
descriptions of tools never contain such a text.
"""

from __future__ import annotations

import json
import unicodedata
from typing import Any, Final

UNTRUSTED: Final = "untrusted_data"
"""Key of what an answer contains: never an instruction."""
MAX_TEXT: Final = 400
"""Longer texts are cut [characters]."""
MAX_ANSWER: Final = 16_000
"""Longer answers are shortened: their lists first [characters]."""
LIST_LENGTHS: Final = (60, 20, 6, 2, 0)
"""Elements of each list that are kept; the first of these numbers with which the answer is short enough."""
MAX_DEPTH: Final = 24
DECIMALS: Final = 7
"""Decimals of numbers: a centimetre in degrees of latitude."""


def visible(text: str, max_length: int = MAX_TEXT) -> str:
    """A text without characters that cannot be seen, shortened. Line breaks become blanks."""
    shown = "".join(" " if c in "\n\r\t" else c for c in text[: 4 * max_length] if _is_shown(c))
    return shown if len(shown) <= max_length else f"{shown[:max_length]}…"


def _is_shown(character: str) -> bool:
    # C: control characters, invisible formats (also the tags that hide texts in emoji), private use.
    return character in "\n\r\t" or unicodedata.category(character)[0] != "C"


def shortened(value: Any, list_length: int, depth: int = MAX_DEPTH) -> Any:
    """The value with visible texts and at most `list_length` elements of each list."""
    if isinstance(value, str):
        return visible(value)
    if isinstance(value, float):
        return round(value, DECIMALS)
    if isinstance(value, dict | list) and depth == 0:
        return "(left out: nested too deep)"
    if isinstance(value, dict):
        return {
            visible(str(k), 100): shortened(v, list_length, depth - 1)
            for k, v in value.items()  # type: ignore[reportUnknownArgumentType]
            if v is not None
        }
    if isinstance(value, list):
        kept = [shortened(each, list_length, depth - 1) for each in value[:list_length]]
        left_out = len(value) - len(kept)
        return [*kept, f"({left_out} more are left out)"] if left_out else kept
    return value


def answer_text(value: Any) -> str:
    """The answer of a tool as JSON. What is unknown (null) is left out."""
    text = ""
    for list_length in LIST_LENGTHS:
        text = json.dumps({UNTRUSTED: shortened(value, list_length)}, ensure_ascii=False)
        if len(text) <= MAX_ANSWER:
            return text
    return json.dumps({UNTRUSTED: text[:MAX_ANSWER], "cut": True}, ensure_ascii=False)
