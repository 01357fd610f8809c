"""The vehicle's files: a folder on the host, and read-only files of the build (`etc/extras`).

Paths are those of an FTP client ("/", "./etc", "log/2026-11-21"); paths outside the folder are refused.
"""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path, PurePosixPath

DIRECTORY_SIZE = 4096
"""Size that PX4 on Linux reports for a directory opened as a file."""
FOLDERS, LINKS = ("eeprom", "log"), frozenset({"test_data"})
"""Folders that PX4 makes at its start, and links into its build, which are listed but lead nowhere."""


class PathOutsideError(OSError):
    """A path outside the vehicle's folder."""


class VehicleFiles:
    """One vehicle's files.

    Args:
        folder: folder on the host, which remains after a restart; None: a temporary folder, created at first
            use and deleted with this object.
        built_in: functions that create the content of read-only files, by path; called at first use.
    """

    def __init__(
        self, folder: Path | None = None, built_in: Mapping[str, Callable[[], bytes]] | None = None
    ) -> None:
        self._folder = folder
        self._built_in = dict(built_in or {})
        self._contents: dict[str, bytes] = {}
        self._changing: frozenset[str] = frozenset()

    @cached_property
    def root(self) -> Path:
        """The folder; created on first use, with FOLDERS in it."""
        root = self._folder
        if root is None:
            self._temporary = tempfile.TemporaryDirectory(prefix="vehicle-sim-", ignore_cleanup_errors=True)
            root = Path(self._temporary.name)
        for folder in FOLDERS:
            (root / folder).mkdir(parents=True, exist_ok=True)
        return root.resolve()

    def add_changing(self, files: Mapping[str, Callable[[], bytes]]) -> None:
        """Adds read-only files whose content may change: it is created at each access."""
        self._built_in |= files
        self._changing |= files.keys()

    def listing(self, path: str) -> list[tuple[str, int | None]]:
        """(name, size) of a directory's entries, sorted by name; size None for a directory.

        Raises:
            OSError: the directory does not exist.
        """
        directory = _relative_path(path)
        entries: dict[str, int | None] = {} if directory else dict.fromkeys(LINKS)
        prefix = f"{directory}/" if directory else ""
        for file_path in self._built_in:
            if file_path.startswith(prefix):
                name, _, path_below = file_path[len(prefix) :].partition("/")
                entries[name] = None if path_below else len(self._content(file_path))
        try:
            for entry in os.scandir(self._checked_path(directory)):
                size = entry.stat(follow_symlinks=False).st_size
                entries[entry.name] = None if entry.is_symlink() or entry.is_dir() else size
        except OSError:
            if not entries and directory:
                raise
        return sorted(entries.items())

    def is_link(self, path: str, name: str) -> bool:
        """Whether a directory's entry is a symbolic link.

        The folder of the built-in files counts as a link, because `etc` is a link in PX4's simulation.
        """
        directory = _relative_path(path)
        if not directory and (name in LINKS or self._is_built_in_directory(name)):
            return True
        return (self.root / directory / name).is_symlink()

    def is_directory(self, path: str) -> bool:
        """Whether the path is a directory."""
        relative = _relative_path(path)
        return not relative or self._is_built_in_directory(relative) or self._checked_path(relative).is_dir()

    def size(self, path: str) -> int:
        """Size of a file, or the size that PX4 reports for a directory.

        Raises:
            FileNotFoundError: the file or directory does not exist.
        """
        relative = _relative_path(path)
        if relative in self._built_in:
            return len(self._content(relative))
        return DIRECTORY_SIZE if self.is_directory(relative) else self._checked_path(relative).stat().st_size

    def read(self, path: str, offset: int, size: int) -> bytes:
        """Up to `size` bytes from `offset`; empty at the end.

        Raises:
            OSError: the file does not exist.
        """
        relative = _relative_path(path)
        if relative in self._built_in:
            return self._content(relative)[offset : offset + size]
        if self.is_directory(relative):
            raise IsADirectoryError(errno.EISDIR, "a directory")
        with self._checked_path(relative).open("rb") as file:
            file.seek(offset)
            return file.read(size)

    def create(self, path: str) -> None:
        """Creates an empty file; replaces an existing file.

        Raises:
            OSError: the directory is missing, or the path is read-only.
        """
        self._writable_path(path).write_bytes(b"")

    def write(self, path: str, offset: int, data: bytes) -> None:
        """Writes `data` at `offset` of an existing file.

        Raises:
            OSError: the file does not exist, or is read-only.
        """
        with self._writable_path(path).open("r+b") as file:
            file.seek(offset)
            file.write(data)

    def truncate(self, path: str, size: int) -> None:
        """Truncates a file, or extends it with zeros.

        Raises:
            OSError: the file does not exist, or is read-only.
        """
        os.truncate(self._writable_path(path), size)

    def remove(self, path: str) -> None:
        """Deletes a file.

        Raises:
            OSError: the file does not exist, is a directory, or is read-only.
        """
        self._writable_path(path).unlink()

    def rename(self, old: str, new: str) -> None:
        """Moves a file or directory.

        Raises:
            OSError: the old path does not exist, or one of the paths is read-only.
        """
        self._writable_path(old).rename(self._writable_path(new))

    def make_directory(self, path: str) -> None:
        """Creates a directory; raises OSError if the directory exists or its parent does not."""
        self._writable_path(path).mkdir()

    def remove_directory(self, path: str) -> None:
        """Deletes a directory; raises OSError if the directory is missing or not empty."""
        self._writable_path(path).rmdir()

    def host_path(self, path: str) -> Path:
        """Path on the host of a file that the vehicle writes, such as a log; creates the file's directory.

        Raises:
            OSError: the path is read-only, or the disk reports an error.
        """
        file = self._writable_path(path)
        file.parent.mkdir(parents=True, exist_ok=True)
        return file

    def delete_tree(self, path: str) -> None:
        """Deletes a directory with its content, if it exists."""
        with contextlib.suppress(FileNotFoundError):
            shutil.rmtree(self._writable_path(path))

    def _content(self, relative: str) -> bytes:
        if relative not in self._contents or relative in self._changing:
            self._contents[relative] = self._built_in[relative]()
        return self._contents[relative]

    def _is_built_in_directory(self, relative: str) -> bool:
        return any(file_path.startswith(f"{relative}/") for file_path in self._built_in)

    def _checked_path(self, relative: str) -> Path:
        host_path = (self.root / relative).resolve()
        if host_path != self.root and self.root not in host_path.parents:
            raise PathOutsideError(errno.EACCES, "outside the vehicle's folder")
        return host_path

    def _writable_path(self, path: str) -> Path:
        relative = _relative_path(path)
        if not relative or relative in self._built_in or self._is_built_in_directory(relative):
            raise PermissionError(errno.EACCES, "read-only")
        return self._checked_path(relative)


def _relative_path(path: str) -> str:
    """The path relative to the vehicle's folder; empty for the folder.

    Raises:
        PathOutsideError: the path contains ".." or a NUL.
    """
    parts = [part for part in PurePosixPath(path.lstrip("/")).parts if part != "."]
    if ".." in parts or "\0" in path:
        raise PathOutsideError(errno.EACCES, "outside the vehicle's folder")
    return "/".join(parts)
