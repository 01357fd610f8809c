"""Limits of a vehicle's own metadata: long texts are shortened, and omitted entries are counted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TypeVar

Key = TypeVar("Key")
Entry = TypeVar("Entry")

MAX_REASONS = 3
MAX_REASON_LENGTH = 160


def cut(text: str, max_length: int) -> str:
    """The text, limited to this number of characters with an ellipsis."""
    return text if len(text) <= max_length else text[: max_length - 1] + "…"


class OmittedEntries:
    """Counts entries that are omitted because of a limit or an error, with the first reasons.

    Args:
        singular: name of an entry ("parameter").
        plural: name of several entries.
    """

    def __init__(self, singular: str, plural: str) -> None:
        self._singular, self._plural = singular, plural
        self._reasons: list[str] = []
        self._reason_count = 0
        self.count = 0

    def add(self, name: str, reason: object, count: int = 1) -> None:
        """Adds one omitted entry, or several entries with the same reason."""
        self.count += count
        self._reason_count += 1
        if len(self._reasons) < MAX_REASONS:
            self._reasons.append(cut(f"{cut(name, 40)} ({reason})", MAX_REASON_LENGTH))

    def text(self) -> str | None:
        """The omitted entries as a sentence; None: no entry was omitted."""
        if not self.count:
            return None
        more = ", …" if self._reason_count > len(self._reasons) else ""
        noun = self._singular if self.count == 1 else self._plural
        return f"Left out {self.count:,} {noun}: {', '.join(self._reasons)}{more}."


class Document(Mapping[Key, Entry]):
    """A vehicle's metadata, by name or id.

    Args:
        entries: entries within the limits.
        omission_text: omitted entries and the reasons, as a sentence; None: no entry was omitted.
        size_bytes: size of the encoded entries, as a measure of their memory.
    """

    def __init__(
        self, entries: Mapping[Key, Entry], omission_text: str | None = None, size_bytes: int = 0
    ) -> None:
        self._entries = entries
        self.omission_text = omission_text
        self.size_bytes = size_bytes

    def __getitem__(self, key: Key) -> Entry:
        return self._entries[key]

    def __iter__(self) -> Iterator[Key]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    def __hash__(self) -> int:  # for weak sets, which compare documents by identity
        return id(self)
