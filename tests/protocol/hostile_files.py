"""A vehicle's FTP server with invalid replies in valid frames: single bytes, wrong offsets, endless data."""

import struct
from collections.abc import Callable

from gcs_server.mavlink.codec import encode_frame

FTP_ID = 110
FTP_HEADER = struct.Struct("<HBBBBBBI")
OPEN, READ, BURST, LIST, ACK, NAK = 4, 5, 15, 3, 128, 129
RESET, TERMINATE = 2, 1
Replies = Callable[[int, int], list[tuple[int, bytes]]]
"""Offset and requested size → the replies, each with offset and data."""


class HostileFtpServer:
    """The FTP server of a `FakeAutopilot`. `request_counts`: number of requests by opcode;
    `reply_interval_s`: time between replies."""

    def __init__(
        self,
        autopilot,
        size: int,
        *,
        read: Replies | None = None,
        burst: Replies | None = None,
        reply_interval_s: float = 0.0,
    ) -> None:
        self.autopilot, self.size, self.read, self.burst, self.reply_interval_s = (
            autopilot,
            size,
            read,
            burst,
            reply_interval_s,
        )
        self.request_counts: dict[int, int] = {}
        autopilot.handlers.append(self.handle)

    def handle(self, message) -> bool:
        if message.get_type() != "FILE_TRANSFER_PROTOCOL":
            return False
        raw = bytes(message.payload)
        sequence, _, opcode, size, _, _, _, offset = FTP_HEADER.unpack_from(raw)
        self.request_counts[opcode] = self.request_counts.get(opcode, 0) + 1
        if opcode == OPEN:
            self.reply(sequence + 1, opcode, 0, struct.pack("<I", self.size))
        elif opcode == BURST and self.burst is None:
            self.reply(sequence + 1, opcode, 0, b"\x07", NAK)  # unknown command
        elif opcode == BURST:
            for n, (reply_offset, data) in enumerate(self.burst(offset, size)):
                self.autopilot.loop.call_later(
                    n * self.reply_interval_s, self.reply, sequence + 1 + n, opcode, reply_offset, data
                )
        elif opcode == READ:
            for reply_offset, data in self.read(offset, size):
                self.reply(sequence + 1, opcode, reply_offset, data)
        elif opcode == LIST:
            self.autopilot.loop.call_later(
                self.reply_interval_s, self.reply, sequence + 1, opcode, offset, b"Fx\t1\0"
            )
        else:
            self.reply(sequence + 1, opcode, 0, b"")
        return True

    def reply(self, sequence: int, request_opcode: int, offset: int, data: bytes, kind: int = ACK) -> None:
        payload = FTP_HEADER.pack(sequence & 0xFFFF, 0, kind, len(data), request_opcode, 0, 0, offset) + data
        body = struct.pack("<BBB", 0, 255, 190) + payload.ljust(251, b"\0")
        self.autopilot.send_raw(encode_frame(FTP_ID, body, self.autopilot.mav.seq, self.autopilot.system, 1))
