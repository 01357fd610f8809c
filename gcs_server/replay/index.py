"""The index of a recording: bounds, checkpoints from which reading can start, and frames with events or
changes. A recording is untrusted, so the size of its index is limited; omitted records are counted.
"""

from __future__ import annotations

import bisect
from array import array
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from gcs_server.replay.records import (
    STX_V2,
    Batch,
    Cursor,
    Record,
    message_id,
    read_batch,
    system_id,
)

HEARTBEAT, COMMAND_ACK, EXTENDED_SYS_STATE, STATUSTEXT, EVENT, CURRENT_MODE = 0, 77, 245, 253, 410, 436
AUTOPILOT_INVALID = 8
STATES = frozenset({HEARTBEAT, EXTENDED_SYS_STATE, CURRENT_MODE})
"""Repeated messages; the index contains only their changes."""
EVENT_MESSAGES = STATES | {STATUSTEXT, EVENT, COMMAND_ACK}
MODE_COMMANDS = frozenset({20, 21, 22, 34, 176, 192, 300})
"""Commands whose acknowledgement shows who changed the mode. Their numbers are listed here because loading
the dialect takes a second."""
CHANGES_RESTORED, TEXTS_RESTORED = 2000, 500
"""Maximum number of changes and texts restored after a jump."""
MAX_KEYS = 10_000
"""Maximum number of (system, component, message) combinations, enough for a hundred vehicles."""
MAX_EVENT_RECORDS = 50_000
"""Maximum number of state changes, and of texts; more than one per second for a day."""
MAX_CHECKPOINT_NUMBERS = 2_000_000
"""Maximum total length of all checkpoint arrays (16 MB); above it, every second checkpoint is dropped."""
MAX_DAMAGED_FRACTION = 0.5
"""Fraction of bytes outside records above which a file is not a telemetry log."""


class UnreadableRecording(ValueError):
    """A recording cannot be played; the text says why."""


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """A position from which reading can start, with the newest records before it."""

    cursor: Cursor
    newest: array[int]
    """(time, offset) of the newest earlier record of each message, flattened."""


@dataclass(frozen=True, slots=True)
class Index:
    """The index of one recording."""

    begin_us: int
    end_us: int
    records: int
    bytes_skipped: int
    """Bytes outside records (damage)."""
    size_bytes: int
    systems: tuple[int, ...]
    """System ids of the autopilots in the recording."""
    checkpoints: tuple[Checkpoint, ...]
    changes: array[int]
    """(time, offset) of each frame with a changed state."""
    texts: array[int]
    """(time, offset) of each status text and event."""
    first_heartbeats: tuple[tuple[int, int], ...]
    """(time, offset) of each autopilot's first heartbeat, which adds the vehicle."""
    left_out: int
    """Records beyond MAX_KEYS or MAX_EVENT_RECORDS; they may be missing after a jump."""

    def checkpoint(self, time_us: int) -> Checkpoint:
        """The last checkpoint before `time_us`."""
        position = bisect.bisect_right(self.checkpoints, time_us, key=lambda c: c.cursor.time_us)
        return self.checkpoints[max(0, position - 1)]

    def events_until(self, until_us: int) -> list[tuple[int, int]]:
        """(time, offset) of events to restore at a time; the oldest may be left out."""
        newest = (
            _newest_until(self.changes, until_us, CHANGES_RESTORED),
            _newest_until(self.texts, until_us, TEXTS_RESTORED),
        )
        return [pair for pairs in newest for pair in pairs]

    def events(self) -> list[tuple[int, int]]:
        """(time, offset) of all changes and texts, in order."""
        flat = (self.changes, self.texts)
        return sorted(
            (pair for part in flat for pair in zip(part[::2], part[1::2], strict=True)), key=lambda p: p[1]
        )


def _newest_until(flat: array[int], until_us: int, at_most: int) -> list[tuple[int, int]]:
    end = bisect.bisect_right(flat[::2], until_us)
    return [(flat[2 * i], flat[2 * i + 1]) for i in range(max(0, end - at_most), end)]


class _EventFinder:
    """Finds state changes, texts and first heartbeats; called with every record in order."""

    def __init__(self) -> None:
        self.changes: array[int] = array("q")
        self.texts: array[int] = array("q")
        self.first_heartbeats: dict[int, tuple[int, int]] = {}
        self.left_out = 0
        self._states: dict[int, bytes] = {}
        self._modes: dict[int, bytes] = {}

    def add(self, record: Record) -> None:
        raw, key = record.raw, record.key
        start = 10 if raw[0] == STX_V2 else 6
        payload = raw[start : start + raw[1]]
        msg_id = message_id(key)
        if msg_id == HEARTBEAT:
            if len(payload) < 9 or payload[5] == AUTOPILOT_INVALID or not system_id(key):
                return
            self.first_heartbeats.setdefault(system_id(key), (record.time_us, record.offset))
        if msg_id == COMMAND_ACK and int.from_bytes(payload[:2], "little") not in MODE_COMMANDS:
            return
        if msg_id in STATES:
            is_new = self._states.get(key) != payload
            self._states[key] = payload
            if msg_id != EXTENDED_SYS_STATE:  # HEARTBEAT and CURRENT_MODE both contain the mode
                sender, mode = key >> 24, payload[:4].ljust(4, b"\0")
                is_new = is_new or self._modes.get(sender) != mode
                self._modes[sender] = mode
            if not is_new:
                return
        records = self.texts if msg_id in (STATUSTEXT, EVENT) else self.changes
        if len(records) < 2 * MAX_EVENT_RECORDS:
            records.extend((record.time_us, record.offset))
        else:
            self.left_out += 1


class _Checkpoints:
    """Collects checkpoints: one per batch, fewer if they would become too large."""

    def __init__(self) -> None:
        self.checkpoints: list[Checkpoint] = []
        self._numbers = 0
        self._batches = 0
        self._stride = 1

    def add(self, cursor: Cursor, newest: dict[int, tuple[int, int]]) -> None:
        self._batches += 1
        if (self._batches - 1) % self._stride:
            return
        flat = array("q", [number for pair in newest.values() for number in pair])
        self.checkpoints.append(Checkpoint(cursor, flat))
        self._numbers += len(flat)
        if self._numbers > MAX_CHECKPOINT_NUMBERS:
            self.checkpoints = self.checkpoints[::2]
            self._numbers = sum(len(checkpoint.newest) for checkpoint in self.checkpoints)
            self._stride *= 2


def make_index(file: BinaryIO) -> Index:
    """Reads a whole recording.

    Raises:
        UnreadableRecording: the file has no records, or is not a telemetry log.
        OSError: the file cannot be read.
    """
    finder, newest, checkpoints = _EventFinder(), dict[int, tuple[int, int]](), _Checkpoints()
    batch = Batch([], Cursor(), at_end=False, bytes_skipped=0)
    begin_us = end_us = count = skipped = left_out = 0
    while not batch.at_end:
        checkpoints.add(batch.after, newest)
        batch = read_batch(file, batch.after)
        for record in batch.records:
            if record.key not in newest and len(newest) >= MAX_KEYS:
                left_out += 1
                continue
            newest[record.key] = (record.time_us, record.offset)
            if record.key & 0xFFFFFF in EVENT_MESSAGES:
                finder.add(record)
        if batch.records:
            begin_us = begin_us or batch.records[0].time_us
            end_us = batch.records[-1].time_us
        count += len(batch.records)
        skipped += batch.bytes_skipped
    size = batch.after.offset
    if not size:
        raise UnreadableRecording("The file is empty.")
    if not count or skipped > MAX_DAMAGED_FRACTION * size:
        raise UnreadableRecording("No MAVLink records found: this is not a telemetry log (.tlog).")
    return Index(
        begin_us,
        end_us,
        count,
        skipped,
        size,
        tuple(sorted(finder.first_heartbeats)),
        tuple(checkpoints.checkpoints),
        finder.changes,
        finder.texts,
        tuple(finder.first_heartbeats.values()),
        left_out + finder.left_out,
    )


def explain(path: Path, error: OSError) -> str:
    """The error of a file as text."""
    return f"{path.name} cannot be read: {error.strerror or error}."
