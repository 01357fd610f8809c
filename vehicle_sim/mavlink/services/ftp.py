"""FILE_TRANSFER_PROTOCOL: this vehicle keeps no files; every request gets an honest refusal in PX4's form."""

from __future__ import annotations

import struct

from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import Message
from vehicle_sim.mavlink.link import Link

_HEADER = struct.Struct("<HBBBBBBI")
ACK, NAK = 128, 129
TERMINATE_SESSION, RESET_SESSIONS = 1, 2
OPEN_RO, LIST_DIRECTORY, READ, BURST = 4, 3, 5, 15
KNOWN_OPCODES = frozenset(range(0, 17))
ERROR_FAIL, ERROR_INVALID_SESSION, ERROR_UNKNOWN, ERROR_NOT_FOUND = 1, 4, 7, 10


class FtpService:
    """Answers every opcode."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self.handlers = {"FILE_TRANSFER_PROTOCOL": self.request}

    def request(self, link: Link, message: Message) -> None:
        """ACK what ends sessions, NAK the rest with the reason."""
        if not self._context.is_for_me(message):
            return
        sequence, session, opcode, *_ = _HEADER.unpack(bytes(message.payload[:12]))
        answer, error = NAK, ERROR_NOT_FOUND
        if opcode in (TERMINATE_SESSION, RESET_SESSIONS, 0):
            answer, error = ACK, 0
        elif opcode in (READ, BURST):
            error = ERROR_INVALID_SESSION
        elif opcode not in KNOWN_OPCODES:
            error = ERROR_UNKNOWN
        size = 0 if answer == ACK else 1
        head = _HEADER.pack((sequence + 1) & 0xFFFF, session, answer, size, opcode, 0, 0, 0)
        link.send(
            "FILE_TRANSFER_PROTOCOL",
            target_system=message.system_id,
            target_component=message.component_id,
            payload=head + bytes((error,)),
        )
