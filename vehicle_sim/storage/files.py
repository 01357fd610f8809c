"""The vehicle's files: a folder of its own, and read-only ones that come with the build (`etc/extras`).

Paths are as a client writes them ("/", "./etc", "log/2026-11-21"); nothing outside the folder can be named.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path, PurePosixPath

DIRECTORY_SIZE = 4096
"""What PX4 on Linux answers when a directory is opened as a file."""


class OutsideError(OSError):
    """A path that leads out of the vehicle's folder."""


class VehicleFiles:
    """One vehicle's files.

    Args:
        folder: kept over restarts; None: a temporary one, made when first written to, gone with the object.
        built_in: path -> content made when first asked for; can be read, not changed.
    """

    def __init__(
        self, folder: Path | None = None, built_in: Mapping[str, Callable[[], bytes]] | None = None
    ) -> None:
        self._folder = folder
        self._built_in = dict(built_in or {})
        self._contents: dict[str, bytes] = {}

    @cached_property
    def root(self) -> Path:
        """The folder; made on first use."""
        if self._folder is None:
            self._temporary = tempfile.TemporaryDirectory(prefix="vehicle-sim-", ignore_cleanup_errors=True)
            return Path(self._temporary.name).resolve()
        self._folder.mkdir(parents=True, exist_ok=True)
        return self._folder.resolve()

    def listing(self, path: str) -> list[tuple[str, int | None]]:
        """(name, size) of a directory's entries, size None for a directory; in order of name.

        Raises:
            OSError: there is no such directory.
        """
        name = _normal(path)
        entries: dict[str, int | None] = {}
        prefix = f"{name}/" if name else ""
        for built_in in self._built_in:
            if built_in.startswith(prefix):
                first, _, rest = built_in[len(prefix) :].partition("/")
                entries[first] = None if rest else len(self._content(built_in))
        try:
            for entry in os.scandir(self._real(name)):
                size = entry.stat(follow_symlinks=False).st_size
                entries[entry.name] = None if entry.is_symlink() or entry.is_dir() else size
        except OSError:
            if not entries and name:
                raise
        return sorted(entries.items())

    def is_link(self, path: str, name: str) -> bool:
        """Whether a directory's entry leads elsewhere: into the build, as PX4's `etc` does in simulation."""
        folder = _normal(path)
        if not folder and any(p.startswith(f"{name}/") for p in self._built_in):
            return True
        return (self.root / folder / name).is_symlink()

    def is_directory(self, path: str) -> bool:
        """Whether there is such a directory."""
        name = _normal(path)
        return not name or any(p.startswith(f"{name}/") for p in self._built_in) or self._real(name).is_dir()

    def size(self, path: str) -> int:
        """Of a file, or what PX4 says of a directory.

        Raises:
            FileNotFoundError: there is none.
        """
        name = _normal(path)
        if name in self._built_in:
            return len(self._content(name))
        return DIRECTORY_SIZE if self.is_directory(name) else self._real(name).stat().st_size

    def read(self, path: str, offset: int, size: int) -> bytes:
        """Up to `size` bytes from `offset`; empty at the end.

        Raises:
            OSError: not a file, or not there.
        """
        name = _normal(path)
        if name in self._built_in:
            return self._content(name)[offset : offset + size]
        if self.is_directory(name):
            raise IsADirectoryError(21, "a directory")
        with self._real(name).open("rb") as file:
            file.seek(offset)
            return file.read(size)

    def create(self, path: str) -> None:
        """An empty file, in place of one that was there.

        Raises:
            OSError: the directory is missing, or the path is not ours to write.
        """
        self._writable(path).write_bytes(b"")

    def write(self, path: str, offset: int, data: bytes) -> None:
        """Put `data` at `offset` of a file that is there.

        Raises:
            OSError: it is not there, or not ours to write.
        """
        with self._writable(path).open("r+b") as file:
            file.seek(offset)
            file.write(data)

    def truncate(self, path: str, size: int) -> None:
        """Cut a file, or lengthen it with zeros.

        Raises:
            OSError: it is not there, or not ours to write.
        """
        os.truncate(self._writable(path), size)

    def remove(self, path: str) -> None:
        """Delete a file.

        Raises:
            OSError: it is not there, a directory, or not ours to write.
        """
        self._writable(path).unlink()

    def rename(self, old: str, new: str) -> None:
        """Give a file or directory another path.

        Raises:
            OSError: it is not there, or either is not ours to write.
        """
        self._writable(old).rename(self._writable(new))

    def make_directory(self, path: str) -> None:
        """Raises OSError where it exists or its parent does not."""
        self._writable(path).mkdir()

    def remove_directory(self, path: str) -> None:
        """Raises OSError where it is missing or not empty."""
        self._writable(path).rmdir()

    def host_path(self, path: str) -> Path:
        """Where a file that the vehicle itself writes (its log) lies; its directory is made.

        Raises:
            OSError: not ours to write, or the disk refuses.
        """
        real = self._writable(path)
        real.parent.mkdir(parents=True, exist_ok=True)
        return real

    def forget(self, path: str) -> None:
        """Delete a directory with all in it, if it is there."""
        with contextlib.suppress(FileNotFoundError):
            shutil.rmtree(self._writable(path))

    def _content(self, name: str) -> bytes:
        if name not in self._contents:
            self._contents[name] = self._built_in[name]()
        return self._contents[name]

    def _real(self, name: str) -> Path:
        real = (self.root / name).resolve()
        if real != self.root and self.root not in real.parents:
            raise OutsideError(13, "outside the vehicle's folder")
        return real

    def _writable(self, path: str) -> Path:
        name = _normal(path)
        if not name or name in self._built_in or any(p.startswith(f"{name}/") for p in self._built_in):
            raise PermissionError(13, "read-only")
        return self._real(name)


def _normal(path: str) -> str:
    """Without leading slash and dots.

    Raises:
        OutsideError: the path climbs out, or holds a NUL.
    """
    parts = [part for part in PurePosixPath(path.lstrip("/")).parts if part != "."]
    if ".." in parts or "\0" in path:
        raise OutsideError(13, "outside the vehicle's folder")
    return "/".join(parts)
