"""Keeps track of the received and the missing parts of a file. No I/O.

The work for one piece does not grow with the number of earlier pieces: the missing parts stay sorted, and
their number is at most `MAX_MISSING_PARTS`.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

MAX_MISSING_PARTS = 2048
"""A piece that would leave more missing parts is dropped, as if the link had lost it. A file of
half a megabyte of which every second packet is lost has fewer missing parts."""


class PartialFile:
    """A file of known size that is being received.

    Args:
        size: size of the file [bytes].
        missing: (start, end) of the parts that are still missing, sorted, which do not touch; None: all.
        store: called with (offset, data) of each new piece; None: the data is kept in memory.

    Raises:
        ValueError: `missing` is not such a list.
    """

    def __init__(
        self,
        size: int,
        missing: Sequence[tuple[int, int]] | None = None,
        store: Callable[[int, bytes], None] | None = None,
    ) -> None:
        self.size = size
        parts = ([(0, size)] if size else []) if missing is None else list(missing)
        edges = [-1, *(edge for part in parts for edge in part), size + 1]
        if any(after <= before for before, after in pairwise(edges)):
            raise ValueError("the missing parts are not sorted, or not within the file")
        self._missing: list[tuple[int, int]] = parts
        self._received = size - sum(end - start for start, end in parts)
        self._data = bytearray(size if store is None else 0)
        self._store = self._keep if store is None else store

    @property
    def complete(self) -> bool:
        """Whether nothing is missing."""
        return not self._missing

    @property
    def received(self) -> int:
        """Number of received bytes."""
        return self._received

    @property
    def content(self) -> bytes:
        """The whole file, with zeros for missing parts; only of a file that is kept in memory."""
        return bytes(self._data)

    @property
    def first_missing(self) -> tuple[int, int] | None:
        """(start, end) of the first missing part; None: the file is complete."""
        return self._missing[0] if self._missing else None

    @property
    def missing(self) -> tuple[tuple[int, int], ...]:
        """(start, end) of all missing parts, sorted."""
        return tuple(self._missing)

    @property
    def tail(self) -> tuple[int, int] | None:
        """(start, end) of the missing end of the file; None: its last byte has arrived."""
        return self._missing[-1] if self._missing and self._missing[-1][1] == self.size else None

    def missing_pieces(self, max_bytes: int, before: int) -> Iterator[tuple[int, int]]:
        """(start, end) of missing pieces of at most `max_bytes`, of the parts that begin before `before`."""
        for start, end in self._missing:
            if start >= before:
                return
            for first in range(start, end, max_bytes):
                yield first, min(first + max_bytes, end)

    def missing_within(self, max_bytes: int) -> tuple[int, int] | None:
        """(start, end) of all missing parts within `max_bytes` of the first missing byte; None: the file is
        complete."""
        if not self._missing:
            return None
        start = self._missing[0][0]
        last = bisect_right(self._missing, start + max_bytes - 1, key=lambda part: part[0]) - 1
        return start, min(self._missing[last][1], start + max_bytes)

    @property
    def missing_count(self) -> int:
        """Number of missing parts."""
        return len(self._missing)

    def put(self, offset: int, data: bytes) -> bool:
        """Stores a piece; False if the piece is not new, does not fit into the file, or leaves too many
        missing parts."""
        end = offset + len(data)
        if not data or offset < 0 or end > self.size:
            return False
        missing = self._missing
        first = bisect_right(missing, offset, key=lambda part: part[1])
        stop = first
        missing_before = 0
        while stop < len(missing) and missing[stop][0] < end:
            missing_before += missing[stop][1] - missing[stop][0]
            stop += 1
        if first == stop:
            return False
        left = [(missing[first][0], offset)] if missing[first][0] < offset else []
        right = [(end, missing[stop - 1][1])] if missing[stop - 1][1] > end else []
        if len(missing) - (stop - first) + len(left) + len(right) > MAX_MISSING_PARTS:
            return False
        missing[first:stop] = left + right
        self._received += missing_before - sum(last - start for start, last in left + right)
        self._store(offset, data)
        return True

    def _keep(self, offset: int, data: bytes) -> None:
        self._data[offset : offset + len(data)] = data
