"""Logs of vehicles of which parts have arrived. What has arrived is on disk, with a list of what is missing,
so that a download continues after a lost link or a restart of the server. All functions of files block.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from gcs_server.clock import Clock
from gcs_server.errors import Refused
from gcs_server.storage.files import replace_file, typed
from gcs_server.vehicle.services.ftp_pieces import MAX_MISSING_PARTS, PartialFile

KEEP_FREE_BYTES = 500_000_000
"""Disk space that must stay free, because a flight may be recorded at the same time."""
MAX_KEPT = 16
"""Incomplete logs that are kept, the newest; also not longer than `KEPT_S`."""
KEPT_S = 30 * 86400.0
MAX_STATE_BYTES = 200_000
CHUNK_BYTES = 1 << 20
_PREFIX, _DATA, _STATE = ".part-", ".data", ".json"


@dataclass(frozen=True)
class _State:
    """The file beside the data."""

    size: int
    missing: list[tuple[int, int]]


class PartialLog:
    """One log of which parts may have arrived.

    Args:
        path: path of the data; the list of what is missing is beside it.
        size: size of the log [bytes].
    """

    def __init__(self, path: Path, size: int) -> None:
        self._path = path
        self._pieces: list[tuple[int, bytes]] = []
        """Pieces that are not on disk yet."""
        self.file = PartialFile(size, _missing(path, size), self._keep)

    @property
    def unsaved_count(self) -> int:
        """Number of pieces that are not on disk yet."""
        return len(self._pieces)

    def saver(self) -> Callable[[], None]:
        """Takes what has arrived since the last call; returns the function that writes it to the disk, which
        blocks and raises OSError. First the data, then what is still missing: after a sudden end the list
        never says that a part is there which is not. Await one before the next."""
        missing = self.file.missing
        pieces, self._pieces = self._pieces, []

        def save() -> None:
            with self._path.open("r+b" if self._path.exists() else "w+b") as data:
                data.truncate(self.file.size)
                for offset, piece in pieces:
                    data.seek(offset)
                    data.write(piece)
                data.flush()
                os.fdatasync(data.fileno())
            state = json.dumps({"size": self.file.size, "missing": missing}).encode()
            replace_file(self._path.with_suffix(_STATE), state, sync=False)

        return save

    def crc32(self) -> int:
        """MAVLink's checksum of the saved log: start value and final XOR are zero. Raises OSError."""
        crc = 0xFFFFFFFF
        with self._path.open("rb") as data:
            while chunk := data.read(CHUNK_BYTES):
                crc = zlib.crc32(chunk, crc)
        return crc ^ 0xFFFFFFFF

    def finish(self, target: Path) -> None:
        """Gives the complete, saved log its name. Raises OSError."""
        self._path.chmod(0o644)
        self._path.replace(target)
        self._path.with_suffix(_STATE).unlink(missing_ok=True)

    def discard(self) -> None:
        """Deletes what has arrived."""
        self._path.unlink(missing_ok=True)
        self._path.with_suffix(_STATE).unlink(missing_ok=True)

    def _keep(self, offset: int, data: bytes) -> None:
        self._pieces.append((offset, data))


class PartialLogs:
    """The incomplete logs in a folder.

    Args:
        folder: the folder of the logs.
        clock: the server's clock.
    """

    def __init__(self, folder: Path, clock: Clock) -> None:
        self._folder, self._clock = folder, clock

    def open(self, key: str, size: int) -> PartialLog:
        """A log with what has arrived of it.

        Args:
            key: names the log on the vehicle; letters, digits and hyphens.
            size: its size [bytes].

        Raises:
            Refused: the disk has too little room.
            OSError: the folder cannot be written.
        """
        self._folder.mkdir(parents=True, exist_ok=True)
        path = self._path(key)
        self._drop_old(path)
        log = PartialLog(path, size)
        if shutil.disk_usage(self._folder).free < size - log.file.received + KEEP_FREE_BYTES:
            raise Refused(
                "The server's disk has too little room for the log.", remedy="Delete flights first."
            )
        return log

    def received_bytes(self, key: str, size: int) -> int:
        """Size of what has arrived of a log [bytes]."""
        missing = _missing(self._path(key), size)
        return 0 if missing is None else size - sum(end - start for start, end in missing)

    def _path(self, key: str) -> Path:
        return self._folder / f"{_PREFIX}{key}{_DATA}"

    def _drop_old(self, kept: Path) -> None:
        """Deletes incomplete logs that nobody has continued."""
        times = dict[Path, float]()
        for path in self._folder.glob(f"{_PREFIX}*{_DATA}"):
            with contextlib.suppress(OSError):
                times[path] = path.stat().st_mtime
        newest_first = sorted(times, key=lambda path: times[path], reverse=True)
        oldest_s = self._clock.unix_s() - KEPT_S
        for n, path in enumerate(newest_first):
            if path != kept and (n >= MAX_KEPT or times[path] < oldest_s):
                PartialLog(path, 0).discard()


def _missing(path: Path, size: int) -> list[tuple[int, int]] | None:
    """What is missing of a log; None: all, or what is on disk does not belong to it."""
    try:
        state_path = path.with_suffix(_STATE)
        if path.stat().st_size != size or state_path.stat().st_size > MAX_STATE_BYTES:
            return None
        state = typed(_State, json.loads(state_path.read_bytes()))
        if state.size != size or len(state.missing) > MAX_MISSING_PARTS:
            return None
        PartialFile(size, state.missing, _nowhere)
    except (OSError, ValueError):
        return None
    return state.missing


def _nowhere(_offset: int, _data: bytes) -> None:
    """Stores nothing."""
