"""What can be had again from a vehicle, kept so that it need not be: bounded, and never a reason to fail."""

from __future__ import annotations

import contextlib
import logging
import re
import tempfile
from pathlib import Path

log = logging.getLogger(__name__)

MOST_FILES = 200
MOST_BYTES = 8_000_000
"""A larger piece is not kept, nor read."""
MOST_BYTES_IN_ALL = 100_000_000
_name = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,120}")


class Cache:
    """Small files by name in one folder; the one that was written longest ago goes first.

    Args:
        folder: made when first written to.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def read(self, name: str) -> bytes | None:
        """None where there is none, or it cannot be read."""
        path = self._path(name)
        try:
            return path.read_bytes() if path.stat().st_size <= MOST_BYTES else None
        except OSError:
            return None

    def write(self, name: str, content: bytes) -> None:
        """Whole or not at all; a full disk is logged and no more."""
        if len(content) > MOST_BYTES:
            return
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            with tempfile.NamedTemporaryFile(dir=self._folder, prefix=".", delete=False) as file:
                file.write(content)
            Path(file.name).replace(self._path(name))
            self._prune()
        except OSError as error:
            log.warning("cache %s: %s", self._folder, error)

    def forget(self, name: str) -> None:
        """It was of no use."""
        with contextlib.suppress(OSError):
            self._path(name).unlink()

    def _prune(self) -> None:
        files = sorted(((p, p.stat()) for p in self._folder.iterdir()), key=lambda f: f[1].st_mtime)
        count, size = len(files), sum(status.st_size for _, status in files)
        for path, status in files:
            if count <= MOST_FILES and size <= MOST_BYTES_IN_ALL:
                break
            path.unlink(missing_ok=True)
            count, size = count - 1, size - status.st_size

    def _path(self, name: str) -> Path:
        if not _name.fullmatch(name):
            raise ValueError(f"{name!r} is no name for a file of the cache")
        return self._folder / name
