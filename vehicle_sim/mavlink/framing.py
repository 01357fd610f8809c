"""Encodes and parses MAVLink 1 and 2 frames with their CRC, independent of the messages' content."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from fastcrc import crc16

from vehicle_sim.mavlink.dialect import LAYOUTS, Layout, Message, unpack

STX_V2 = 0xFD
STX_V1 = 0xFE

_crc = crc16.mcrf4xx
_HEADER = struct.Struct("BBBBBB")
"""The fields from the payload length to the component id."""
_CRC = struct.Struct("<H")


def frame_v2(layout: Layout, payload: bytes, sequence: int, system_id: int, component_id: int) -> bytes:
    """One MAVLink 2 frame; trailing zeros of the payload are removed, but the first byte is kept."""
    payload = payload.rstrip(b"\0") or b"\0"
    body = _HEADER.pack(len(payload), 0, 0, sequence, system_id, component_id) + layout.id_bytes + payload
    return b"\xfd" + body + _CRC.pack(_crc(body + layout.crc_extra_byte))


@dataclass(slots=True)
class ParserCounts:
    """Counters of a parser, for LINK_NODE_STATUS."""

    frames: int = 0
    bad_crc: int = 0
    unknown: int = 0
    lost: int = 0


class FrameParser:
    """Finds messages in a byte stream; invalid bytes are skipped."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self.counts = ParserCounts()
        self._sequences: dict[tuple[int, int], int] = {}

    def feed(self, data: bytes) -> list[Message]:
        """The messages that `data` completes."""
        self._buffer += data
        buffer, messages, index = self._buffer, [], 0
        end = len(buffer)
        while index < end:
            if buffer[index] not in (STX_V2, STX_V1):
                index += 1
                continue
            frame_length = self._frame_length(index)
            if frame_length is None or index + frame_length > end:
                break
            message = self._parse(bytes(buffer[index : index + frame_length]))
            if message is None:
                index += 1
                continue
            index += frame_length
            if message is not _UNKNOWN:
                messages.append(message)
        del buffer[:index]
        return messages

    def _frame_length(self, index: int) -> int | None:
        buffer = self._buffer
        if buffer[index] == STX_V1:
            return None if len(buffer) < index + 2 else 8 + buffer[index + 1]
        if len(buffer) < index + 3:
            return None
        return 12 + buffer[index + 1] + (13 if buffer[index + 2] & 1 else 0)

    def _parse(self, frame: bytes) -> Message | None:
        if frame[0] == STX_V2:
            if frame[2] & ~1:
                return None
            header_size, payload_size = 10, frame[1]
            sequence, system_id, component_id = frame[4], frame[5], frame[6]
            msg_id = frame[7] | frame[8] << 8 | frame[9] << 16
        else:
            header_size, payload_size = 6, frame[1]
            sequence, system_id, component_id, msg_id = frame[2], frame[3], frame[4], frame[5]
        layout = LAYOUTS.get(msg_id)
        if layout is None:
            self.counts.unknown += 1
            return _UNKNOWN
        body = frame[1 : header_size + payload_size]
        if _crc(body + layout.crc_extra_byte) != _CRC.unpack_from(frame, header_size + payload_size)[0]:
            self.counts.bad_crc += 1
            return None
        self._count_frame(system_id, component_id, sequence)
        values = unpack(layout, frame[header_size : header_size + payload_size])
        return Message(layout, values, system_id, component_id, frame)

    def _count_frame(self, system_id: int, component_id: int, sequence: int) -> None:
        self.counts.frames += 1
        last = self._sequences.get((system_id, component_id))
        if last is not None:
            self.counts.lost += (sequence - last - 1) & 0xFF
        self._sequences[system_id, component_id] = sequence


_UNKNOWN = Message(LAYOUTS[0], {}, 0, 0, b"")
"""Placeholder for a frame with an unknown message id, which is skipped without a check of its CRC."""
