"""Limits for a vehicle's own metadata: texts are cut, numbers are checked, dropped entries are counted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TypeVar

Key = TypeVar("Key")
Entry = TypeVar("Entry")

MAX_REASONS = 3
MAX_REASON_LENGTH = 160


def cut(text: str, most: int) -> str:
    """The text, limited to this number of characters with an ellipsis."""
    return text if len(text) <= most else text[: most - 1] + "…"


class LeftOut:
    """Counts entries beyond the limits and keeps the first reasons.

    Args:
        one: singular name of an entry ("parameter").
        several: plural name.
    """

    def __init__(self, one: str, several: str) -> None:
        self._one, self._several = one, several
        self._reasons: list[str] = []
        self._given = 0
        self.count = 0

    def add(self, name: str, reason: object, count: int = 1) -> None:
        """Adds one dropped entry, or several for one reason."""
        self.count += count
        self._given += 1
        if len(self._reasons) < MAX_REASONS:
            self._reasons.append(cut(f"{cut(name, 40)} ({reason})", MAX_REASON_LENGTH))

    def text(self) -> str | None:
        """A sentence; None if nothing was dropped."""
        if not self.count:
            return None
        more = ", …" if self._given > len(self._reasons) else ""
        what = self._one if self.count == 1 else self._several
        return f"Left out {self.count:,} {what}: {', '.join(self._reasons)}{more}."


class Document(Mapping[Key, Entry]):
    """A vehicle's metadata, by name or id.

    Args:
        entries: entries within the limits.
        left_out: dropped entries and the reasons; None if nothing was dropped.
        size_bytes: size of the encoded entries, as a measure of their memory.
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
