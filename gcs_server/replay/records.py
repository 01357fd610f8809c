"""Records of a telemetry log: an 8-byte big-endian time (microseconds since 1970) and a raw MAVLink frame.

A recording may be damaged anywhere, so each record is checked: the frame must start with a MAVLink marker,
and the time must be close to the times of its neighbours. Bytes outside records are skipped and counted.
Returned times never run backwards and never jump by days, even if the clock of the recording computer did.
"""

from __future__ import annotations

import gzip
import os
import shutil
import struct
import tempfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, NamedTuple, cast

STX_V1, STX_V2 = 0xFE, 0xFD
TIME_BYTES = 8
MIN_FRAME_BYTES = 8
BATCH_BYTES = 1 << 18
PLAUSIBLE_US = (10**14, 10**16)
"""Range of plausible times, 1973 to 2286; a record with a time outside this range is damaged."""
SAME_CLOCK_US = 86_400_000_000
"""Maximum time between neighbouring records; if two are farther apart, one of them is damaged or the clock
was set."""
JITTER_US = 2_000_000
"""Maximum step backwards between two records. Such steps occur because two threads write; a larger step means
that the clock was set."""
MAX_UNPACKED_BYTES = 4_000_000_000
KEEP_FREE_BYTES = 500_000_000
"""Disk space that unpacking must leave free, because a flight may be recorded at the same time."""

_time = struct.Struct(">Q")


class Record(NamedTuple):
    """One frame and its position."""

    time_us: int
    offset: int
    key: int
    """System, component and message id in one number."""
    raw: bytes


@dataclass(frozen=True, slots=True)
class Cursor:
    """The position where reading continues."""

    offset: int = 0
    time_us: int = 0
    """Time of the newest record before the cursor; 0 if there is none."""
    shift_us: int = 0
    """Correction that is added to the recorded times, because the recording clock was set."""


@dataclass(frozen=True, slots=True)
class Batch:
    """The records of one part of the file."""

    records: list[Record]
    after: Cursor
    at_end: bool
    bytes_skipped: int


def message_id(key: int) -> int:
    """The message id of a record's key."""
    return key & 0xFFFFFF


def system_id(key: int) -> int:
    """The system id of a record's key."""
    return key >> 32


def open_log(path: Path) -> BinaryIO:
    """Opens a recording for random access; unpacks a `.gz` into an unnamed temporary file.

    Raises:
        OSError: the file cannot be read, or its content does not match its name.
    """
    if path.suffix != ".gz":
        return path.open("rb")
    unpacked = cast(BinaryIO, tempfile.TemporaryFile())  # noqa: SIM115 the caller closes it
    try:
        for piece in unpack(path):
            if shutil.disk_usage(tempfile.gettempdir()).free < KEEP_FREE_BYTES:
                raise OSError("there is too little free disk space to unpack it")
            unpacked.write(piece)
        unpacked.flush()
    except BaseException:
        unpacked.close()
        raise
    return unpacked


def unpack(path: Path) -> Iterator[bytes]:
    """Unpacks a gzip file; of an incomplete file, as much as possible.

    Raises:
        OSError: the file cannot be read, is not a gzip file, or is larger than MAX_UNPACKED_BYTES when
            unpacked.
    """
    unpacked_bytes = 0
    with gzip.open(path, "rb") as file:
        while True:
            try:
                piece = file.read(BATCH_BYTES)
            except (EOFError, zlib.error):
                return
            if not piece:
                return
            unpacked_bytes += len(piece)
            if unpacked_bytes > MAX_UNPACKED_BYTES:
                raise OSError(f"it unpacks to more than {MAX_UNPACKED_BYTES // 10**9} GB")
            yield piece


def read_batch(file: BinaryIO, cursor: Cursor) -> Batch:
    """Reads the next records at the cursor, without changing the file's position.

    Raises:
        OSError: the file cannot be read.
    """
    data = os.pread(file.fileno(), BATCH_BYTES, cursor.offset)
    return parse(data, cursor, is_last=len(data) < BATCH_BYTES)


def read_tlog(path: Path) -> Iterator[tuple[int, bytes]]:
    """(time in microseconds since 1970, raw frame) of each record; reads `.gz` too.

    Raises:
        OSError: the file cannot be read.
    """
    with open_log(path) as file:
        batch = Batch([], Cursor(), at_end=False, bytes_skipped=0)
        while not batch.at_end:
            batch = read_batch(file, batch.after)
            for record in batch.records:
                yield record.time_us, record.raw


def read_at(file: BinaryIO, offset: int) -> bytes:
    """The raw frame of the record at `offset`."""
    data = os.pread(file.fileno(), TIME_BYTES + 10 + 255 + 2 + 13, offset)
    return data[TIME_BYTES : TIME_BYTES + _frame_length(data, TIME_BYTES)]


def parse(data: bytes, cursor: Cursor, *, is_last: bool) -> Batch:
    """Parses the complete records of `data`, which was read at the cursor; `is_last`: the file ends with
    `data`."""
    records: list[Record] = []
    position, skipped, size = 0, 0, len(data)
    time_us, shift_us = cursor.time_us, cursor.shift_us
    while size - position >= TIME_BYTES + MIN_FRAME_BYTES:
        frame_start = position + TIME_BYTES
        length = _frame_length(data, frame_start)
        stamp_us = _time.unpack_from(data, position)[0]
        is_record = bool(length) and PLAUSIBLE_US[0] < stamp_us < PLAUSIBLE_US[1]
        if is_record and frame_start + length > size:
            if not is_last:
                break
            is_record = False
        if is_record and time_us:
            is_neighbour = -JITTER_US <= stamp_us + shift_us - time_us < SAME_CLOCK_US
        else:
            is_neighbour = cursor.offset + position == 0  # a recording starts with a record
        if is_record and not is_neighbour:
            following = frame_start + length
            if position and not is_last and size - following < TIME_BYTES + MIN_FRAME_BYTES:
                break  # checked again with the next batch
            is_record = _record_follows(data, following, stamp_us)
        if not is_record:
            step = _next_start(data, position + TIME_BYTES + 1, size) - TIME_BYTES - position
            step = max(1, step)
            skipped += step
            position += step
            continue
        jump_us = stamp_us + shift_us - time_us
        if time_us and (jump_us < -JITTER_US or jump_us > SAME_CLOCK_US):
            shift_us -= jump_us
            jump_us = 0
        time_us = max(time_us, stamp_us + shift_us)
        records.append(
            Record(
                time_us,
                cursor.offset + position,
                _key(data, frame_start),
                data[frame_start : frame_start + length],
            )
        )
        position = frame_start + length
    if is_last:
        skipped += size - position
        position = size
    after = Cursor(cursor.offset + position, time_us, shift_us)
    return Batch(records, after, is_last, skipped)


def _record_follows(data: bytes, position: int, stamp_us: int) -> bool:
    """Whether a record with about the same time starts at this position."""
    if len(data) - position < TIME_BYTES + MIN_FRAME_BYTES:
        return False
    is_near = abs(_time.unpack_from(data, position)[0] - stamp_us) < SAME_CLOCK_US
    return is_near and _frame_length(data, position + TIME_BYTES) > 0


def _next_start(data: bytes, position: int, size: int) -> int:
    v2 = data.find(STX_V2, position)
    v1 = data.find(STX_V1, position, v2 if v2 >= 0 else size)
    return v1 if v1 >= 0 else v2 if v2 >= 0 else size


def _frame_length(data: bytes, frame_start: int) -> int:
    if data[frame_start] == STX_V2:
        return 12 + data[frame_start + 1] + (13 if data[frame_start + 2] & 1 else 0)
    return 8 + data[frame_start + 1] if data[frame_start] == STX_V1 else 0


def _key(data: bytes, frame_start: int) -> int:
    if data[frame_start] == STX_V2:
        return (
            data[frame_start + 5] << 32
            | data[frame_start + 6] << 24
            | int.from_bytes(data[frame_start + 7 : frame_start + 10], "little")
        )
    return data[frame_start + 3] << 32 | data[frame_start + 4] << 24 | data[frame_start + 5]
