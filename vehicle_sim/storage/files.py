"""The vehicle's files: a folder on the host, and read-only files of the build (`etc/extras`).

Paths are those of an FTP client ("/", "./etc", "log/2026-11-21"); paths outside the folder are refused.
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
"""Size that PX4 on Linux reports for a directory opened as a file."""


class PathOutsideError(OSError):
    """A path outside the vehicle's folder."""


class VehicleFiles:
    """One vehicle's files.

    Args:
        folder: folder on the host, kept over restarts; None: a temporary folder, created at first use and
            deleted with the object.
        built_in: functions that create the content of read-only files, by path; called at the first read.
    """

    def __init__(
        self, folder: Path | None = None, built_in: Mapping[str, Callable[[], bytes]] | None = None
    ) -> None:
        self._folder = folder
        self._built_in = dict(built_in or {})
        self._contents: dict[str, bytes] = {}

    @cached_property
    def root(self) -> Path:
        """The folder; created on first use."""
        if self._folder is None:
            self._temporary = tempfile.TemporaryDirectory(prefix="vehicle-sim-", ignore_cleanup_errors=True)
            return Path(self._temporary.name).resolve()
        self._folder.mkdir(parents=True, exist_ok=True)
        return self._folder.resolve()

    def listing(self, path: str) -> list[tuple[str, int | None]]:
        """(name, size) of a directory's entries, sorted by name; size None for a directory.

        Raises:
            OSError: the directory does not exist.
        """
        name = _normalized(path)
        entries: dict[str, int | None] = {}
        prefix = f"{name}/" if name else ""
        for built_in in self._built_in:
            if built_in.startswith(prefix):
                first, _, rest = built_in[len(prefix) :].partition("/")
                entries[first] = None if rest else len(self._content(built_in))
        try:
            for entry in os.scandir(self._checked_path(name)):
                size = entry.stat(follow_symlinks=False).st_size
                entries[entry.name] = None if entry.is_symlink() or entry.is_dir() else size
        except OSError:
            if not entries and name:
                raise
        return sorted(entries.items())

    def is_link(self, path: str, name: str) -> bool:
        """Whether a directory's entry is a symbolic link, as PX4's `etc` in simulation."""
        folder = _normalized(path)
        if not folder and any(p.startswith(f"{name}/") for p in self._built_in):
            return True
        return (self.root / folder / name).is_symlink()

    def is_directory(self, path: str) -> bool:
        """Whether the path is a directory."""
        name = _normalized(path)
        return (
            not name
            or any(p.startswith(f"{name}/") for p in self._built_in)
            or self._checked_path(name).is_dir()
        )

    def size(self, path: str) -> int:
        """Size of a file, or the size that PX4 reports for a directory.

        Raises:
            FileNotFoundError: the file or directory does not exist.
        """
        name = _normalized(path)
        if name in self._built_in:
            return len(self._content(name))
        return DIRECTORY_SIZE if self.is_directory(name) else self._checked_path(name).stat().st_size

    def read(self, path: str, offset: int, size: int) -> bytes:
        """Up to `size` bytes from `offset`; empty at the end.

        Raises:
            OSError: the file does not exist.
        """
        name = _normalized(path)
        if name in self._built_in:
            return self._content(name)[offset : offset + size]
        if self.is_directory(name):
            raise IsADirectoryError(21, "a directory")
        with self._checked_path(name).open("rb") as file:
            file.seek(offset)
            return file.read(size)

    def create(self, path: str) -> None:
        """Creates an empty file; replaces an existing file.

        Raises:
            OSError: the directory is missing, or the path is read-only.
        """
        self._writable(path).write_bytes(b"")

    def write(self, path: str, offset: int, data: bytes) -> None:
        """Writes `data` at `offset` of an existing file.

        Raises:
            OSError: the file does not exist, or is read-only.
        """
        with self._writable(path).open("r+b") as file:
            file.seek(offset)
            file.write(data)

    def truncate(self, path: str, size: int) -> None:
        """Truncates a file, or extends it with zeros.

        Raises:
            OSError: the file does not exist, or is read-only.
        """
        os.truncate(self._writable(path), size)

    def remove(self, path: str) -> None:
        """Deletes a file.

        Raises:
            OSError: the file does not exist, is a directory, or is read-only.
        """
        self._writable(path).unlink()

    def rename(self, old: str, new: str) -> None:
        """Moves a file or directory.

        Raises:
            OSError: the old path does not exist, or one of the paths is read-only.
        """
        self._writable(old).rename(self._writable(new))

    def make_directory(self, path: str) -> None:
        """Creates a directory; raises OSError if it exists or its parent does not."""
        self._writable(path).mkdir()

    def remove_directory(self, path: str) -> None:
        """Deletes a directory; raises OSError if it is missing or not empty."""
        self._writable(path).rmdir()

    def host_path(self, path: str) -> Path:
        """Path on the host of a file that the vehicle writes (its log); creates the directory.

        Raises:
            OSError: the path is read-only, or the disk reports an error.
        """
        host_path = self._writable(path)
        host_path.parent.mkdir(parents=True, exist_ok=True)
        return host_path

    def delete_tree(self, path: str) -> None:
        """Deletes a directory with its content, if it exists."""
        with contextlib.suppress(FileNotFoundError):
            shutil.rmtree(self._writable(path))

    def _content(self, name: str) -> bytes:
        if name not in self._contents:
            self._contents[name] = self._built_in[name]()
        return self._contents[name]

    def _checked_path(self, name: str) -> Path:
        host_path = (self.root / name).resolve()
        if host_path != self.root and self.root not in host_path.parents:
            raise PathOutsideError(13, "outside the vehicle's folder")
        return host_path

    def _writable(self, path: str) -> Path:
        name = _normalized(path)
        if not name or name in self._built_in or any(p.startswith(f"{name}/") for p in self._built_in):
            raise PermissionError(13, "read-only")
        return self._checked_path(name)


def _normalized(path: str) -> str:
    """The path without leading slash and dots.

    Raises:
        PathOutsideError: the path is outside the folder, or contains a NUL.
    """
    parts = [part for part in PurePosixPath(path.lstrip("/")).parts if part != "."]
    if ".." in parts or "\0" in path:
        raise PathOutsideError(13, "outside the vehicle's folder")
    return "/".join(parts)
