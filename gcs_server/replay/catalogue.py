"""Lists recordings; reads only the start and end of each file."""

from __future__ import annotations

import os
import re
from collections.abc import Set
from dataclasses import dataclass, replace
from pathlib import Path

from gcs_server.errors import UnknownRecording
from gcs_server.replay.index import AUTOPILOT_INVALID, HEARTBEAT, explain
from gcs_server.replay.records import (
    BATCH_BYTES,
    STX_V2,
    Cursor,
    Record,
    message_id,
    parse,
    system_id,
    unpack,
)
from missions.values import hidden_character

SUFFIXES = (".tlog", ".tlog.gz")
MAX_NAME_LENGTH = 255
"""Maximum length of a file name [bytes]."""
_recording_name = re.compile(r"\d{8}-\d{6}-(?P<link>.+?)(_\d{3})?\.tlog(\.gz)?")

FileVersion = tuple[int, int]
"""(size, time of the last change [ns]) of a file; different if the file was changed."""


@dataclass(frozen=True, slots=True)
class RecordingInfo:
    """One file of the data folder's `recordings`."""

    name: str
    """Name of the file, also in the API."""
    bytes: int
    started_unix_s: float | None
    """Time of the first record [s since 1970 UTC]; null if the file cannot be read."""
    duration_s: float | None
    """Time from the first to the last record."""
    vehicles: tuple[int, ...]
    """System ids of the vehicles near the start; of all vehicles once the recording was opened."""
    link: str | None
    """Name of the recorded link, from the file name; null for files with other names."""
    running: bool
    """Whether the recording is still being written."""
    problem: str | None
    """Why the recording cannot be played completely; null: it can be played completely."""


def _is_recording_name(name: str) -> bool:
    """Whether the name is valid for a recording."""
    try:
        length = len(name.encode())
    except UnicodeEncodeError:  # a file name in another encoding, or an incomplete character from a client
        return False
    is_in_folder = Path(name).name == name and hidden_character(name) is None and not name.startswith(".")
    return is_in_folder and length <= MAX_NAME_LENGTH and name.endswith(SUFFIXES)


def file_version(path: Path) -> FileVersion:
    """The current version of a file. Raises OSError."""
    status = path.stat()
    return status.st_size, status.st_mtime_ns


class Catalogue:
    """The recordings of a folder; call its reading functions in a worker thread."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._cache: dict[str, tuple[FileVersion, RecordingInfo]] = {}

    def path(self, name: str) -> Path:
        """Path of a recording.

        Raises:
            UnknownRecording: the folder has no such recording.
        """
        path = self._folder / name
        if not _is_recording_name(name) or path.is_symlink() or not path.is_file():
            shortened = name if len(name) <= MAX_NAME_LENGTH else f"{name[:MAX_NAME_LENGTH]}…"
            raise UnknownRecording(f"There is no recording {shortened!r}.")
        return path

    def all(self, running: Set[str]) -> list[RecordingInfo]:
        """All recordings, newest first.

        Args:
            running: names of the files that are being written.
        """
        try:
            names = [path.name for path in self._folder.iterdir() if path.name.endswith(SUFFIXES)]
        except FileNotFoundError:
            names = []
        infos: list[RecordingInfo] = []
        for name in names:
            try:
                path = self.path(name)
                version = file_version(path)
            except (UnknownRecording, OSError):
                continue  # not a file, or deleted since
            cached = self._cache.get(name)
            if cached is None or cached[0] != version:
                cached = self._cache[name] = version, read_info(path, version[0])
            is_running = name in running
            problem = "The recording is still empty." if is_running and not version[0] else cached[1].problem
            infos.append(replace(cached[1], running=is_running, problem=problem))
        self._cache = {name: self._cache[name] for name in names if name in self._cache}
        return sorted(infos, key=lambda i: (i.started_unix_s or 0.0, i.name), reverse=True)


def read_info(path: Path, size: int) -> RecordingInfo:
    """Reads a recording's start and end."""
    name_match = _recording_name.fullmatch(path.name)
    info = RecordingInfo(
        path.name, size, None, None, (), name_match["link"] if name_match else None, False, None
    )
    try:
        head, tail, tail_offset = _read_ends(path)
    except OSError as error:
        return replace(info, problem=explain(path, error))
    if not head:
        return replace(info, problem="The file is empty.")
    first = parse(head, Cursor(), is_last=not tail_offset)
    if not first.records or first.bytes_skipped > len(head) // 2:
        return replace(info, problem="No MAVLink records found: this is not a telemetry log (.tlog).")
    last, damaged = first, first.bytes_skipped > 0
    if tail_offset:
        last = parse(tail, Cursor(tail_offset, first.records[-1].time_us, 0), is_last=True)
        bytes_before_first = last.records[0].offset - tail_offset if last.records else len(tail)
        damaged = damaged or not last.records or last.bytes_skipped > bytes_before_first
    end_us = (last.records or first.records)[-1].time_us
    begin_us = first.records[0].time_us
    return replace(
        info,
        started_unix_s=begin_us / 1e6,
        duration_s=(end_us - begin_us) / 1e6,
        vehicles=tuple(sorted({system_id(r.key) for r in first.records if _is_autopilot(r)})),
        problem="Damaged parts of the recording are left out." if damaged else None,
    )


def _read_ends(path: Path) -> tuple[bytes, bytes, int]:
    """The first bytes of a file, the last bytes, and their offset (0 if the first bytes are the whole
    file)."""
    if path.suffix == ".gz":
        head = tail = b""
        total = 0
        for piece in unpack(path):
            total += len(piece)
            if len(head) < BATCH_BYTES:
                head += piece
            tail = (tail + piece)[-BATCH_BYTES:]
        begin = total - len(tail)
    else:
        with path.open("rb") as file:
            head = file.read(BATCH_BYTES)
            begin = max(0, os.fstat(file.fileno()).st_size - BATCH_BYTES)
            tail = os.pread(file.fileno(), BATCH_BYTES, begin)
    return head, tail, begin


def _is_autopilot(record: Record) -> bool:
    if message_id(record.key) != HEARTBEAT:
        return False
    start = 10 if record.raw[0] == STX_V2 else 6
    return len(record.raw) > start + 8 and record.raw[start + 5] != AUTOPILOT_INVALID
