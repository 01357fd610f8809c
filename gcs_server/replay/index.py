"""What is where in a recording: its bounds, places to start reading from, the frames that tell its story.

Made by a process of its own (`python -m gcs_server.replay.index FILE`), because reading a long log takes
seconds of Python, and those belong to the vehicles in the air.
"""

from __future__ import annotations

import bisect
import json
import os
import subprocess
import sys
from array import array
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from gcs_server.replay.records import (
    STX_V2,
    Batch,
    Cursor,
    Record,
    message_id,
    open_log,
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
NICENESS = 10
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
    """Of one recording, as it was when it was read."""

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
        told.extend((record.time_us, record.offset))


def make_index(file: BinaryIO) -> Index:
    """Reads a whole log.

    Raises:
        UnreadableRecording: it holds no records, or is no telemetry log.
        OSError: the file cannot be read.
    """
    story, newest, checkpoints = _Story(), dict[int, tuple[int, int]](), list[Checkpoint]()
    batch = Batch([], Cursor(), at_end=False, bytes_skipped=0)
    begin_us = end_us = count = skipped = 0
    while not batch.at_end:
        flat = array("q", [number for pair in newest.values() for number in pair])
        checkpoints.append(Checkpoint(batch.after, flat))
        batch = read_batch(file, batch.after)
        for record in batch.records:
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
        raise UnreadableRecording("It holds no MAVLink records: it is no telemetry log (.tlog).")
    return Index(
        begin_us,
        end_us,
        count,
        skipped,
        size,
        tuple(sorted(story.first_heartbeats)),
        tuple(checkpoints),
        story.changes,
        story.texts,
        tuple(story.first_heartbeats.values()),
    )


class IndexProcess:
    """Makes an index in a process of its own; `run` is for a worker thread, `stop` for any."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._process: subprocess.Popen[bytes] | None = None
        self._stopped = False

    def run(self) -> Index:
        """Waits for the process.

        Raises:
            UnreadableRecording: what is wrong with the file, in words.
        """
        command = [sys.executable, "-m", "gcs_server.replay.index", str(self._path)]
        with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE) as process:
            self._process = process
            if self._stopped:
                process.kill()
            output, _ = process.communicate()
        if process.returncode or not output:
            raise UnreadableRecording("Reading it was broken off.")
        answer = json.loads(output)
        if "problem" in answer:
            raise UnreadableRecording(answer["problem"])
        return _from_json(answer)

    def stop(self) -> None:
        """Its result is not wanted any more."""
        self._stopped = True
        if self._process is not None:
            self._process.kill()


def _to_json(index: Index) -> dict[str, Any]:
    return {
        "begin_us": index.begin_us,
        "end_us": index.end_us,
        "records": index.records,
        "bytes_skipped": index.bytes_skipped,
        "size_bytes": index.size_bytes,
        "systems": index.systems,
        "checkpoints": [
            (c.cursor.offset, c.cursor.time_us, c.cursor.shift_us, list(c.newest)) for c in index.checkpoints
        ],
        "changes": list(index.changes),
        "texts": list(index.texts),
        "first_heartbeats": index.first_heartbeats,
    }


def _from_json(answer: dict[str, Any]) -> Index:
    return Index(
        begin_us=answer["begin_us"],
        end_us=answer["end_us"],
        records=answer["records"],
        bytes_skipped=answer["bytes_skipped"],
        size_bytes=answer["size_bytes"],
        systems=tuple(answer["systems"]),
        checkpoints=tuple(
            Checkpoint(Cursor(offset, time_us, shift_us), array("q", newest))
            for offset, time_us, shift_us, newest in answer["checkpoints"]
        ),
        changes=array("q", answer["changes"]),
        texts=array("q", answer["texts"]),
        first_heartbeats=tuple((time_us, offset) for time_us, offset in answer["first_heartbeats"]),
    )


def explain(path: Path, error: OSError) -> str:
    """A file's error in words."""
    return f"{path.name} cannot be read: {error.strerror or error}."


def main(arguments: list[str]) -> None:
    """Prints the index of the file named, or what is wrong with it, as JSON."""
    os.nice(NICENESS)
    path = Path(arguments[0])
    try:
        with open_log(path) as file:
            answer = _to_json(make_index(file))
    except UnreadableRecording as error:
        answer = {"problem": str(error)}
    except OSError as error:
        answer = {"problem": explain(path, error)}
    json.dump(answer, sys.stdout)


if __name__ == "__main__":
    main(sys.argv[1:])
