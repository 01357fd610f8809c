"""A file of lines, appended to whole lines at a time and turned over when it is full. All of it blocks."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path


class LineLog:
    """One file and the one before it (`name.1.suffix`); what is older is gone.

    Args:
        path: the file.
        max_bytes: a file of this size becomes the one before.
    """

    def __init__(self, path: Path, max_bytes: int) -> None:
        self.path = path
        self._max_bytes = max_bytes
        self._before = path.with_suffix(f".1{path.suffix}")

    def append(self, lines: bytes) -> None:
        """On the disk (fsync) when it returns; whole, or not at all.

        Raises:
            OSError: the disk refuses; the file is as it was.
        """
        with suppress(FileNotFoundError):
            if self.path.stat().st_size >= self._max_bytes:
                self.path.replace(self._before)
        descriptor = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
        try:
            size = _repaired(descriptor)
            try:
                written = os.write(descriptor, lines)
                if written != len(lines):  # a disk that is just full takes a part
                    raise OSError(28, "No space left on device")
                os.fsync(descriptor)
            except OSError:
                with suppress(OSError):
                    os.ftruncate(descriptor, size)
                raise
        finally:
            os.close(descriptor)

    def tail(self, most_bytes: int) -> list[bytes]:
        """The newest whole lines, oldest first, from at most so many bytes of each file."""
        lines: list[bytes] = []
        for path in (self._before, self.path):
            with suppress(OSError), path.open("rb") as file:
                size = file.seek(0, os.SEEK_END)
                file.seek(max(0, size - most_bytes))
                found = file.read(most_bytes).split(b"\n")
                lines += found[1 if size > most_bytes else 0 : -1]  # neither a cut one nor a torn one
        return lines


def _repaired(descriptor: int) -> int:
    """Cuts a line off that a crash or a full disk left torn; the size then."""
    size = os.fstat(descriptor).st_size
    end = size
    while end > 0:
        begin = max(0, end - 65536)
        part = os.pread(descriptor, end - begin, begin)
        newline = part.rfind(b"\n")
        if newline >= 0:
            end = begin + newline + 1
            break
        end = begin
    if end != size:
        os.ftruncate(descriptor, end)
    return end
