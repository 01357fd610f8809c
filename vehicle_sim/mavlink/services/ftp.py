"""MAVLink FTP like PX4's server: one session per link, repeated requests get the same reply, slow bursts.

Opcodes, errors and header are MAVLink's ("File Transfer Protocol"). Some behaviour was recorded on PX4: a
directory can be opened and occupies the session, a burst ends after 40 kB, and an error contains the errno of
the last failed system call. The only session has number 0: the reply to opening a file contains this number,
and reading and closing require it; bursts and writes accept any number.
"""

from __future__ import annotations

import errno
import struct
from collections.abc import Callable
from dataclasses import dataclass, field

from vehicle_sim.mavlink.context import AUTOPILOT_COMPONENT, Context
from vehicle_sim.mavlink.dialect import Message
from vehicle_sim.mavlink.link import Link
from vehicle_sim.storage.files import VehicleFiles
from vehicle_sim.storage.metadata import crc32

HEADER = struct.Struct("<HBBBBBBI")
"""Sequence, session, opcode, size, requested opcode, burst complete, padding, offset."""
DATA_BYTES = 239
ACK, NAK = 128, 129
SESSION = 0
"""Number of the only session; replies to opening a file, and bursts, contain this number."""
NONE, TERMINATE, RESET, LIST, OPEN_RO, READ, CREATE, WRITE, REMOVE = range(9)
MAKE_DIRECTORY, REMOVE_DIRECTORY, OPEN_WO, TRUNCATE, RENAME, CRC32, BURST = range(9, 16)
OPEN_OPCODES = frozenset({OPEN_RO, CREATE, OPEN_WO})
FAIL_ERRNO, INVALID_DATA_SIZE, INVALID_SESSION, NO_SESSIONS, END_OF_FILE, UNKNOWN_OPCODE = 2, 3, 4, 5, 6, 7
FILE_EXISTS, FILE_PROTECTED, FILE_NOT_FOUND = 8, 9, 10
BURST_BYTES = 40_000
"""A burst ends after this many bytes; the client requests the next burst."""
BURST_MESSAGES_PER_STEP = 5
"""At 250 steps per second; PX4 sent 1,100 burst messages per second in the recording."""


class RequestFailed(Exception):
    """A request has failed; `code` is the error code of the NAK."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


@dataclass(slots=True)
class _Burst:
    """The active burst of a session."""

    request: Message
    sequence: int
    offset: int
    sent: int = 0


@dataclass(slots=True)
class _Session:
    """The session of one link."""

    path: str | None = None
    size: int = 0
    writable: bool = False
    burst: _Burst | None = None
    last_errno: int = 0
    last_reply: tuple[int, int, bytes] | None = field(default=None)
    """(system, component, payload) of the last reply, for a repeated request."""


@dataclass(frozen=True, slots=True)
class _Request:
    offset: int
    data: bytes

    @property
    def path(self) -> str:
        """The data up to the first NUL: a path."""
        return self.data.split(b"\0")[0].decode("utf-8", "replace")


class FtpService:
    """Serves one vehicle's files."""

    def __init__(self, context: Context, files: VehicleFiles) -> None:
        self._context = context
        self._files = files
        self._sessions: dict[str, _Session] = {}
        self.handlers = {"FILE_TRANSFER_PROTOCOL": self.request}
        self._operations: dict[int, Callable[[_Session, _Request], bytes]] = {
            NONE: lambda session, request: b"",
            TERMINATE: self._terminate,
            RESET: self._reset,
            LIST: self._list,
            OPEN_RO: self._open_to_read,
            READ: self._read,
            CREATE: self._create,
            WRITE: self._write,
            REMOVE: lambda s, r: self._empty_reply(self._files.remove(r.path)),
            MAKE_DIRECTORY: lambda s, r: self._empty_reply(self._files.make_directory(r.path)),
            REMOVE_DIRECTORY: lambda s, r: self._empty_reply(self._files.remove_directory(r.path)),
            OPEN_WO: self._open_to_write,
            TRUNCATE: lambda s, r: self._empty_reply(self._files.truncate(r.path, r.offset)),
            RENAME: self._rename,
            CRC32: self._checksum,
        }

    @property
    def busy(self) -> bool:
        """Whether a burst is active."""
        return bool(self._sessions) and any(each.burst is not None for each in self._sessions.values())

    def request(self, link: Link, message: Message) -> None:
        """Handles one request; a repeated request (same sequence number and opcode) gets the same reply.

        A client that stops a burst early sends a new request with the sequence number of the burst's last
        message, so the opcode is compared too.
        """
        if message.target_system not in (0, self._context.system_id) or (
            message.target_component not in (0, AUTOPILOT_COMPONENT)
        ):
            return
        raw = bytes(message.payload)
        sequence, session_number, opcode, size, _, _, _, offset = HEADER.unpack_from(raw)
        session = self._sessions.setdefault(link.name, _Session())
        client = (message.system_id, message.component_id)
        reply_sequence = (sequence + 1) & 0xFFFF
        if session.last_reply is not None:
            *last_client, payload = session.last_reply
            last_sequence, _, _, _, last_opcode, *_ = HEADER.unpack_from(payload)
            if tuple(last_client) == client and (last_sequence, last_opcode) == (reply_sequence, opcode):
                self._send(link, client, payload)
                return
        try:
            if size > DATA_BYTES:
                raise RequestFailed(INVALID_DATA_SIZE)
            request = _Request(offset, raw[HEADER.size : HEADER.size + size])
            if opcode == BURST:
                self._begin_burst(session, message, reply_sequence, offset)
                return
            operation = self._operations.get(opcode)
            if operation is None:
                raise RequestFailed(UNKNOWN_OPCODE)
            if session_number != SESSION and opcode in (TERMINATE, READ):
                raise RequestFailed(INVALID_SESSION)
            data, reply_opcode = operation(session, request), ACK
            if opcode in OPEN_OPCODES:
                session_number = SESSION
        except RequestFailed as failure:
            data, reply_opcode = self._error_data(session, failure.code), NAK
        except OSError as error:
            data, reply_opcode = self._os_error_data(session, error), NAK
        header = (reply_sequence, session_number, reply_opcode, opcode, 0, offset)
        self._reply(link, session, client, header, data)

    def step(self) -> None:
        """Sends the next messages of all active bursts."""
        for link in self._context.links:
            session = self._sessions.get(link.name)
            for _ in range(BURST_MESSAGES_PER_STEP):
                if session is None or session.burst is None:
                    break
                self._send_burst_message(link, session, session.burst)

    # --- replies ---------------------------------------------------------------------------------------

    def _reply(
        self,
        link: Link,
        session: _Session,
        client: tuple[int, int],
        header: tuple[int, int, int, int, int, int],
        data: bytes,
    ) -> None:
        sequence, session_number, reply_opcode, opcode, burst_complete, offset = header
        fields = (sequence, session_number, reply_opcode, len(data), opcode, burst_complete, 0, offset)
        payload = HEADER.pack(*fields) + data
        session.last_reply = (*client, payload)
        self._send(link, client, payload)

    @staticmethod
    def _send(link: Link, client: tuple[int, int], payload: bytes) -> None:
        link.send(
            "FILE_TRANSFER_PROTOCOL", target_system=client[0], target_component=client[1], payload=payload
        )

    @staticmethod
    def _error_data(session: _Session, code: int) -> bytes:
        return bytes((code, session.last_errno & 0xFF)) if code == FAIL_ERRNO else bytes((code,))

    def _os_error_data(self, session: _Session, error: OSError) -> bytes:
        code = error.errno or errno.EIO
        if code == errno.ENOENT:
            return bytes((FILE_NOT_FOUND,))
        if code == errno.EEXIST:
            return bytes((FILE_EXISTS,))
        if code in (errno.EACCES, errno.EROFS):
            return bytes((FILE_PROTECTED,))
        session.last_errno = code
        return self._error_data(session, FAIL_ERRNO)

    @staticmethod
    def _empty_reply(_: None) -> bytes:
        return b""

    # --- sessions --------------------------------------------------------------------------------------

    def _terminate(self, session: _Session, request: _Request) -> bytes:
        if session.path is None:
            raise RequestFailed(INVALID_SESSION)
        return self._reset(session, request)

    @staticmethod
    def _reset(session: _Session, request: _Request) -> bytes:
        session.path, session.burst = None, None
        return b""

    def _open(self, session: _Session, path: str, *, writable: bool) -> bytes:
        session.path, session.size, session.writable = path, self._files.size(path), writable
        return struct.pack("<I", session.size)

    @staticmethod
    def _require_no_open_file(session: _Session) -> None:
        if session.path is not None:
            raise RequestFailed(NO_SESSIONS)

    def _open_to_read(self, session: _Session, request: _Request) -> bytes:
        self._require_no_open_file(session)
        return self._open(session, request.path, writable=False)

    def _create(self, session: _Session, request: _Request) -> bytes:
        self._require_no_open_file(session)
        self._files.create(request.path)
        return self._open(session, request.path, writable=True)

    def _open_to_write(self, session: _Session, request: _Request) -> bytes:
        self._require_no_open_file(session)
        try:
            self._files.write(request.path, 0, b"")
        except FileNotFoundError:
            self._files.create(request.path)
        return self._open(session, request.path, writable=True)

    # --- files and directories -------------------------------------------------------------------------

    def _list(self, session: _Session, request: _Request) -> bytes:
        """Entries of a directory: `F name TAB size`, `D name`, or `S` (skip) for ".", ".." and links."""
        path = request.path or "/"
        entries = [b"S\0", b"S\0"]
        for name, size in self._files.listing(path):
            if size is not None:
                entries.append(f"F{name}\t{size}\0".encode())
            elif self._files.is_link(path, name):
                entries.append(b"S\0")
            else:
                entries.append(f"D{name}\0".encode())
        data = b""
        for entry in entries[request.offset :]:
            if len(data) + len(entry) > DATA_BYTES:
                break
            data += entry
        if not data:
            raise RequestFailed(END_OF_FILE)
        return data

    def _read(self, session: _Session, request: _Request) -> bytes:
        if session.path is None:
            raise RequestFailed(INVALID_SESSION)
        if request.offset >= session.size:
            raise RequestFailed(END_OF_FILE)
        return self._files.read(session.path, request.offset, min(len(request.data), DATA_BYTES))

    def _write(self, session: _Session, request: _Request) -> bytes:
        if session.path is None:
            raise RequestFailed(INVALID_SESSION)
        if not session.writable:
            raise OSError(errno.EBADF, "opened to read")
        self._files.write(session.path, request.offset, request.data)
        session.size = self._files.size(session.path)
        return struct.pack("<I", len(request.data))

    def _rename(self, session: _Session, request: _Request) -> bytes:
        old, _, rest = request.data.partition(b"\0")
        new = rest.split(b"\0")[0]
        self._files.rename(old.decode("utf-8", "replace"), new.decode("utf-8", "replace"))
        return b""

    def _checksum(self, session: _Session, request: _Request) -> bytes:
        try:
            content = self._files.read(request.path, 0, self._files.size(request.path))
        except FileNotFoundError:
            # As in PX4, the reply contains the errno of the previous error.
            raise RequestFailed(FAIL_ERRNO) from None
        return struct.pack("<I", crc32(content))

    # --- bursts ----------------------------------------------------------------------------------------

    def _begin_burst(self, session: _Session, message: Message, sequence: int, offset: int) -> None:
        if session.path is None:
            raise RequestFailed(INVALID_SESSION)
        if self._files.is_directory(session.path):
            raise OSError(errno.EISDIR, "a directory")
        session.burst = _Burst(message, sequence, offset)

    def _send_burst_message(self, link: Link, session: _Session, burst: _Burst) -> None:
        assert session.path is not None
        client = (burst.request.system_id, burst.request.component_id)
        reply_opcode, burst_complete = ACK, 0
        try:
            if burst.offset >= session.size:
                raise RequestFailed(END_OF_FILE)
            data = self._files.read(session.path, burst.offset, DATA_BYTES)
            burst.sent += len(data)
            burst_complete = int(burst.sent >= BURST_BYTES)
        except RequestFailed as failure:
            data, reply_opcode = self._error_data(session, failure.code), NAK
        except OSError as error:
            data, reply_opcode = self._os_error_data(session, error), NAK
        header = (burst.sequence, SESSION, reply_opcode, BURST, burst_complete, burst.offset)
        self._reply(link, session, client, header, data)
        burst.sequence = (burst.sequence + 1) & 0xFFFF
        burst.offset += len(data)
        if burst_complete or reply_opcode == NAK:
            session.burst = None
