"""Limits for what a vehicle says of itself: texts are cut, numbers checked, what is left out is counted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TypeVar

Key = TypeVar("Key")
Entry = TypeVar("Entry")

MOST_REASONS = 3
LONGEST_REASON = 160


def cut(text: str, most: int) -> str:
    """The text, at most so many characters of it; an ellipsis says that there was more."""
    return text if len(text) <= most else text[: most - 1] + "…"


class LeftOut:
    """Counts what does not keep to the limits and remembers the first reasons.

    Args:
        one: what one of them is called ("parameter").
        several: what several are called.
    """

    def __init__(self, one: str, several: str) -> None:
        self._one, self._several = one, several
        self._reasons: list[str] = []
        self._given = 0
        self.count = 0

    def add(self, name: str, reason: object, count: int = 1) -> None:
        """One more, or several for one reason."""
        self.count += count
        self._given += 1
        if len(self._reasons) < MOST_REASONS:
            self._reasons.append(cut(f"{cut(name, 40)} ({reason})", LONGEST_REASON))

    def words(self) -> str | None:
        """A sentence; None where nothing was left out."""
        if not self.count:
            return None
        more = ", …" if self._given > len(self._reasons) else ""
        what = self._one if self.count == 1 else self._several
        return f"Left out {self.count:,} {what}: {', '.join(self._reasons)}{more}."


class Document(Mapping[Key, Entry]):
    """What a vehicle describes, by name or id.

    Args:
        entries: those that keep to the limits.
        left_out: what was left out and why; None where nothing was.
        size_bytes: of the encoded entries, as a measure of the memory that they take.
    """

    def __init__(
        self, entries: Mapping[Key, Entry], left_out: str | None = None, size_bytes: int = 0
    ) -> None:
        self._entries = entries
        self.left_out = left_out
        self.size_bytes = size_bytes

    def __getitem__(self, key: Key) -> Entry:
        return self._entries[key]

    def __iter__(self) -> Iterator[Key]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    def __hash__(self) -> int:
        return id(self)
