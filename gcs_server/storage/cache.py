"""Caches data that vehicles would send again. The size is limited. A read or write that fails raises no
error."""

from __future__ import annotations

import contextlib
import logging
import re
from pathlib import Path

from gcs_server.storage.files import replace_file

log = logging.getLogger(__name__)

MAX_FILES = 200
MAX_BYTES = 8_000_000
MAX_TOTAL_BYTES = 100_000_000
_NAME_PATTERN = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,120}")


class Cache:
    """Small files by name in one folder; the oldest file is removed first.

    Args:
        folder: folder of the files; created at the first write.
        max_bytes: larger files are neither stored nor read.
        max_total_bytes: size of all files.
    """

    def __init__(
        self, folder: Path, max_bytes: int = MAX_BYTES, max_total_bytes: int = MAX_TOTAL_BYTES
    ) -> None:
        self._folder = folder
        self._max_bytes = max_bytes
        self._max_total_bytes = max_total_bytes

    def read(self, name: str) -> bytes | None:
        """Content of a file; None if it is missing or unreadable."""
        path = self._path(name)
        try:
            return path.read_bytes() if path.stat().st_size <= self._max_bytes else None
        except OSError:
            return None

    def write(self, name: str, content: bytes) -> None:
        """Writes a file completely or not at all; a full disk is only logged."""
        if len(content) > self._max_bytes:
            return
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            replace_file(self._path(name), content, sync=False)
            self._prune()
        except OSError as error:
            log.warning("cache %s: %s", self._folder, error)

    def forget(self, name: str) -> None:
        """Removes an unusable file."""
        with contextlib.suppress(OSError):
            self._path(name).unlink()

    def _prune(self) -> None:
        paths = [path for path in self._folder.iterdir() if path.is_file()]
        files = sorted(((path, path.stat()) for path in paths), key=lambda f: f[1].st_mtime)
        count, size = len(files), sum(status.st_size for _, status in files)
        for path, status in files:
            if count <= MAX_FILES and size <= self._max_total_bytes:
                break
            path.unlink(missing_ok=True)
            count, size = count - 1, size - status.st_size

    def _path(self, name: str) -> Path:
        if not _NAME_PATTERN.fullmatch(name):
            raise ValueError(f"{name!r} is not a valid name of a cache file")
        return self._folder / name
