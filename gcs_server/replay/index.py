"""What is where in a recording: its bounds, places to start reading from, the frames that tell its story.

A recording may come from anybody. However it is made, its index stays within the bounds stated here; what an
index leaves out is counted.
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
"""Told again and again; only what differs from the time before is part of the story."""
STORY = STATES | {STATUSTEXT, EVENT, COMMAND_ACK}
MODE_COMMANDS = frozenset({20, 21, 22, 34, 176, 192, 300})
"""Whose acknowledgement tells who changed the mode; without the dialect, which takes a second to load."""
CHANGES_TOLD, TEXTS_TOLD = 2000, 500
"""Told again after a jump, at most: what a feed of messages shows, and more."""
KINDS_AT_MOST = 10_000
"""Most combinations of (system, component, message) that are indexed: enough for a hundred vehicles."""
STORY_AT_MOST = 50_000
"""Changes of state, and as many texts: a day of one each second, and more."""
CHECKPOINT_NUMBERS_AT_MOST = 2_000_000
"""Most numbers in all checkpoints together (16 MB); beyond it, every second checkpoint is dropped."""
DAMAGED_FROM = 0.5
"""Share of bytes that belong to no record from which a file is no telemetry log at all."""


class UnreadableRecording(ValueError):
    """Why nothing can be played, for people."""


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """A place to start reading, and what was newest there."""

    cursor: Cursor
    newest: array[int]
    """(time, offset) of each message's newest record before, one after the other."""


@dataclass(frozen=True, slots=True)
class Index:
    """The index of one recording, as it was when it was read."""

    begin_us: int
    end_us: int
    records: int
    bytes_skipped: int
    """Belonging to no record: damage."""
    size_bytes: int
    systems: tuple[int, ...]
    """System ids of the autopilots in it."""
    checkpoints: tuple[Checkpoint, ...]
    changes: array[int]
    """(time, offset) of each frame that tells another state than the one before."""
    texts: array[int]
    """(time, offset) of each status text and event."""
    first_heartbeats: tuple[tuple[int, int], ...]
    """(time, offset) of each autopilot's first; without it, the vehicle is not known."""
    left_out: int
    """Records beyond KINDS_AT_MOST or STORY_AT_MOST: a jump may miss what they tell."""

    def checkpoint(self, time_us: int) -> Checkpoint:
        """The last one at which nothing later than `time_us` had been read."""
        at = bisect.bisect_right(self.checkpoints, time_us, key=lambda c: c.cursor.time_us)
        return self.checkpoints[max(0, at - 1)]

    def told(self, until_us: int) -> list[tuple[int, int]]:
        """(time, offset) of what a feed of messages shows at that moment; the oldest may be left out."""
        newest = (_until(self.changes, until_us, CHANGES_TOLD), _until(self.texts, until_us, TEXTS_TOLD))
        return [pair for pairs in newest for pair in pairs]

    def story(self) -> list[tuple[int, int]]:
        """(time, offset) of all changes and texts, in their order."""
        flat = (self.changes, self.texts)
        return sorted(
            (pair for part in flat for pair in zip(part[::2], part[1::2], strict=True)), key=lambda p: p[1]
        )


def _until(flat: array[int], until_us: int, at_most: int) -> list[tuple[int, int]]:
    end = bisect.bisect_right(flat[::2], until_us)
    return [(flat[2 * i], flat[2 * i + 1]) for i in range(max(0, end - at_most), end)]


class _Story:
    """Notices what is new; fed with every record in order."""

    def __init__(self) -> None:
        self.changes: array[int] = array("q")
        self.texts: array[int] = array("q")
        self.first_heartbeats: dict[int, tuple[int, int]] = {}
        self.left_out = 0
        self._states: dict[int, bytes] = {}
        self._modes: dict[int, bytes] = {}

    def take(self, record: Record) -> None:
        raw, key = record.raw, record.key
        start = 10 if raw[0] == STX_V2 else 6
        payload = raw[start : start + raw[1]]
        kind = message_id(key)
        if kind == HEARTBEAT:
            if len(payload) < 9 or payload[5] == AUTOPILOT_INVALID or not system_id(key):
                return
            self.first_heartbeats.setdefault(system_id(key), (record.time_us, record.offset))
        if kind == COMMAND_ACK and int.from_bytes(payload[:2], "little") not in MODE_COMMANDS:
            return
        if kind in STATES:
            is_new = self._states.get(key) != payload
            self._states[key] = payload
            if (
                kind != EXTENDED_SYS_STATE
            ):  # both tell the mode: who says another than the last one did is news
                sender, mode = key >> 24, payload[:4].ljust(4, b"\0")
                is_new = is_new or self._modes.get(sender) != mode
                self._modes[sender] = mode
            if not is_new:
                return
        told = self.texts if kind in (STATUSTEXT, EVENT) else self.changes
        if len(told) < 2 * STORY_AT_MOST:
            told.extend((record.time_us, record.offset))
        else:
            self.left_out += 1


class _Checkpoints:
    """Places to start reading from: one each batch, and farther apart where they would grow too large."""

    def __init__(self) -> None:
        self.kept: list[Checkpoint] = []
        self._numbers = 0
        self._batches = 0
        self._every = 1

    def add(self, cursor: Cursor, newest: dict[int, tuple[int, int]]) -> None:
        self._batches += 1
        if (self._batches - 1) % self._every:
            return
        flat = array("q", [number for pair in newest.values() for number in pair])
        self.kept.append(Checkpoint(cursor, flat))
        self._numbers += len(flat)
        if self._numbers > CHECKPOINT_NUMBERS_AT_MOST:
            self.kept = self.kept[::2]
            self._numbers = sum(len(checkpoint.newest) for checkpoint in self.kept)
            self._every *= 2


def make_index(file: BinaryIO) -> Index:
    """Reads a whole log.

    Raises:
        UnreadableRecording: it holds no records, or is no telemetry log.
        OSError: the file cannot be read.
    """
    story, newest, checkpoints = _Story(), dict[int, tuple[int, int]](), _Checkpoints()
    batch = Batch([], Cursor(), at_end=False, bytes_skipped=0)
    begin_us = end_us = count = skipped = left_out = 0
    while not batch.at_end:
        checkpoints.add(batch.after, newest)
        batch = read_batch(file, batch.after)
        for record in batch.records:
            if record.key not in newest and len(newest) >= KINDS_AT_MOST:
                left_out += 1
                continue
            newest[record.key] = (record.time_us, record.offset)
            if record.key & 0xFFFFFF in STORY:
                story.take(record)
        if batch.records:
            begin_us = begin_us or batch.records[0].time_us
            end_us = batch.records[-1].time_us
        count += len(batch.records)
        skipped += batch.bytes_skipped
    size = batch.after.offset
    if not size:
        raise UnreadableRecording("The file is empty.")
    if not count or skipped > DAMAGED_FROM * size:
        raise UnreadableRecording("No MAVLink records found: this is not a telemetry log (.tlog).")
    return Index(
        begin_us,
        end_us,
        count,
        skipped,
        size,
        tuple(sorted(story.first_heartbeats)),
        tuple(checkpoints.kept),
        story.changes,
        story.texts,
        tuple(story.first_heartbeats.values()),
        left_out + story.left_out,
    )


def explain(path: Path, error: OSError) -> str:
    """A file's error in words."""
    return f"{path.name} cannot be read: {error.strerror or error}."
