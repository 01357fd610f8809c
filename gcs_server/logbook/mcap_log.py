"""Reads an MCAP file into the values of `log.py`: a ROS 2 recording of PX4's topics (px4_msgs as CDR), or a
file that this program has written (JSON, `exports/mcap_file.py`)."""

from __future__ import annotations

import struct
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk

from gcs_server.logbook.log import MAX_TOPICS, Log, UnreadableLog, limit_fields
from gcs_server.logbook.px4_recording import Sampled, px4_log
from gcs_server.logbook.ros2_layout import (
    BIG_ENDIAN,
    HEADER_BYTES,
    LITTLE_ENDIAN,
    Layout,
    NoLayout,
    layout_of,
)
from gcs_server.logbook.written_log import JsonSamples, WrittenFacts, written_log

MAX_RECORD_BYTES = 100_000_000
MAX_CHUNK_BYTES = 200_000_000
"""Maximum size of a chunk once it is decompressed."""
MAX_VALUE_BYTES = 400_000_000
"""Size of all samples that are kept; what comes later is left out."""
MAX_TIME_NS = 1 << 62
MAX_NAMED = 5
"""Topics that a problem names."""
_DAMAGE = (
    McapError,
    struct.error,
    ValueError,
    KeyError,
    RuntimeError,
    OverflowError,
    MemoryError,
    zstandard.ZstdError,
)
"""What the package and its decompressors raise on a damaged file (UnicodeError is a ValueError); MemoryError
if it says that something is gigantic."""


@dataclass(slots=True)
class _Cdr:
    """The samples of a channel whose messages have one layout."""

    layout: Layout
    order: str = ""
    """NumPy's sign of the byte order; that of the first message counts."""
    payloads: bytearray = field(default_factory=bytearray)

    def add(self, data: bytes) -> bool:
        """Keeps a message; False: it has another size or encoding."""
        order = {LITTLE_ENDIAN: "<", BIG_ENDIAN: ">"}.get(data[:2], "")
        body = data[HEADER_BYTES : HEADER_BYTES + self.layout.size]
        self.order = self.order or order
        if not order or order != self.order or len(body) < self.layout.size:
            return False
        self.payloads += body
        return True

    def columns(self) -> dict[str, np.ndarray[Any, Any]]:
        """The values by field."""
        rows = np.frombuffer(self.payloads, self.layout.dtype(self.order or "<"))
        return {name: rows[name] for name in self.layout.names}


@dataclass(slots=True)
class _Kept:
    """What is kept of a channel."""

    channel: Channel
    samples: _Cdr | JsonSamples
    times_ns: array[int] = field(default_factory=lambda: array("q"))


class _Reader:
    def __init__(self) -> None:
        self.kept: dict[int, _Kept | None] = {}
        """By the channel's id; None: it is left out."""
        self.facts = WrittenFacts()
        self.problems: list[str] = []
        self._schemas: dict[int, Schema] = {}
        self._reasons: dict[str, list[str]] = {}
        """Topics that are left out, by the reason."""
        self._bytes = self._damaged = 0

    def read(self, records: Iterator[Any]) -> None:
        """Reads records until one is damaged."""
        try:
            for record in records:
                if isinstance(record, Chunk):
                    self._read_chunk(record)
                else:
                    self._add(record)
        except _DAMAGE:
            self.problems.append("The file ends early or is damaged; what comes after is left out.")

    def _read_chunk(self, chunk: Chunk) -> None:
        if chunk.uncompressed_size > MAX_CHUNK_BYTES or _lz4_size(chunk) > MAX_CHUNK_BYTES:
            self._damaged += 1
            return
        try:
            records = breakup_chunk(chunk, validate_crc=True)
        except _DAMAGE:
            self._damaged += 1
            return
        for record in records:
            self._add(record)

    def _add(self, record: Any) -> None:
        if isinstance(record, Message):
            self._add_message(record)
        elif isinstance(record, Schema):
            self._schemas.setdefault(record.id, record)
        elif isinstance(record, Channel):
            if record.id not in self.kept:
                self.kept[record.id] = self._channel(record)
        elif isinstance(record, Metadata):
            self.facts.add(record.name, record.metadata)

    def _channel(self, channel: Channel) -> _Kept | None:
        schema = self._schemas.get(channel.schema_id)
        reason = "are neither PX4's messages nor JSON"
        if len(self.kept) >= 2 * MAX_TOPICS:
            reason = "are too many"
        elif channel.message_encoding == "json":
            return _Kept(channel, JsonSamples(channel.metadata, None if schema is None else schema.name))
        elif channel.message_encoding == "cdr" and schema is not None and schema.encoding == "ros2msg":
            try:
                return _Kept(channel, _Cdr(layout_of(schema.data.decode("utf-8", "replace"))))
            except NoLayout:
                reason = "have texts or sequences, which are not plotted"
        self._reasons.setdefault(reason, []).append(channel.topic)
        return None

    def _add_message(self, message: Message) -> None:
        kept = self.kept.get(message.channel_id)
        if kept is None:
            return
        self._bytes += len(message.data)
        if self._bytes > MAX_VALUE_BYTES:
            return
        if not 0 <= message.log_time < MAX_TIME_NS or not kept.samples.add(message.data):
            self._damaged += 1
            return
        kept.times_ns.append(message.log_time)

    def sampled(self) -> list[Sampled]:
        """The channels with samples."""
        found: list[Sampled] = []
        for kept in self.kept.values():
            if kept is None or not kept.times_ns:
                continue
            times_ns = np.frombuffer(kept.times_ns, np.int64)
            found.append(Sampled(kept.channel.topic, times_ns, kept.samples.columns()))
        return found

    def json_channels(self) -> list[tuple[JsonSamples, np.ndarray[Any, Any]]]:
        """The samples of JSON with their times [ns]."""
        return [
            (kept.samples, np.frombuffer(kept.times_ns, np.int64))
            for kept in self.kept.values()
            if kept is not None and kept.times_ns and isinstance(kept.samples, JsonSamples)
        ]

    def notes(self) -> list[str]:
        """What is left out, as sentences."""
        notes = list(self.problems)
        if self._damaged:
            notes.append(f"{self._damaged:,} messages or chunks are damaged and left out.")
        if self._bytes > MAX_VALUE_BYTES:
            notes.append(f"Only the first {MAX_VALUE_BYTES // 1_000_000} MB of its values are read.")
        for reason, topics in self._reasons.items():
            named = ", ".join(topic[:60] for topic in topics[:MAX_NAMED])
            more = f" and {len(topics) - MAX_NAMED:,} more" if len(topics) > MAX_NAMED else ""
            notes.append(f"Topics that {reason} are left out: {named}{more}.")
        return notes


def _lz4_size(chunk: Chunk) -> int:
    """What an LZ4 frame says of its size; the package decompresses it without a limit."""
    if chunk.compression != "lz4":
        return 0
    try:
        return int(lz4.frame.get_frame_info(chunk.data)["content_size"])
    except (RuntimeError, KeyError, ValueError):
        return MAX_CHUNK_BYTES + 1


def read_mcap(path: Path) -> Log:
    """Reads a file.

    Raises:
        UnreadableLog: it is no MCAP file, or has none of PX4's topics.
        OSError: the file cannot be read.
    """
    reader = _Reader()
    with path.open("rb") as file:
        if file.read(8) != b"\x89MCAP0\r\n":
            raise UnreadableLog("This is not an MCAP file: its first bytes are different.")
        stream = StreamReader(file, skip_magic=True, emit_chunks=True, record_size_limit=MAX_RECORD_BYTES)
        reader.read(stream.records)
    notes = reader.notes()
    if not any(kept is not None and kept.times_ns for kept in reader.kept.values()):
        raise UnreadableLog(" ".join(["The MCAP file has no messages that are known here.", *notes]))
    is_written = reader.facts.is_written
    log = written_log(reader.facts, reader.json_channels()) if is_written else px4_log(reader.sampled())
    log.problems = [*notes, *log.problems]
    log.topics = limit_fields(log.topics, log.problems)
    if not log.topics:
        raise UnreadableLog("The MCAP file has no values that can be plotted.")
    return log
