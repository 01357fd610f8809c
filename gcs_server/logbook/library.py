"""The files of flights: recordings, logs downloaded from vehicles, and logs added by people.

An index in SQLite gives each file an id that says nothing about a vehicle, and keeps what was read of it. The
folders decide what there is: a file that was copied into a folder gets an id, one that was removed loses it,
and a lost index is made again. All functions block; they may be called from several threads.
"""

from __future__ import annotations

import contextlib
import json
import logging
import re
import secrets
import sqlite3
import threading
from collections.abc import Callable, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from gcs_server.errors import UnknownFlight
from gcs_server.logbook.names import ULOG, suffix_of
from missions.values import hidden_character

log = logging.getLogger(__name__)

Source = Literal["recording", "vehicle", "file"]
Version = tuple[int, int]
"""Size and time of the last change [ns] of a file."""

MAX_FILES = 20_000
MAX_REMOVED = 50
"""Number of removals that are kept for the list."""
MAX_NAME_BYTES = 200
_SCHEMA = """
CREATE TABLE IF NOT EXISTS files (
    id TEXT PRIMARY KEY, source TEXT NOT NULL, name TEXT NOT NULL, added_unix_s REAL NOT NULL,
    version TEXT, summary TEXT, UNIQUE (source, name));
CREATE TABLE IF NOT EXISTS removed (name TEXT NOT NULL, bytes INTEGER NOT NULL, unix_s REAL NOT NULL);
"""
_DOWNLOADED = re.compile(r"vehicle-[0-9A-Za-z-]+-\d+-\d+-\d+\.ulg")
"""Names of the logs that were downloaded from vehicles."""


@dataclass(frozen=True, slots=True)
class LogFile:
    """A file of a flight."""

    id: str
    source: Source
    path: Path
    version: Version
    added_unix_s: float
    summary: dict[str, Any] | None
    """What was read of it; None: not read yet."""
    is_current: bool
    """Whether `summary` is that of this version; a recording grows while it is written."""

    @property
    def size_bytes(self) -> int:
        """Size [bytes]."""
        return self.version[0]


@dataclass(frozen=True, slots=True)
class Removed:
    """A file that was deleted so that others have room."""

    name: str
    bytes: int
    unix_s: float
    """Time of the removal [s since 1970 UTC]."""


def is_log_name(name: str) -> bool:
    """Whether a file of this name, in one of the folders, is a log."""
    try:
        too_long = len(name.encode()) > MAX_NAME_BYTES
    except UnicodeEncodeError:  # a name in another encoding
        return False
    if too_long or hidden_character(name) is not None or "/" in name or name.startswith("."):
        return False
    return suffix_of(name) is not None


class Library:
    """The files and their index.

    Args:
        index: file of the index, in an existing folder or one that can be made.
        recordings: folder of the recordings.
        logs: folder of the logs.
    """

    def __init__(self, index: Path, recordings: Path, logs: Path) -> None:
        self.recordings, self.logs = recordings, logs
        self._lock = threading.Lock()
        self._index_path = index
        self._database: sqlite3.Connection | None = None

    def close(self) -> None:
        """Closes the index."""
        with self._lock:
            if self._database is not None:
                self._database.close()
                self._database = None

    def files(self, unix_s: float) -> list[LogFile]:
        """All files, the newest change first.

        Args:
            unix_s: the time, with which new files are noted.
        """
        with self._lock:
            return self._sync(unix_s)

    def get(self, file_id: str) -> LogFile:
        """One file. Raises UnknownFlight."""
        with self._lock:
            row = self._rows("SELECT * FROM files WHERE id = ?", file_id)
            file = self._file(row[0]) if row else None
        if file is None:
            shown = file_id if len(file_id) <= 40 else f"{file_id[:40]}…"
            raise UnknownFlight(f"There is no flight {shown!r}.", remedy="GET /flights lists them.")
        return file

    def id_of(self, path: Path, unix_s: float) -> str | None:
        """The id of a file in one of the folders; None: there is no such file."""
        return next((file.id for file in self.files(unix_s) if file.path == path), None)

    def free_path(self, name: str) -> Path:
        """A path for a new log of this name: characters that a name cannot have are replaced, and a number is
        added if there is such a file already."""
        suffix = suffix_of(name) or ULOG
        stem = re.sub(r"[^\w .()+-]+", "_", name[: -len(suffix)]).strip(" .") or "log"
        while len(stem.encode()) > MAX_NAME_BYTES - 20:
            stem = stem[:-1]
        for number in range(1, MAX_FILES):
            path = self.logs / f"{stem}{f'-{number}' if number > 1 else ''}{suffix}"
            if not path.exists() and not _DOWNLOADED.fullmatch(path.name):
                return path
        raise FileExistsError(f"too many logs named {stem}")

    def downloaded_path(self, name: str) -> Path | None:
        """Path of a log that was downloaded from a vehicle; None: there is no such file."""
        path = self.logs / name
        return path if _DOWNLOADED.fullmatch(name) and path.is_file() else None

    def add_downloaded(self, name: str, move: Callable[[Path], None]) -> Path:
        """Adds a log that was downloaded from a vehicle.

        Args:
            name: its name.
            move: called with the path that it gets; moves it there.

        Raises:
            OSError: it cannot be moved.
        """
        if not _DOWNLOADED.fullmatch(name):
            raise ValueError(f"{name!r} is not the name of a downloaded log")
        move(self.logs / name)
        return self.logs / name

    def note(self, file: LogFile, summary: dict[str, Any]) -> None:
        """Keeps what was read of a file."""
        with self._lock:
            self._rows(
                "UPDATE files SET version = ?, summary = ? WHERE id = ?",
                json.dumps(file.version),
                json.dumps(summary),
                file.id,
            )

    def delete(self, file_id: str) -> LogFile:
        """Deletes a file. Raises UnknownFlight, OSError."""
        file = self.get(file_id)
        file.path.unlink(missing_ok=True)
        with self._lock:
            self._rows("DELETE FROM files WHERE id = ?", file_id)
        return file

    def make_room(self, max_bytes: int, in_use: Set[Path], unix_s: float) -> list[Removed]:
        """Deletes the oldest files until all together have at most `max_bytes`; notes what it deletes.

        Args:
            max_bytes: the limit.
            in_use: files that are being recorded or replayed, which stay.
            unix_s: the time.
        """
        files = self.files(unix_s)
        total = sum(file.size_bytes for file in files)
        removed: list[Removed] = []
        for file in sorted(files, key=lambda each: each.version[1]):
            if total <= max_bytes:
                break
            if file.path in in_use:
                continue
            try:
                self.delete(file.id)
            except OSError as error:
                log.warning("%s cannot be deleted: %s", file.path, error)
                continue
            total -= file.size_bytes
            removed.append(Removed(file.path.name, file.size_bytes, unix_s))
        with self._lock:
            for each in removed:
                self._rows("INSERT INTO removed VALUES (?, ?, ?)", each.name, each.bytes, each.unix_s)
            self._rows(
                "DELETE FROM removed WHERE rowid <= (SELECT max(rowid) FROM removed) - ?",
                MAX_REMOVED,
            )
        return removed

    def removed(self) -> list[Removed]:
        """The last files that were deleted to make room, the newest first."""
        with self._lock:
            rows = self._rows("SELECT name, bytes, unix_s FROM removed ORDER BY rowid DESC")
        return [Removed(*row) for row in rows]

    def _sync(self, unix_s: float) -> list[LogFile]:
        """Notes new files, forgets files that are gone, and returns all."""
        found = set(self._names())
        known = {(row[1], row[2]): row for row in self._rows("SELECT * FROM files")}
        for source, name in sorted(found - known.keys()):
            file_id = secrets.token_hex(8)
            self._rows("INSERT INTO files VALUES (?, ?, ?, ?, NULL, NULL)", file_id, source, name, unix_s)
            known[(source, name)] = (file_id, source, name, unix_s, None, None)
        for source, name in known.keys() - found:
            self._rows("DELETE FROM files WHERE source = ? AND name = ?", source, name)
            del known[(source, name)]
        files = [file for row in known.values() if (file := self._file(row)) is not None]
        return sorted(files, key=lambda each: each.version[1], reverse=True)

    def _names(self) -> list[tuple[Source, str]]:
        names: list[tuple[Source, str]] = []
        for folder in (self.recordings, self.logs):
            with contextlib.suppress(OSError):
                for path in folder.iterdir():
                    if len(names) >= MAX_FILES:
                        break
                    if is_log_name(path.name) and path.is_file() and not path.is_symlink():
                        downloaded = _DOWNLOADED.fullmatch(path.name) is not None
                        source: Source = "vehicle" if downloaded else "file"
                        names.append(("recording" if folder == self.recordings else source, path.name))
        return names

    def _file(self, row: tuple[Any, ...]) -> LogFile | None:
        file_id, source, name, added_unix_s, version_text, summary = row
        path = (self.recordings if source == "recording" else self.logs) / name
        try:
            status = path.stat()
        except OSError:
            return None
        version = (status.st_size, status.st_mtime_ns)
        read = None if version_text is None else tuple(json.loads(version_text))
        grown = source == "recording" and read is not None and read[0] <= version[0]
        known = json.loads(summary) if read == version or grown else None
        return LogFile(file_id, source, path, version, added_unix_s, known, read == version)

    def _rows(self, statement: str, *values: object) -> list[tuple[Any, ...]]:
        """Runs a statement; a damaged index is made again once."""
        try:
            return self._run(statement, values)
        except sqlite3.DatabaseError as error:
            log.warning("the index of flights %s is made again: %s", self._index_path, error)
            if self._database is not None:
                self._database.close()
                self._database = None
            for path in self._index_path.parent.glob(f"{self._index_path.name}*"):
                path.unlink(missing_ok=True)
            return self._run(statement, values)

    def _run(self, statement: str, values: tuple[object, ...]) -> list[tuple[Any, ...]]:
        if self._database is None:
            try:
                self._index_path.parent.mkdir(parents=True, exist_ok=True)
                database = sqlite3.connect(self._index_path, check_same_thread=False)
                database.executescript(_SCHEMA)
            except (OSError, sqlite3.OperationalError) as error:
                # A disk that cannot be written: ids then last until the server ends.
                log.warning("the index of flights %s cannot be written: %s", self._index_path, error)
                database = sqlite3.connect(":memory:", check_same_thread=False)
                database.executescript(_SCHEMA)
            database.execute("PRAGMA synchronous = OFF")  # what a power failure damages is made again
            self._database = database
        with self._database as transaction:
            return transaction.execute(statement, values).fetchall()
