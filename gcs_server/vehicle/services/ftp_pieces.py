"""What has come of a file that arrives in pieces, and what is missing still; pure."""

from __future__ import annotations


class Pieces:
    """A file of known size being put together."""

    def __init__(self, size: int) -> None:
        self.size = size
        self._data = bytearray(size)
        self._missing: list[tuple[int, int]] = [(0, size)] if size else []

    @property
    def complete(self) -> bool:
        """Whether nothing is missing."""
        return not self._missing

    @property
    def received(self) -> int:
        """Bytes that are there."""
        return self.size - sum(end - start for start, end in self._missing)

    @property
    def content(self) -> bytes:
        """All of it; zeros where something is missing."""
        return bytes(self._data)

    @property
    def first_hole(self) -> tuple[int, int] | None:
        """(start, end) of the first part that is missing."""
        return self._missing[0] if self._missing else None

    @property
    def tail_missing(self) -> bool:
        """Whether the only missing part reaches to the end."""
        return len(self._missing) == 1 and self._missing[0][1] == self.size

    def put(self, offset: int, data: bytes) -> bool:
        """Takes a piece; False where it brought nothing new or does not lie within the file."""
        end = offset + len(data)
        if not data or offset < 0 or end > self.size:
            return False
        before = self.received
        self._data[offset:end] = data
        missing: list[tuple[int, int]] = []
        for first, last in self._missing:
            if last <= offset or first >= end:
                missing.append((first, last))
                continue
            if first < offset:
                missing.append((first, offset))
            if last > end:
                missing.append((end, last))
        self._missing = missing
        return self.received > before
