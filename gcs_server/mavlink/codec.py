"""Converts bytes to frames and back. No I/O; only `decode` and `encode_payload` use message objects.

Frame layouts and the checksum are those of the MAVLink guide ("Packet serialization"): MAVLink 1 has a
6-byte header, MAVLink 2 a 10-byte header; if incompatibility flag 1 is set, a 13-byte signature follows the
checksum.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import fastcrc

from gcs_server.mavlink.dialect import MAVLink_header, MAVLink_message
from gcs_server.mavlink.signing import FrameSigner
from gcs_server.mavlink.tables import CRC_EXTRA, LAYOUTS

STX_V1, STX_V2 = 0xFE, 0xFD
HEADER_V1, HEADER_V2, CHECKSUM, SIGNATURE = 6, 10, 2, 13
"""Lengths of the parts of a frame [bytes]."""
MIN_V2_BYTES = HEADER_V2 + CHECKSUM
SIGNED = 0x01

_crc = fastcrc.crc16.mcrf4xx
_header_v2 = struct.Struct("<BBBBBBBHB")
_sender_and_id = struct.Struct("<4xBBBHB").unpack_from
"""Sequence number, system, component, and the message id's low and high part, from a MAVLink 2 frame."""
_checksum = struct.Struct("<H")


@dataclass(slots=True, eq=False)
class Frame:
    """One checked frame. The payload is extracted only on request, because few frames are decoded."""

    msg_id: int
    system_id: int
    component_id: int
    seq: int
    raw: bytes
    received_monotonic_s: float
    known: bool = True
    """Whether the message is in the dialect; the checksum of an unknown message cannot be checked."""

    @property
    def payload(self) -> bytes:
        """The payload without the trailing zeros that MAVLink 2 removes."""
        raw = self.raw
        start = HEADER_V2 if raw[0] == STX_V2 else HEADER_V1
        return raw[start : start + raw[1]]


class FrameParser:
    """Splits the bytes of one peer into frames. A byte that does not start a valid frame is skipped and
    counted, so that parsing continues after bytes that are not MAVLink. An unknown message cannot be checked;
    it is accepted if another frame or the end of the data follows.
    """

    __slots__ = (
        "_incomplete",
        "_next_seq",
        "bytes_skipped",
        "crc_errors",
        "frames",
        "frames_signed",
        "frames_unknown",
        "lost",
    )

    def __init__(self) -> None:
        self.frames = 0
        self.frames_unknown = 0
        self.frames_signed = 0
        self.bytes_skipped = 0
        self.crc_errors = 0
        self.lost: dict[tuple[int, int], int] = {}
        """Number of lost frames per (system, component), counted by gaps in the sequence numbers."""
        self._next_seq: dict[int, int] = {}
        """The expected sequence number by system id * 256 + component id."""
        self._incomplete = b""
        """The beginning of a frame that is not complete yet."""

    def feed(self, data: bytes, received_monotonic_s: float) -> list[Frame]:
        """Returns all complete frames."""
        if self._incomplete:
            return self._split(self._incomplete + data, received_monotonic_s)
        # fast path: nearly every datagram is one valid unsigned frame
        size = len(data)
        if size > MIN_V2_BYTES and data[0] == STX_V2 and data[1] + MIN_V2_BYTES == size and not data[2]:
            seq, system_id, component_id, low, high = _sender_and_id(data)
            msg_id = low | high << 16
            extra = CRC_EXTRA.get(msg_id)
            if extra is not None and _crc(data[1:-2] + extra) == data[-2] | data[-1] << 8:
                key = system_id << 8 | component_id
                if self._next_seq.get(key) == seq:
                    self._next_seq[key] = (seq + 1) & 0xFF
                    self.frames += 1
                else:
                    self._count(system_id, component_id, seq)
                return [Frame(msg_id, system_id, component_id, seq, data, received_monotonic_s)]
        return self._split(data, received_monotonic_s)

    def _split(self, data: bytes, received_monotonic_s: float) -> list[Frame]:
        frames: list[Frame] = []
        position, size = 0, len(data)
        while position < size:
            first = data[position]
            if first == STX_V2:
                header = HEADER_V2
            elif first == STX_V1:
                header = HEADER_V1
            else:
                following = _next_start(data, position + 1, size)
                self.bytes_skipped += following - position
                position = following
                continue
            if size - position < header + CHECKSUM:
                break
            end = position + header + data[position + 1] + CHECKSUM
            signature = 0
            if header == HEADER_V2:
                flags = data[position + 2]
                if flags & ~SIGNED:
                    self.bytes_skipped += 1
                    position += 1
                    continue
                signature = SIGNATURE if flags else 0
            if size < end + signature:
                break
            frame = self._check(data, position, header, end, end + signature, received_monotonic_s)
            if frame is None:
                self.bytes_skipped += 1
                position += 1
                continue
            frames.append(frame)
            position = end + signature
        self._incomplete = data[position:]
        return frames

    def _check(
        self, data: bytes, start: int, header: int, checksum_end: int, frame_end: int, now_s: float
    ) -> Frame | None:
        """The frame that begins at `data[start]`; None if its checksum is wrong. A signature is between
        `checksum_end` and `frame_end`."""
        msg_id, system_id, component_id, seq = _header_fields(data, start, header)
        extra = CRC_EXTRA.get(msg_id)
        if extra is None:
            if frame_end < len(data) and data[frame_end] not in (STX_V1, STX_V2):
                return None
            self.frames_unknown += 1
        elif (
            _crc(data[start + 1 : checksum_end - 2] + extra)
            != data[checksum_end - 2] | data[checksum_end - 1] << 8
        ):
            self.crc_errors += 1
            return None
        self._count(system_id, component_id, seq)
        if frame_end > checksum_end:
            self.frames_signed += 1
        return Frame(
            msg_id,
            system_id,
            component_id,
            seq,
            data[start:frame_end],
            now_s,
            extra is not None,
        )

    def _count(self, system_id: int, component_id: int, seq: int) -> None:
        self.frames += 1
        key = system_id << 8 | component_id
        gap = (seq - self._next_seq.get(key, seq)) & 0xFF
        self._next_seq[key] = (seq + 1) & 0xFF
        if 0 < gap < 128:  # a larger gap: an older frame arrived late, or the sender restarted
            sender = (system_id, component_id)
            self.lost[sender] = self.lost.get(sender, 0) + gap


def _header_fields(data: bytes, start: int, header: int) -> tuple[int, int, int, int]:
    """(message id, system id, component id, sequence number) from the header at `data[start]`."""
    if header == HEADER_V2:
        msg_id = data[start + 7] | data[start + 8] << 8 | data[start + 9] << 16
        return msg_id, data[start + 5], data[start + 6], data[start + 4]
    return data[start + 5], data[start + 3], data[start + 4], data[start + 2]


def _next_start(data: bytes, position: int, size: int) -> int:
    v2 = data.find(STX_V2, position)
    v1 = data.find(STX_V1, position, v2 if v2 >= 0 else size)
    return v1 if v1 >= 0 else v2 if v2 >= 0 else size


def known_frame(raw: bytes, received_monotonic_s: float) -> Frame:
    """The frame of bytes that a parser has already checked."""
    header = HEADER_V2 if raw[0] == STX_V2 else HEADER_V1
    return Frame(*_header_fields(raw, 0, header), raw, received_monotonic_s)


def full_payload(frame: Frame) -> bytes:
    """The payload with its trailing zeros, in the full length of the message."""
    size = LAYOUTS[frame.msg_id].unpacker.size
    payload = frame.payload
    return payload if len(payload) == size else payload[:size].ljust(size, b"\0")


def payload_byte(frame: Frame, offset: int) -> int:
    """One byte of the payload; 0 if it is among the trailing zeros that MAVLink 2 removes."""
    raw = frame.raw
    start = HEADER_V2 if raw[0] == STX_V2 else HEADER_V1
    return raw[start + offset] if offset < raw[1] else 0


def decode(frame: Frame) -> MAVLink_message | None:
    """The dialect's message object; None for an unknown id."""
    layout = LAYOUTS.get(frame.msg_id)
    if layout is None:
        return None
    flat = layout.unpacker.unpack(full_payload(frame))
    values: list[Any] = []
    position = 0
    for length in layout.lengths:
        values.append(flat[position] if length == 1 else list(flat[position : position + length]))
        position += length
    constructor: Any = layout.message_class
    message = constructor(*(values[i] for i in layout.order))
    message._header = MAVLink_header(
        frame.msg_id,
        mlen=len(frame.payload),
        seq=frame.seq,
        srcSystem=frame.system_id,
        srcComponent=frame.component_id,
    )
    message._payload = frame.payload
    message._msgbuf = bytearray(frame.raw)
    return message


def encode_payload(message: MAVLink_message) -> bytes:
    """A message's payload in wire order, in full length."""
    layout = LAYOUTS[message.get_msgId()]
    values = layout.values_of(message)
    if layout.has_arrays:
        fields = zip(values, layout.lengths, strict=True)
        values = [element for value, length in fields for element in (value if length > 1 else (value,))]
    return layout.unpacker.pack(*values)


def encode_frame(
    msg_id: int,
    payload: bytes,
    seq: int,
    system_id: int,
    component_id: int,
    signer: FrameSigner | None = None,
) -> bytes:
    """A MAVLink 2 frame; trailing zeros of the payload are removed as the protocol requires.

    Args:
        signer: signs the frame; frames must be sent in the order in which they were signed. None: the frame
            is not signed.
    """
    payload = payload.rstrip(b"\0") or payload[:1]
    header = _header_v2.pack(
        STX_V2,
        len(payload),
        0 if signer is None else SIGNED,
        0,
        seq,
        system_id,
        component_id,
        msg_id & 0xFFFF,
        msg_id >> 16,
    )
    body = header + payload
    frame = body + _checksum.pack(_crc(body[1:] + CRC_EXTRA[msg_id]))
    return frame if signer is None else frame + signer.trailer(frame)
