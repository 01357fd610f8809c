"""What the server itself noted of flights: vehicle, recordings, plan or program, comparison, commands,
parameters. Two files for each flight: the head, which the list needs, and the details. All functions block;
they may be called from several threads."""

from __future__ import annotations

import contextlib
import logging
import secrets
import threading
from collections.abc import Set
from pathlib import Path

import msgspec

from gcs_server.logbook.logged_flights import LoggedFlight
from gcs_server.storage.files import open_file, read_limited, replace_file

log = logging.getLogger(__name__)

MAX_NOTES = 5000
MAX_HEAD_BYTES = 16_000
MAX_DETAILS_BYTES = 4_000_000
_HEAD, _DETAILS = ".json", ".details.json"


class NotesHead(msgspec.Struct, frozen=True):
    """The head of the notes of one flight."""

    id: str
    vehicle: str
    """The vehicle's id at this server."""
    recordings: tuple[str, ...]
    """Names of the recordings of its links."""
    flight: LoggedFlight
    """Times begin at arming: `begin_s` is 0."""
    plan: str | None = None
    """Name of the flown plan or program; None: none, or it has no name."""


class NotesStore:
    """The notes in a folder.

    Args:
        folder: the folder; made at the first write.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._lock = threading.Lock()
        self._heads: dict[str, NotesHead] | None = None

    @staticmethod
    def new_id() -> str:
        """An id that says nothing about the flight."""
        return f"n{secrets.token_hex(8)}"

    def heads(self) -> list[NotesHead]:
        """The heads of all notes."""
        with self._lock:
            return list(self._known().values())

    def write(self, head: NotesHead, details: bytes | None = None) -> None:
        """Writes the head and, if given, the details. Raises OSError."""
        with self._lock:
            known = self._known()
            self._folder.mkdir(parents=True, exist_ok=True)
            if details is not None and len(details) <= MAX_DETAILS_BYTES:
                replace_file(self._folder / f"{head.id}{_DETAILS}", details, sync=False)
            replace_file(self._folder / f"{head.id}{_HEAD}", msgspec.json.encode(head), sync=False)
            known[head.id] = head
            for oldest in sorted(known.values(), key=_begin)[: max(0, len(known) - MAX_NOTES)]:
                self._delete(oldest.id)

    def details(self, notes_id: str) -> bytes | None:
        """The details as JSON; None: there are none, or they cannot be read."""
        with self._lock:
            if notes_id not in self._known():
                return None
            try:
                with open_file(self._folder / f"{notes_id}{_DETAILS}") as file:
                    return read_limited(file, MAX_DETAILS_BYTES)
            except (OSError, ValueError) as error:
                log.warning("the notes %s of a flight cannot be read: %s", notes_id, error)
                return None

    def delete(self, notes_id: str) -> None:
        """Deletes notes; does nothing if there are none. Raises OSError."""
        with self._lock:
            self._delete(notes_id)

    def drop_unrecorded(self, recordings: Set[str], kept: Set[str]) -> None:
        """Deletes the notes whose recordings are all gone, except those with ids in `kept`."""
        with self._lock:
            for head in list(self._known().values()):
                if head.recordings and head.id not in kept and not recordings & set(head.recordings):
                    with contextlib.suppress(OSError):
                        self._delete(head.id)

    def _delete(self, notes_id: str) -> None:
        if self._known().pop(notes_id, None) is not None:
            for suffix in (_HEAD, _DETAILS):
                (self._folder / f"{notes_id}{suffix}").unlink(missing_ok=True)

    def _known(self) -> dict[str, NotesHead]:
        if self._heads is None:
            self._heads = {}
            with contextlib.suppress(OSError):
                for path in sorted(self._folder.glob(f"n*{_HEAD}"))[: 2 * MAX_NOTES]:
                    if not path.name.endswith(_DETAILS) and (head := _read_head(path)) is not None:
                        self._heads[head.id] = head
        return self._heads


def _begin(head: NotesHead) -> float:
    return head.flight.begin_unix_s or 0.0


def _read_head(path: Path) -> NotesHead | None:
    try:
        with open_file(path) as file:
            head = msgspec.json.decode(read_limited(file, MAX_HEAD_BYTES), type=NotesHead)
    except (OSError, ValueError) as error:
        log.warning("the notes %s of a flight cannot be read: %s", path.name, error)
        return None
    return head if path.name == f"{head.id}{_HEAD}" else None
