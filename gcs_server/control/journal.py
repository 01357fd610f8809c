"""The journal of commands: one line with client, command, time and result for each command, including refused
commands. A command never waits for the disk: a thread writes waiting lines in batches, and syncs each batch
to disk (fsync) before the next. If the disk fails, lines are lost on disk, but commands still work. Commands
that were refused before anything was sent are written to a separate file with its own size limit, so that
refusals cannot displace commands.
"""

from __future__ import annotations

import asyncio
import json
import logging
from collections import OrderedDict, deque
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, cast

from gcs_server.clock import Clock
from gcs_server.storage.line_log import LineLog
from gcs_server.supervise import Supervisor

log = logging.getLogger(__name__)

TAIL_LENGTH, REFUSED_TAIL_LENGTH = 1000, 300
"""Maximum numbers of commands and refusals in memory."""
QUEUE_LENGTH = 2000
"""Maximum number of lines of one file that wait for the disk."""
MAX_BYTES = 10_000_000
"""A file of this size is rotated to `journal.1.jsonl`."""
MAX_REFUSED_BYTES = 1_000_000
TAIL_BYTES = 1_000_000
"""Number of bytes of each file that are read at the start."""
MAX_TEXT_LENGTH = 500
MAX_ARGUMENTS_LENGTH = 4000
"""Maximum length of the arguments of one command as JSON [characters]."""
REPEAT_S = 10.0
"""Time after a refusal for which equal refusals are only counted [s]; then one line states their number."""
MAX_REPEATS = 500
"""Maximum number of different refusals whose repetitions are counted."""
RETRY_S = 5.0
NOT_SENT = frozenset(
    {
        "read",
        "invalid_request",
        "refused",
        "not_verified",
        "not_in_control",
        "not_permitted",
        "not_together",
        "unknown_vehicle",
        "unknown_link",
        "unknown_group",
        "unknown_recording",
    }
)
"""Result codes of commands that were refused before anything was sent, and of what agents only read."""


@dataclass(frozen=True, slots=True)
class JournalEntry:
    """One line of the journal."""

    unix_s: float
    client: str
    command: str
    vehicle: str | None
    arguments: dict[str, object]
    result: str
    """ok, or the error's code: refused, rejected, no_reply, …"""
    detail: str | None
    """Text of the error."""
    duration_s: float
    repeated: int = 1
    """Number of equal refusals for which this line was written."""


class _FileLines:
    """Lines of one file: the newest lines in memory, and the lines that wait for the disk."""

    def __init__(self, path: Path | None, max_bytes: int, max_in_memory: int) -> None:
        self.max_in_memory = max_in_memory
        self.line_log = None if path is None else LineLog(path, max_bytes)
        self.tail: deque[JournalEntry] = deque(maxlen=max_in_memory)
        self.unwritten: deque[JournalEntry] = deque()
        self.lost = 0
        """Lines dropped because the disk could not be written for too long."""

    def add(self, entry: JournalEntry) -> None:
        self.tail.append(entry)
        if self.line_log is not None:
            if len(self.unwritten) >= QUEUE_LENGTH:
                self.unwritten.popleft()
                self.lost += 1
            self.unwritten.append(entry)

    def take(self) -> list[JournalEntry]:
        entries = list(self.unwritten)
        self.unwritten.clear()
        return entries

    def put_back(self, entries: list[JournalEntry]) -> None:
        waiting = [*entries, *self.unwritten]
        self.lost += max(0, len(waiting) - QUEUE_LENGTH)
        self.unwritten = deque(waiting[-QUEUE_LENGTH:])


class Journal:
    """The append-only journal.

    Args:
        clock: clock for the times of entries.
        path: the file of commands (`journal.jsonl`; refusals go to `journal-refused.jsonl` beside it); None
            keeps the tail in memory only.
        max_bytes: size of one file of commands; two files are kept.
    """

    def __init__(self, clock: Clock, path: Path | None, *, max_bytes: int = MAX_BYTES) -> None:
        self._clock = clock
        self._path = path
        refused_path = None if path is None else path.with_name(f"{path.stem}-refused{path.suffix}")
        self._commands = _FileLines(path, max_bytes, TAIL_LENGTH)
        self._refusals = _FileLines(refused_path, MAX_REFUSED_BYTES, REFUSED_TAIL_LENGTH)
        self._repeats: OrderedDict[tuple[object, ...], tuple[float, int, JournalEntry]] = OrderedDict()
        """For equal refusals: time of the last line, number of refusals since then, and the newest entry."""
        self._wake = asyncio.Event()
        self.warning: str | None = None
        """Why lines cannot be written to disk; None: lines can be written."""

    async def load(self) -> None:
        """Reads the newest lines from before the server's start; invalid lines are skipped."""
        for file_lines in (self._commands, self._refusals):
            if file_lines.line_log is not None:
                lines = await asyncio.to_thread(file_lines.line_log.tail, TAIL_BYTES)
                newest = lines[-file_lines.max_in_memory :]
                entries = [entry for line in newest if (entry := _parse_entry(line)) is not None]
                free_entries = file_lines.max_in_memory - len(file_lines.tail)
                file_lines.tail.extendleft(reversed(entries[-free_entries:] if free_entries else []))

    def start(self, supervisor: Supervisor) -> None:
        """Starts writing."""
        if self._path is not None:
            supervisor.start("journal", self._write_loop)

    def add(
        self,
        client: str,
        command: str,
        vehicle: str | None,
        arguments: dict[str, object],
        result: str,
        detail: str | None,
        duration_s: float,
    ) -> JournalEntry:
        """Records a command; never fails and never waits."""
        entry = JournalEntry(
            self._clock.unix_s(),
            _shortened(client),
            _shortened(command),
            None if vehicle is None else _shortened(vehicle),
            _limit_length(arguments),
            result,
            None if detail is None else _shortened(detail),
            round(duration_s, 4),
        )
        if result not in NOT_SENT:
            self._commands.add(entry)
        elif not self._is_repeated(entry):
            self._refusals.add(entry)
        self._wake.set()
        return entry

    def tail(self, limit: int) -> list[JournalEntry]:
        """The newest `limit` lines, newest first; equal refusals that are still being counted appear as one
        line."""
        self._end_repeats()
        entries = [*self._commands.tail, *self._refusals.tail]
        return sorted(entries, key=lambda entry: entry.unix_s)[: -limit - 1 : -1]

    def of_vehicle(self, vehicle: str, begin_unix_s: float, end_unix_s: float) -> list[dict[str, object]]:
        """The commands to one vehicle between two times, oldest first, as far as they are in memory; also
        those that were refused."""
        return [
            asdict(entry)
            for entry in reversed(self.tail(TAIL_LENGTH + REFUSED_TAIL_LENGTH))
            if entry.vehicle == vehicle and begin_unix_s <= entry.unix_s <= end_unix_s
        ]

    def flush(self) -> None:
        """Writes all waiting lines, and returns when they are written; a write error becomes `warning`."""
        self._end_repeats(all_now=True)
        for file_lines in (self._commands, self._refusals):
            self._after_write(file_lines, entries := file_lines.take(), _append(file_lines, entries))

    # --- internal -------------------------------------------------------------------------------------

    def _is_repeated(self, entry: JournalEntry) -> bool:
        key = (entry.client, entry.command, entry.vehicle, entry.result, entry.detail)
        now_s = self._clock.monotonic_s()
        self._end_repeats()
        repeat = self._repeats.get(key)
        if repeat is None:
            while len(self._repeats) >= MAX_REPEATS:
                self._end_repeat(next(iter(self._repeats)))
            self._repeats[key] = (now_s, 0, entry)
            return False
        self._repeats[key] = (repeat[0], repeat[1] + 1, entry)
        return True

    def _end_repeats(self, *, all_now: bool = False) -> None:
        """Writes a line with the number of repeated refusals when their period has ended."""
        now_s = self._clock.monotonic_s()
        while self._repeats:  # in chronological order
            key = next(iter(self._repeats))
            if not all_now and now_s - self._repeats[key][0] < REPEAT_S:
                return
            self._end_repeat(key)

    def _end_repeat(self, key: tuple[object, ...]) -> None:
        _, count, newest = self._repeats.pop(key)
        if count:
            self._refusals.add(replace(newest, repeated=count))

    async def _write_loop(self) -> None:
        while True:
            try:
                async with asyncio.timeout(REPEAT_S if self._repeats else None):
                    await self._wake.wait()
            except TimeoutError:
                pass
            self._wake.clear()
            self._end_repeats()
            for file_lines in (self._commands, self._refusals):
                entries = file_lines.take()
                write = asyncio.to_thread(_append, file_lines, entries)
                try:
                    problem = await write
                except BaseException:
                    file_lines.put_back(entries)  # the server shuts down: `flush` may write some lines twice
                    raise
                self._after_write(file_lines, entries, problem)
            if self._commands.unwritten or self._refusals.unwritten:
                await self._clock.sleep(RETRY_S if self.warning is not None else 0.0)
                self._wake.set()

    def _after_write(self, file_lines: _FileLines, entries: list[JournalEntry], problem: str | None) -> None:
        if problem is None:
            if file_lines is self._commands or not self._commands.unwritten:
                self.warning = None
            return
        file_lines.put_back(entries)
        text = f"The journal {self._path} cannot be written ({problem}); commands still work."
        if file_lines.lost:
            text += f" {file_lines.lost} lines are lost."
        if self.warning is None:
            log.warning(text)
        self.warning = text


def _append(file_lines: _FileLines, entries: list[JournalEntry]) -> str | None:
    """Writes lines; returns None, or the reason for a failure. May be called in any thread."""
    if file_lines.line_log is None or not entries:
        return None
    text = "".join(json.dumps(asdict(entry), allow_nan=False, default=str) + "\n" for entry in entries)
    try:
        file_lines.line_log.append(text.encode())
    except OSError as error:
        return error.strerror or str(error)
    return None


def _shortened(text: str) -> str:
    return text if len(text) <= MAX_TEXT_LENGTH else f"{text[:MAX_TEXT_LENGTH]}… ({len(text)} characters)"


def _limit_length(arguments: dict[str, object]) -> dict[str, object]:
    if not arguments:
        return arguments
    try:
        text = json.dumps(arguments, default=str, allow_nan=False)
    except (ValueError, RecursionError):
        return {"left_out": "arguments that are not JSON"}
    if len(text) <= MAX_ARGUMENTS_LENGTH:
        return arguments
    return {"left_out": f"{len(text)} characters of arguments, which begin: {text[:MAX_TEXT_LENGTH]}"}


def _parse_entry(line: bytes) -> JournalEntry | None:
    """Parses a line; None if it is invalid."""
    try:
        fields = cast(dict[str, Any], json.loads(line))
        entry = JournalEntry(**fields)
    except (ValueError, TypeError, RecursionError):
        return None
    texts = [fields.get(name) or "" for name in ("client", "command", "result", "vehicle", "detail")]
    numbers = [fields.get(name, 1) for name in ("unix_s", "duration_s", "repeated")]
    is_valid = all(isinstance(text, str) for text in texts) and all(
        isinstance(number, int | float) and abs(number) < 1e12 for number in numbers
    )
    return entry if is_valid and isinstance(fields["arguments"], dict) else None
