"""Encodes and decodes MAVLink FTP packets and listings; no session, no time.

Layout, opcodes and error numbers are those of the MAVLink guide ("File Transfer Protocol"): a 12-byte header
and up to 239 bytes of data in the payload of FILE_TRANSFER_PROTOCOL.
"""

from __future__ import annotations

import enum
import os
import struct
from dataclasses import dataclass

from gcs_server.errors import GcsError

DATA_BYTES = 239
PAYLOAD_BYTES = 251
MAX_SIZE_DIGITS = 10
"""Maximum number of digits of a file size in a listing: offsets have 32 bits."""
_header = struct.Struct("<HBBBBBxI")


class Opcode(enum.IntEnum):
    """Opcodes that this client uses, and the two opcodes of replies."""

    TERMINATE_SESSION = 1
    RESET_SESSIONS = 2
    LIST_DIRECTORY = 3
    OPEN_FILE_RO = 4
    READ_FILE = 5
    CREATE_FILE = 6
    WRITE_FILE = 7
    REMOVE_FILE = 8
    CREATE_DIRECTORY = 9
    REMOVE_DIRECTORY = 10
    RENAME = 13
    CALC_FILE_CRC32 = 14
    BURST_READ_FILE = 15
    ACK = 128
    NAK = 129


class FtpError(enum.IntEnum):
    """The vehicle's error codes."""

    FAIL = 1
    FAIL_ERRNO = 2
    INVALID_DATA_SIZE = 3
    INVALID_SESSION = 4
    NO_SESSIONS_AVAILABLE = 5
    END_OF_FILE = 6
    UNKNOWN_COMMAND = 7
    FILE_EXISTS = 8
    FILE_PROTECTED = 9
    FILE_NOT_FOUND = 10


ERROR_TEXT: dict[int, str] = {
    FtpError.FAIL: "the vehicle reported a failure without a reason",
    FtpError.FAIL_ERRNO: "the vehicle's file system refused the request",
    FtpError.INVALID_DATA_SIZE: "the vehicle reported an invalid data size",
    FtpError.INVALID_SESSION: "the file is not open any more",
    FtpError.NO_SESSIONS_AVAILABLE: "the vehicle has no free session: another file is open",
    FtpError.END_OF_FILE: "the end of the file was reached",
    FtpError.UNKNOWN_COMMAND: "the vehicle does not support this request",
    FtpError.FILE_EXISTS: "the file already exists",
    FtpError.FILE_PROTECTED: "the file is write-protected",
    FtpError.FILE_NOT_FOUND: "there is no such file or folder",
}
REMEDIES: dict[int, str] = {
    FtpError.NO_SESSIONS_AVAILABLE: "Wait until the other transfer has ended; PX4 allows one at a time.",
    FtpError.FILE_NOT_FOUND: "List the folder to see its files.",
    FtpError.UNKNOWN_COMMAND: "The vehicle's firmware may be too old.",
}


class FtpFailed(GcsError):
    """A file of the vehicle could not be read or changed: the vehicle refused, or its data did not match its
    own size or checksum."""

    code = "ftp_failed"

    def __init__(
        self, message: str, *, ftp_error: int | None = None, path: str, remedy: str | None = None
    ) -> None:
        super().__init__(message, remedy=remedy)
        self.ftp_error = ftp_error
        """MAVLink's error number; None if the vehicle did not refuse."""
        self.path = path


@dataclass(frozen=True, slots=True)
class Packet:
    """One request or reply."""

    sequence: int
    opcode: int
    session: int = 0
    size: int = 0
    """Size of `data`; in a read request, the number of bytes to read."""
    request_opcode: int = 0
    """In a reply: the opcode of the request."""
    burst_complete: bool = False
    offset: int = 0
    data: bytes = b""


def encode(packet: Packet) -> bytes:
    """The full-length payload."""
    head = _header.pack(
        packet.sequence,
        packet.session,
        packet.opcode,
        packet.size,
        packet.request_opcode,
        packet.burst_complete,
        packet.offset,
    )
    return (head + packet.data).ljust(PAYLOAD_BYTES, b"\0")


def decode(payload: bytes) -> Packet | None:
    """Decodes a payload; None if it is too short or its stated size is too large."""
    if len(payload) < _header.size:
        return None
    sequence, session, opcode, size, request_opcode, complete, offset = _header.unpack_from(payload)
    data = payload[_header.size : _header.size + size]
    if size > DATA_BYTES or (opcode in (Opcode.ACK, Opcode.NAK) and len(data) < size):
        return None
    return Packet(sequence, opcode, session, size, request_opcode, bool(complete), offset, data)


def request(opcode: Opcode, sequence: int, *, path: str = "", session: int = 0, offset: int = 0) -> Packet:
    """A request with a path; the path must fit into one packet.

    Raises:
        FtpFailed: the path is too long, or contains a NUL.
    """
    data = path.encode()
    if len(data) >= DATA_BYTES or b"\0" in data:
        raise FtpFailed(f"{path!r} is not a valid path of a file on a vehicle.", path=path)
    return Packet(sequence, opcode, session, len(data), offset=offset, data=data)


def rename_request(old: str, new: str) -> Packet:
    """A request with two paths; both must fit into one packet.

    Raises:
        FtpFailed: they are too long, or contain a NUL.
    """
    data = old.encode() + b"\0" + new.encode() + b"\0"
    if len(data) > DATA_BYTES or data.count(b"\0") != 2:
        raise FtpFailed(f"{new!r} is not a valid path of a file on a vehicle.", path=new)
    return Packet(0, Opcode.RENAME, 0, len(data), data=data)


def refusal(packet: Packet, path: str, activity: str) -> FtpFailed:
    """The error of a NAK."""
    number = packet.data[0] if packet.data else FtpError.FAIL
    text = ERROR_TEXT.get(number, f"error {number}")
    if number == FtpError.FAIL_ERRNO and len(packet.data) > 1:
        text += f" ({os.strerror(packet.data[1])})"
    return FtpFailed(
        f"{activity} {path or '/'}: {text}.", ftp_error=number, path=path, remedy=REMEDIES.get(number)
    )


@dataclass(frozen=True, slots=True)
class DirectoryEntry:
    """One entry of a folder."""

    name: str
    bytes: int | None
    """Size of a file; None for a folder."""


def parse_listing(data: bytes) -> tuple[list[DirectoryEntry], int]:
    """(entries, number of entries in the packet); the number is added to the next request's offset.

    A file is `F name TAB size`, a folder `D name`, an entry to skip `S`; each entry ends with NUL.
    """
    entries: list[DirectoryEntry] = []
    lines = data.split(b"\0")
    if lines and not lines[-1]:
        lines.pop()
    for line in lines:
        kind, name = line[:1], line[1:].decode("utf-8", "replace")
        if kind == b"F":
            name, _, size = name.rpartition("\t") if "\t" in name else (name, "", "")
            is_valid_size = size.isascii() and size.isdigit() and len(size) <= MAX_SIZE_DIGITS
            entries.append(DirectoryEntry(name, int(size) if is_valid_size else 0))
        elif kind == b"D" and name not in (".", ".."):
            entries.append(DirectoryEntry(name, None))
    return entries, len(lines)
