"""The messages between a guard and its programs: answers of the guard, and ids that are exchanged. Pure.

To the vehicle a program is a component of this server; to the program, it is itself. So addresses in answers
of the vehicle, and the ids that some messages have in their fields, are exchanged on the way.
"""

from __future__ import annotations

import itertools
import struct
from collections.abc import Iterator
from typing import Any, Final

from gcs_server.errors import GcsError, Refused
from gcs_server.guard.program import Program
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import Frame, full_payload
from gcs_server.mavlink.codec import decode as decode_frame
from gcs_server.plain import plain
from gcs_server.vehicle.services import ftp_codec

TEXT_BYTES: Final = 50
"""Length of the text in one STATUSTEXT [bytes]."""
MAX_TEXT_BYTES: Final = 400
CONFIRMATION_OFFSET: Final = 32
"""Of `confirmation` in COMMAND_LONG, by which a repeated command differs from the first."""
_PLAIN: Final = str.maketrans("“”’–…", '""\'-.')
"""STATUSTEXT is read as ASCII by many programs."""
_ids = itertools.count(1)
_GIMBAL_STATUS_IDS: Final = 9
"""Offset in GIMBAL_MANAGER_STATUS: system and component in primary, then in secondary control."""
_COMMANDS = frozenset({d.MAVLINK_MSG_ID_COMMAND_LONG, d.MAVLINK_MSG_ID_COMMAND_INT})
_MISSION_WRITES = frozenset(
    {
        d.MAVLINK_MSG_ID_MISSION_COUNT,
        d.MAVLINK_MSG_ID_MISSION_CLEAR_ALL,
        d.MAVLINK_MSG_ID_MISSION_WRITE_PARTIAL_LIST,
    }
)


def kind_of(heartbeat: Any) -> str | None:
    """What a program says it is: the type in its heartbeat, in words."""
    entry = d.enums["MAV_TYPE"].get(heartbeat.type)
    return None if entry is None else entry.name.removeprefix("MAV_TYPE_").replace("_", " ").lower()


def name_of_command(command: int) -> str:
    """Name of a MAV_CMD, or its number."""
    entry = d.enums["MAV_CMD"].get(command)
    return f"command {command}" if entry is None else entry.name.removeprefix("MAV_CMD_")


def command_of(frame: Frame) -> int:
    """MAV_CMD of COMMAND_LONG or COMMAND_INT."""
    return struct.unpack_from("<H", full_payload(frame), 28)[0]


def params_of(message: Any) -> tuple[float, ...]:
    """The seven parameters of COMMAND_LONG or COMMAND_INT."""
    first = tuple(getattr(message, f"param{n}") for n in range(1, 5))
    if message.get_type() == "COMMAND_INT":
        return (*first, float(message.x), float(message.y), message.z)
    return (*first, message.param5, message.param6, message.param7)


def arguments_of(message: Any) -> dict[str, object]:
    """The fields of a message for the journal, without addresses."""
    fields = message.to_dict()
    left_out = {"mavpackettype", "target_system", "target_component", "confirmation", "payload"}
    return {name: plain(value) for name, value in fields.items() if name not in left_out}


def addressed(payload: bytes, offset: int, program: Program) -> bytes:
    """An answer to this server's component, addressed to the program."""
    return payload[:offset] + bytes((program.system or 0, program.component or 0)) + payload[offset + 2 :]


def gimbal_status(payload: bytes, own_system: int, program: Program) -> bytes:
    """GIMBAL_MANAGER_STATUS in which the program finds itself."""
    ids = bytearray(payload[_GIMBAL_STATUS_IDS:])
    for at in (0, 2):
        if tuple(ids[at : at + 2]) == (own_system, program.own_component):
            ids[at : at + 2] = bytes((program.system or 0, program.component or 0))
    return payload[:_GIMBAL_STATUS_IDS] + bytes(ids)


def with_own_ids(payload: bytes, message: Any, own_system: int, program: Program) -> bytes:
    """A command in which the program names itself as the one that controls the gimbal, with the ids by which
    the vehicle knows it."""
    if getattr(message, "command", None) != d.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE:
        return payload
    params = list(struct.unpack_from("<4f", payload))
    for at in (0, 2):
        if (params[at], params[at + 1]) == (program.system, program.component):
            params[at : at + 2] = [float(own_system), float(program.own_component)]
    return struct.pack("<4f", *params) + payload[16:]


def acknowledgement(frame: Frame, result: int) -> Any | None:
    """COMMAND_ACK for a command; None for another message."""
    if frame.msg_id not in _COMMANDS:
        return None
    return d.MAVLink_command_ack_message(command_of(frame), result, 0, 0, frame.system_id, frame.component_id)


def refusal(frame: Frame, error: GcsError) -> Any | None:
    """MAVLink's own answer to a refused message; None: it has none."""
    if frame.msg_id in _COMMANDS:
        may_pass = isinstance(error, Refused)
        return acknowledgement(frame, d.MAV_RESULT_TEMPORARILY_REJECTED if may_pass else d.MAV_RESULT_DENIED)
    if frame.msg_id in _MISSION_WRITES:
        message: Any = decode_frame(frame)
        return d.MAVLink_mission_ack_message(
            frame.system_id, frame.component_id, d.MAV_MISSION_DENIED, message.mission_type
        )
    if frame.msg_id == d.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL:
        packet = ftp_codec.decode(full_payload(frame)[3:])
        if packet is None:
            return None
        answer = ftp_codec.Packet(
            packet.sequence + 1 & 0xFFFF,
            ftp_codec.Opcode.NAK,
            packet.session,
            1,
            packet.opcode,
            data=bytes((ftp_codec.FtpError.FILE_PROTECTED,)),
        )
        return d.MAVLink_file_transfer_protocol_message(
            0, frame.system_id, frame.component_id, list(ftp_codec.encode(answer))
        )
    return None


def texts(text: str, severity: int) -> Iterator[Any]:
    """A text as STATUSTEXT, in pieces of 50 bytes that a receiver joins by their number."""
    encoded = text.translate(_PLAIN).encode("ascii", "replace")[:MAX_TEXT_BYTES]
    pieces = [encoded[at : at + TEXT_BYTES] for at in range(0, len(encoded), TEXT_BYTES)]
    number = 0 if len(pieces) == 1 else next(_ids) % 0xFFFF + 1
    for sequence, piece in enumerate(pieces):
        yield d.MAVLink_statustext_message(severity, piece, number, sequence)
    if len(pieces) > 1 and len(pieces[-1]) == TEXT_BYTES:
        yield d.MAVLink_statustext_message(severity, b"", number, len(pieces))
