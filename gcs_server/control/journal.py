"""Who commanded what, when, and what became of it: one line a command, refused ones too.

A command never waits for the disk: lines go to a writer of their own, and a disk that refuses them costs
the line on disk, not the command; the tail in memory has it and a warning says so.
"""

from __future__ import annotations

import asyncio
import json
import logging
from collections import deque
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from gcs_server.clock import Clock
from gcs_server.supervise import Supervisor

log = logging.getLogger(__name__)

TAIL_LENGTH = 1000
QUEUE_LENGTH = 2000
MAX_BYTES = 10_000_000
"""A file of this size becomes the one before (`journal.1.jsonl`), and a new one begins."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One line."""

    unix_s: float
    client: str
    command: str
    vehicle: str | None
    arguments: dict[str, object]
    result: str
    """ok, or the error's code: refused, rejected, no_reply, …"""
    detail: str | None
    """The error in words."""
    duration_s: float


class Journal:
    """Append-only.

    Args:
        clock: for people's time.
        path: the file; None keeps the tail in memory only.
        max_bytes: of one file; two are kept.
    """

    def __init__(self, clock: Clock, path: Path | None, *, max_bytes: int = MAX_BYTES) -> None:
        self._clock = clock
        self._path = path
        self._max_bytes = max_bytes
        self._tail: deque[Entry] = deque(maxlen=TAIL_LENGTH)
        self._unwritten: deque[Entry] = deque(maxlen=QUEUE_LENGTH)
        self._wake = asyncio.Event()
        self.warning: str | None = None
        """Why lines are not on disk; None while they are."""

    def start(self, supervisor: Supervisor) -> None:
        """Begins to write."""
        if self._path is not None:
            supervisor.start("journal", self._write_for_ever)

    def add(
        self,
        client: str,
        command: str,
        vehicle: str | None,
        arguments: dict[str, object],
        result: str,
        detail: str | None,
        duration_s: float,
    ) -> Entry:
        """Notes a command; never fails and never waits."""
        entry = Entry(
            self._clock.unix_s(), client, command, vehicle, arguments, result, detail, round(duration_s, 4)
        )
        self._tail.append(entry)
        if self._path is not None:
            self._unwritten.append(entry)
            self._wake.set()
        return entry

    def tail(self, limit: int) -> list[Entry]:
        """The newest `limit` lines, newest first."""
        return list(self._tail)[: -limit - 1 : -1]

    def flush(self) -> None:
        """Writes what waits, now; a refusing disk becomes `warning`."""
        if self._path is None or not self._unwritten:
            return
        lines = "".join(json.dumps(asdict(e), allow_nan=False, default=str) + "\n" for e in self._unwritten)
        try:
            self._rotate(self._path)
            with self._path.open("a", encoding="utf-8") as file:
                file.write(lines)
        except OSError as error:
            text = f"The journal {self._path} cannot be written ({error.strerror or error}); commands go on."
            if self.warning is None:
                log.warning(text)
            self.warning = text
            return
        self._unwritten.clear()
        self.warning = None

    def _rotate(self, path: Path) -> None:
        with suppress(FileNotFoundError):
            if path.stat().st_size >= self._max_bytes:
                path.replace(path.with_suffix(f".1{path.suffix}"))

    async def _write_for_ever(self) -> None:
        while True:
            await self._wake.wait()
            self._wake.clear()
            self.flush()
            if self._unwritten:  # the disk refused: try again later, by itself
                await self._clock.sleep(5.0)
                self._wake.set()
