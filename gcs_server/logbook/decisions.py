"""What people decided about flights: their names, and which parts belong together. One file, by the names of
the logs and not by their ids, so that it outlives the index. All functions block; several threads may call
them."""

from __future__ import annotations

import logging
import threading
from pathlib import Path

import msgspec

from gcs_server.storage.files import open_file, read_limited, replace_file

log = logging.getLogger(__name__)

MAX_BYTES = 4_000_000
MAX_ENTRIES = 10_000
"""Maximum number of names, and of decided pairs; then the oldest are dropped."""


class _Stored(msgspec.Struct):
    names: dict[str, str] = {}
    pairs: list[tuple[str, str, bool]] = []


class Decisions:
    """Names and decided pairs; a part is named as `source/file#number`.

    Args:
        path: the file.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock = threading.Lock()
        self._stored: _Stored | None = None

    def names(self) -> dict[str, str]:
        """Names of flights, by part."""
        with self._lock:
            return dict(self._read().names)

    def pairs(self) -> dict[frozenset[str], bool]:
        """Pairs of parts that a person has joined (true) or separated."""
        with self._lock:
            return {frozenset((a, b)): joined for a, b, joined in self._read().pairs}

    def set_name(self, parts: list[str], name: str | None) -> None:
        """Names the flight of these parts; None: takes the name away. Raises OSError."""
        with self._lock:
            stored = self._read()
            names = {part: each for part, each in stored.names.items() if part not in parts}
            if name is not None:
                names |= dict.fromkeys(parts, name)
            self._write(_Stored(names, stored.pairs))

    def decide(self, parts: list[str], others: list[str], *, joined: bool) -> None:
        """Joins or separates each of `parts` and each of `others`. Raises OSError."""
        with self._lock:
            stored = self._read()
            decided = {frozenset((a, b)) for a in parts for b in others}
            kept = [pair for pair in stored.pairs if frozenset(pair[:2]) not in decided]
            added = [(a, b, joined) for a in parts for b in others if a != b]
            self._write(_Stored(stored.names, [*kept, *added]))

    def _read(self) -> _Stored:
        if self._stored is None:
            self._stored = _Stored()
            try:
                with open_file(self._path) as file:
                    self._stored = msgspec.json.decode(read_limited(file, MAX_BYTES), type=_Stored)
            except FileNotFoundError:
                pass
            except (OSError, ValueError) as error:
                log.warning("the names of flights in %s cannot be read: %s", self._path, error)
        return self._stored

    def _write(self, stored: _Stored) -> None:
        stored = _Stored(dict(list(stored.names.items())[-MAX_ENTRIES:]), stored.pairs[-MAX_ENTRIES:])
        self._path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(self._path, msgspec.json.encode(stored))
        self._stored = stored
