"""Logs that people add: each arrives in parts, which go to the disk at once, and is a file when complete. All
functions block; they may be called from several threads."""

from __future__ import annotations

import os
import secrets
import shutil
import threading
from dataclasses import dataclass
from pathlib import Path

from gcs_server.clock import Clock
from gcs_server.errors import InvalidRequest, Refused, UnknownFlight
from gcs_server.logbook.library import Library
from gcs_server.logbook.names import SUFFIXES, suffix_of
from missions.values import hidden_character

MAX_BYTES = 512_000_000
"""Maximum size of a log; a larger one needs more memory than its process may have."""
MAX_PART_BYTES = 1_000_000
MAX_OPEN = 8
EXPIRES_S = 3600.0
"""An upload without a new part for this time is dropped."""
KEEP_FREE_BYTES = 500_000_000
"""Disk space that must stay free, because a flight may be recorded at the same time."""
_PREFIX = ".upload-"


@dataclass(slots=True)
class Upload:
    """A log of which parts have arrived."""

    id: str
    name: str
    size_bytes: int
    received_bytes: int
    changed_s: float
    """Time of the last part, monotonic [s]."""


class Uploads:
    """The uploads of one server; those of an earlier run are deleted."""

    def __init__(self, clock: Clock, library: Library) -> None:
        self._clock = clock
        self._library = library
        self._open: dict[str, Upload] = {}
        self._lock = threading.RLock()

    def remove_leftovers(self) -> None:
        """Deletes what an earlier run left incomplete."""
        for path in self._library.logs.glob(f"{_PREFIX}*"):
            path.unlink(missing_ok=True)

    def begin(self, name: str, size_bytes: int) -> Upload:
        """Begins an upload.

        Raises:
            InvalidRequest: the name is not that of a log, or the log is too large.
            Refused: too many uploads are open, or the disk has too little room.
            OSError: the file cannot be written.
        """
        if suffix_of(name) is None or hidden_character(name) is not None:
            ends = ", ".join(SUFFIXES)
            raise InvalidRequest("name", f"The name is not that of a log; it must end in {ends}.")
        if size_bytes > MAX_BYTES:
            raise InvalidRequest("bytes", f"A log may have at most {MAX_BYTES:,} bytes.")
        with self._lock:
            return self._begin(name, size_bytes)

    def _begin(self, name: str, size_bytes: int) -> Upload:
        self._drop_expired()
        if len(self._open) >= MAX_OPEN:
            raise Refused(f"{MAX_OPEN} logs are being added already.", remedy="Wait until one is complete.")
        self._library.logs.mkdir(parents=True, exist_ok=True)
        if shutil.disk_usage(self._library.logs).free < size_bytes + KEEP_FREE_BYTES:
            raise Refused("The server's disk has too little room.", remedy="Delete flights first.")
        upload = Upload(secrets.token_hex(8), name, size_bytes, 0, self._clock.monotonic_s())
        self._path(upload.id).touch(mode=0o644)
        self._open[upload.id] = upload
        return upload

    def add(self, upload_id: str, offset_bytes: int, part: bytes) -> tuple[Upload, Path | None]:
        """Adds a part. Returns the upload, and the path of its file once it is complete.

        Raises:
            UnknownFlight: there is no such upload, or it has expired.
            InvalidRequest: the part is not the next one, or goes beyond the log's size.
            OSError: the part cannot be written; it can be sent again.
        """
        with self._lock:
            return self._add(upload_id, offset_bytes, part)

    def _add(self, upload_id: str, offset_bytes: int, part: bytes) -> tuple[Upload, Path | None]:
        upload = self._open.get(upload_id)
        if upload is None:
            raise UnknownFlight("There is no such upload, or it has expired.", remedy="Begin it again.")
        if offset_bytes != upload.received_bytes:
            raise InvalidRequest(
                "offset_bytes",
                f"The next part begins at {upload.received_bytes:,}.",
                remedy="Send the part that begins there.",
            )
        if len(part) > min(MAX_PART_BYTES, upload.size_bytes - offset_bytes) or not part:
            raise InvalidRequest(
                "body", f"A part has 1 to {MAX_PART_BYTES:,} bytes, within the size that was given."
            )
        path = self._path(upload_id)
        with path.open("r+b") as file:  # writing at the offset again replaces a part that failed
            file.seek(offset_bytes)
            file.write(part)
        upload.received_bytes += len(part)
        upload.changed_s = self._clock.monotonic_s()
        if upload.received_bytes < upload.size_bytes:
            return upload, None
        del self._open[upload_id]
        target = self._library.free_path(upload.name)
        os.link(path, target)  # fails if there is such a file meanwhile
        path.unlink()
        return upload, target

    def cancel(self, upload_id: str) -> None:
        """Deletes what has arrived. Raises UnknownFlight."""
        with self._lock:
            if self._open.pop(upload_id, None) is None:
                raise UnknownFlight("There is no such upload, or it has expired.")
            self._path(upload_id).unlink(missing_ok=True)

    def _drop_expired(self) -> None:
        now_s = self._clock.monotonic_s()
        for upload in [u for u in self._open.values() if now_s - u.changed_s > EXPIRES_S]:
            self.cancel(upload.id)

    def _path(self, upload_id: str) -> Path:
        return self._library.logs / f"{_PREFIX}{upload_id}"
