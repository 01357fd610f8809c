"""A vehicle's file server with valid frames and invalid answers: too short, at wrong offsets, or endless."""

import struct
from collections.abc import Callable

from gcs_server.mavlink.codec import encode_frame

FTP_ID = 110
HEAD = struct.Struct("<HBBBBBBI")
OPEN, READ, BURST, LIST, ACK, NAK = 4, 5, 15, 3, 128, 129
RESET, TERMINATE = 2, 1
Answer = Callable[[int, int], list[tuple[int, bytes]]]
"""(offset, requested size) → the answers, each (offset, data)."""


class HostileFiles:
    """Replaces a FakeAutopilot's file server; counts the requests."""

    def __init__(
        self,
        autopilot,
        size: int,
        *,
        read: Answer | None = None,
        burst: Answer | None = None,
        every_s: float = 0.0,
    ) -> None:
        self.autopilot, self.size, self.read, self.burst, self.every_s = autopilot, size, read, burst, every_s
        self.requests: dict[int, int] = {}
        autopilot.handlers.append(self.handle)

    def handle(self, message) -> bool:
        if message.get_type() != "FILE_TRANSFER_PROTOCOL":
            return False
        raw = bytes(message.payload)
        sequence, _, opcode, size, _, _, _, offset = HEAD.unpack_from(raw)
        self.requests[opcode] = self.requests.get(opcode, 0) + 1
        if opcode == OPEN:
            self.answer(sequence + 1, opcode, 0, struct.pack("<I", self.size))
        elif opcode == BURST and self.burst is None:
            self.answer(sequence + 1, opcode, 0, b"\x07", NAK)
        elif opcode == BURST:
            for n, (at, data) in enumerate(self.burst(offset, size)):
                self.autopilot.loop.call_later(
                    n * self.every_s, self.answer, sequence + 1 + n, opcode, at, data
                )
        elif opcode == READ:
            for at, data in self.read(offset, size):
                self.answer(sequence + 1, opcode, at, data)
        elif opcode == LIST:
            self.autopilot.loop.call_later(
                self.every_s, self.answer, sequence + 1, opcode, offset, b"Fx\t1\0"
            )
        else:
            self.answer(sequence + 1, opcode, 0, b"")
        return True

    def answer(self, sequence: int, to: int, offset: int, data: bytes, kind: int = ACK) -> None:
        payload = HEAD.pack(sequence & 0xFFFF, 0, kind, len(data), to, 0, 0, offset) + data
        body = struct.pack("<BBB", 0, 255, 190) + payload.ljust(251, b"\0")
        self.autopilot.send_raw(encode_frame(FTP_ID, body, self.autopilot.mav.seq, self.autopilot.system, 1))
