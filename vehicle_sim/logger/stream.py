"""The log as PX4 streams it over MAVLink (LOGGING_DATA): the same messages as in the file, in pieces of 249
bytes. Definitions are sent one piece at a time and repeated until they are acknowledged; samples are sent
once.
"""

from __future__ import annotations

import struct
from collections import deque
from dataclasses import dataclass
from typing import Final

PIECE_BYTES: Final = 249
NO_MESSAGE_BEGINS: Final = 255
"""`first_message_offset` of a piece in which no message begins."""
FILE_HEADER_BYTES: Final = 16
ACK_TIMEOUT_US: Final = 50_000
ACK_MAX_TRIES: Final = 50
"""PX4's ulog_stream_ack: each piece is sent this often, then the stream ends."""
MAX_WAITING: Final = 4096
"""Pieces that wait; further ones are lost, as in PX4 when its queue is full."""
PIECES_PER_STEP: Final = 40
"""With 250 steps a second more than any log has."""


@dataclass(frozen=True, slots=True)
class Piece:
    """The content of one LOGGING_DATA or LOGGING_DATA_ACKED."""

    sequence: int
    first_message_offset: int
    data: bytes
    acked: bool


class UlogStream:
    """Cuts a log into pieces, and says which are to be sent now.

    Args:
        definitions: the log's header, formats, parameters and subscriptions.
    """

    def __init__(self, definitions: bytes) -> None:
        self._waiting: deque[Piece] = deque()
        self._sequence = 0
        self._rest, self._first_offset = bytearray(), NO_MESSAGE_BEGINS
        self._unacknowledged: Piece | None = None
        self._sent_at_us = self._tries = 0
        self.ended = False
        """Whether the client has not acknowledged a piece."""
        head, messages = definitions[:FILE_HEADER_BYTES], definitions[FILE_HEADER_BYTES:]
        self._append(head, acked=True)
        self._cut(messages, acked=True)
        if self._rest:
            self._finish_piece(acked=True)

    def add(self, messages: bytes) -> None:
        """Adds complete messages of samples."""
        self._cut(messages, acked=False)

    def acknowledge(self, sequence: int) -> None:
        """The client has received a piece."""
        if self._unacknowledged is not None and self._unacknowledged.sequence == sequence:
            self._unacknowledged = None

    def due(self, now_us: int) -> list[Piece]:
        """The pieces to send now."""
        piece = self._unacknowledged
        if piece is not None:
            if now_us - self._sent_at_us < ACK_TIMEOUT_US:
                return []
            self._tries += 1
            self._sent_at_us = now_us
            self.ended = self._tries > ACK_MAX_TRIES
            return [] if self.ended else [piece]
        pieces: list[Piece] = []
        while self._waiting and len(pieces) < PIECES_PER_STEP:
            piece = self._waiting.popleft()
            pieces.append(piece)
            if piece.acked:
                self._unacknowledged, self._sent_at_us, self._tries = piece, now_us, 1
                break
        return pieces

    def _cut(self, messages: bytes, *, acked: bool) -> None:
        at = 0
        while at < len(messages):
            (size,) = struct.unpack_from("<H", messages, at)
            self._append(messages[at : at + 3 + size], acked=acked)
            at += 3 + size

    def _append(self, message: bytes, *, acked: bool) -> None:
        begin = 0
        is_begin = True
        while begin < len(message):
            if is_begin and self._first_offset == NO_MESSAGE_BEGINS:
                self._first_offset = len(self._rest)
            is_begin = False
            part = message[begin : begin + PIECE_BYTES - len(self._rest)]
            self._rest += part
            begin += len(part)
            if len(self._rest) == PIECE_BYTES:
                self._finish_piece(acked=acked)

    def _finish_piece(self, *, acked: bool) -> None:
        piece = Piece(self._sequence, self._first_offset, bytes(self._rest), acked)
        self._sequence = (self._sequence + 1) & 0xFFFF
        self._rest, self._first_offset = bytearray(), NO_MESSAGE_BEGINS
        if acked or len(self._waiting) < MAX_WAITING:
            self._waiting.append(piece)
