"""A file of lines with atomic appends and rotation. All functions block."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path


class LineLog:
    """A file and its predecessor (`name.1.suffix`); older lines are deleted.

    Args:
        path: the file.
        max_bytes: a file of this size is rotated.
    """

    def __init__(self, path: Path, max_bytes: int) -> None:
        self.path = path
        self._max_bytes = max_bytes
        self._previous = path.with_suffix(f".1{path.suffix}")

    def append(self, lines: bytes) -> None:
        """Appends lines and syncs them to disk, completely or not at all.

        Raises:
            OSError: writing failed; the file is unchanged.
        """
        with suppress(FileNotFoundError):
            if self.path.stat().st_size >= self._max_bytes:
                self.path.replace(self._previous)
        descriptor = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
        try:
            size = _drop_incomplete_line(descriptor)
            try:
                written = os.write(descriptor, lines)
                if written != len(lines):  # a nearly full disk writes only a part
                    raise OSError(28, "No space left on device")
                os.fsync(descriptor)
            except OSError:
                with suppress(OSError):
                    os.ftruncate(descriptor, size)
                raise
        finally:
            os.close(descriptor)

    def tail(self, max_bytes: int) -> list[bytes]:
        """The newest complete lines, oldest first, from at most this many bytes of each file."""
        lines: list[bytes] = []
        for path in (self._previous, self.path):
            with suppress(OSError), path.open("rb") as file:
                size = file.seek(0, os.SEEK_END)
                file.seek(max(0, size - max_bytes))
                parts = file.read(max_bytes).split(b"\n")
                lines += parts[1 if size > max_bytes else 0 : -1]  # without incomplete lines
        return lines


def _drop_incomplete_line(descriptor: int) -> int:
    """Removes an incomplete last line, left by a crash or a full disk; returns the size."""
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
