"""Puts a streamed log together (docs.px4.io, "ULog File Format", and MAVLink's LOGGING_DATA): pure, no I/O.

Pieces have numbers; where some are lost, the log goes on at the next message that begins in a piece, and gets
a dropout message, so that what was put together is always a valid log.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

MAGIC = b"ULog\x01\x12\x35"
FILE_HEADER_BYTES = 16
NO_MESSAGE_BEGINS = 255
"""`first_message_offset` of a piece in which no message begins."""
KNOWN_TYPES = frozenset(b"BFIMPQADLCSRO")
"""Types of messages; any other says that something was lost without being noticed."""
MAX_REPEATED = 20
"""A begin that comes after so many pieces is no repeated one: definitions are sent one at a time."""
_MAX_DROPOUT_MS = 0xFFFF


@dataclass(slots=True)
class UlogPieces:
    """One log that arrives in pieces."""

    received: int = 0
    """Pieces that were used."""
    lost: int = 0
    """Pieces that did not arrive."""
    dropouts: int = 0
    """Gaps in the log."""
    began: bool = False
    """Whether the begin of the log has arrived."""
    begins_again: bool = False
    """Whether the vehicle has begun another log since: it has restarted, or another client asked for it."""
    _expected: int = 0
    _is_synced: bool = True
    _has_header: bool = False
    _partial: bytearray = field(default_factory=bytearray)
    _last_s: float = 0.0

    def add(self, sequence: int, first_message_offset: int, data: bytes, now_s: float) -> bytes:
        """Takes a piece; returns what is complete now: the file's header, or whole messages.

        Args:
            sequence: the piece's number, modulo 65536.
            first_message_offset: where the first message in it begins.
            data: its bytes.
            now_s: the time, monotonic [s].
        """
        is_begin = data.startswith(MAGIC)
        if not self.began:
            if not is_begin:
                return b""  # of an earlier stream
            self.began, self._expected, self._last_s = True, sequence, now_s
        ahead = (sequence - self._expected) & 0xFFFF
        if is_begin and self.received > MAX_REPEATED and ahead:
            self.begins_again = True
            return b""
        if ahead >= 0x8000:
            return b""  # repeated, or late
        gap = self._note_gap(ahead, now_s) if ahead else b""
        self._expected, self._last_s = (sequence + 1) & 0xFFFF, now_s
        self.received += 1
        if not self._is_synced:
            if first_message_offset >= len(data):
                return gap
            data = data[first_message_offset:]
            self._is_synced = True
        self._partial += data
        return gap + self._complete()

    def _note_gap(self, count: int, now_s: float) -> bytes:
        self.lost += count
        self._partial.clear()
        self._is_synced = False
        if not self._has_header:
            return b""
        self.dropouts += 1
        duration_ms = min(_MAX_DROPOUT_MS, max(1, round((now_s - self._last_s) * 1000)))
        return struct.pack("<HBH", 2, ord("O"), duration_ms)

    def _complete(self) -> bytes:
        at = 0
        if not self._has_header:
            if len(self._partial) < FILE_HEADER_BYTES:
                return b""
            self._has_header, at = True, FILE_HEADER_BYTES
        while len(self._partial) - at >= 3:
            size, kind = struct.unpack_from("<HB", self._partial, at)
            if kind not in KNOWN_TYPES:
                complete = bytes(self._partial[:at])
                self._partial.clear()
                self._is_synced = False
                return complete
            if len(self._partial) - at < 3 + size:
                break
            at += 3 + size
        complete = bytes(self._partial[:at])
        del self._partial[:at]
        return complete
