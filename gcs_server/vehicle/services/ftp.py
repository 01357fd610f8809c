"""Reads and writes files of the vehicle over links that lose packets.

Operations run one at a time, because PX4 has one session per link. An unanswered request is sent again with
the same sequence number, so that the vehicle repeats its reply instead of its action. What may be written,
and when, is decided in `files.py`; only it writes.

The vehicle's replies are untrusted: a transfer has limits of bytes, replies and time, and fails with a reason
if the vehicle exceeds a limit.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncGenerator, Callable
from contextlib import AbstractContextManager, asynccontextmanager

from gcs_server.errors import Disconnected, NoReply
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import encode_payload
from gcs_server.mavlink.mailbox import Reply, Waiter
from gcs_server.vehicle.services import ftp_codec as codec
from gcs_server.vehicle.services.ftp_codec import DirectoryEntry, FtpError, FtpFailed, Opcode, Packet
from gcs_server.vehicle.services.ftp_pieces import PartialFile
from gcs_server.vehicle.services.ftp_transfer import ReportBytes, Transfer
from gcs_server.vehicle.services.ftp_upload import Upload
from gcs_server.vehicle.services.ftp_window import packet_of
from gcs_server.vehicle.services.port import VehiclePort

FIRST_TIMEOUT_S = 0.25
MAX_TIMEOUT_S = 1.5
MAX_ATTEMPTS = 12
"""Maximum number of attempts; with 20 % loss each way, one request in 200,000 fails."""
BUSY_ATTEMPTS, BUSY_PAUSE_S = 4, 3.0
"""Attempts to open a file while all sessions are in use, and the pause between them [s]; PX4 closes
an unused session after this pause."""
MAX_BYTES = 8_000_000
MAX_ENTRIES = 10_000
MIN_BYTES_S, EXTRA_TIME_S = 400, 60.0
"""Minimum average speed of a transfer [bytes/s], and additional time for any file [s]."""
LIST_TIMEOUT_S = 120.0
CHANGING = frozenset(
    {
        Opcode.CREATE_FILE,
        Opcode.REMOVE_FILE,
        Opcode.CREATE_DIRECTORY,
        Opcode.REMOVE_DIRECTORY,
        Opcode.RENAME,
    }
)


class FtpService:
    """One vehicle's files."""

    def __init__(self, vehicle: VehiclePort) -> None:
        self._vehicle = vehicle
        self._lock = asyncio.Lock()
        self.sequence = 0
        """Number of the last request."""
        self.supports_burst = True
        self._may_be_open = True
        """Whether a session of this server, or of its previous run, may still be open."""

    async def list(self, path: str) -> list[DirectoryEntry]:
        """Lists a folder.

        Raises:
            FtpFailed: the vehicle refused, or sends an endless list.
            NoReply: the vehicle stopped answering.
        """
        self._vehicle.require("files")
        async with self._lock, _time_limit(LIST_TIMEOUT_S, path, "Listing"):
            return await self._list(path)

    async def crc32(self, path: str, *, wait_s: float = 0.0) -> int:
        """Requests MAVLink's checksum of a file from the vehicle; raises the errors of `list`.

        Args:
            path: path on the vehicle.
            wait_s: additional wait for the answer [s]: PX4 reads the whole file before it answers.
        """
        self._vehicle.require("files")
        attempts = MAX_ATTEMPTS + math.ceil(wait_s / MAX_TIMEOUT_S)
        request = codec.request(Opcode.CALC_FILE_CRC32, 0, path=path)
        async with self._lock:
            reply = await self._request(request, path, "Checking", attempts)
        if len(reply.data) < 4:
            raise FtpFailed(f"Checking {path}: the answer is incomplete.", path=path)
        return int.from_bytes(reply.data[:4], "little")

    async def read(
        self, path: str, *, max_bytes: int = MAX_BYTES, progress: ReportBytes | None = None
    ) -> bytes:
        """Reads a complete file.

        Args:
            path: path on the vehicle.
            max_bytes: a larger file is not read.
            progress: called with the progress.

        Raises:
            FtpFailed: the vehicle refused, the file is too large, or it arrives in too many pieces, too
                slowly, or from another offset than requested.
            NoReply: the vehicle stopped answering.
        """
        files: list[PartialFile] = []

        def new_file(size: int) -> PartialFile:
            if size > max_bytes:
                raise FtpFailed(
                    f"{path} has {size:,} bytes; more than {max_bytes:,} are not read.", path=path
                )
            files.append(PartialFile(size))
            return files[0]

        await self.read_parts(path, new_file, progress)
        return files[0].content

    async def read_parts(
        self, path: str, file_of: Callable[[int], PartialFile], progress: ReportBytes | None = None
    ) -> None:
        """Reads what is missing of a file.

        Args:
            path: path on the vehicle.
            file_of: called with the size on the vehicle; returns the file with what has arrived already. What
                it raises ends the transfer.
            progress: called with the progress; what it raises ends the transfer.

        Raises:
            FtpFailed, NoReply: see `read`.
            Disconnected: the vehicle was lost.
        """
        vehicle = self._vehicle
        vehicle.require("files")
        async with self._lock:
            opened = await self._open(path)
            disconnected = False
            try:
                file = file_of(int.from_bytes(opened.data[:4], "little") if len(opened.data) >= 4 else 0)
                transfer = Transfer(self, vehicle.id, vehicle.clock, path, opened.session, file, progress)
                async with _time_limit(EXTRA_TIME_S + file.size / MIN_BYTES_S, path, "Reading"):
                    await transfer.run()
            except Disconnected:
                disconnected = True
                raise
            finally:
                if not disconnected:
                    await self._terminate(path, opened.session)

    async def write(self, path: str, content: bytes, progress: ReportBytes | None = None) -> None:
        """Writes a file; replaces an existing one, of which a failure leaves nothing.

        Args:
            path: path on the vehicle.
            content: what is written.
            progress: called with the progress; what it raises ends the upload.

        Raises:
            FtpFailed, NoReply, Disconnected: see `read_parts`.
        """
        vehicle = self._vehicle
        vehicle.require("files")
        async with self._lock:
            opened = await self._open(path, Opcode.CREATE_FILE)
            disconnected = False
            try:
                upload = Upload(self, vehicle.id, vehicle.clock, path, opened.session, content, progress)
                async with _time_limit(EXTRA_TIME_S + len(content) / MIN_BYTES_S, path, "Writing"):
                    await upload.run()
            except Disconnected:
                disconnected = True
                raise
            finally:
                if not disconnected:
                    await self._terminate(path, opened.session)

    async def change(self, request: Packet, path: str, activity: str) -> None:
        """Sends a request that changes the file system: remove, rename, make a folder.

        Raises:
            FtpFailed: the vehicle refused.
            NoReply: no answer came; it may have been done.
            Disconnected: the vehicle was lost.
        """
        self._vehicle.require("files")
        async with self._lock:
            await self._request(request, path, activity)

    # --- one operation each -------------------------------------------------------------------------

    async def _list(self, path: str) -> list[DirectoryEntry]:
        entries: list[DirectoryEntry] = []
        offset = 0
        while offset < MAX_ENTRIES:
            request = codec.request(Opcode.LIST_DIRECTORY, 0, path=path, offset=offset)
            try:
                reply = await self._request(request, path, "Listing")
            except FtpFailed as error:
                if error.ftp_error == FtpError.END_OF_FILE:
                    break
                raise
            entries_read, count = codec.parse_listing(reply.data)
            if not count:
                break
            entries += entries_read
            offset += count
        return entries

    async def _open(self, path: str, opcode: Opcode = Opcode.OPEN_FILE_RO) -> Packet:
        for attempt in range(BUSY_ATTEMPTS):
            try:
                opened = await self._request(codec.request(opcode, 0, path=path), path, "Opening")
                self._may_be_open = True
                return opened
            except FtpFailed as error:
                if error.ftp_error != FtpError.NO_SESSIONS_AVAILABLE or attempt == BUSY_ATTEMPTS - 1:
                    raise
            if self._may_be_open:
                await self._request(Packet(0, Opcode.RESET_SESSIONS), path, "Opening")
                self._may_be_open = False
            else:  # another station has the session, and only that station can end it
                await self._vehicle.clock.sleep(BUSY_PAUSE_S)
        raise AssertionError("the loop returns or raises")

    async def _terminate(self, path: str, session: int) -> None:
        """Closes the session if possible; a session that stays open is closed before the next file."""
        try:
            async with asyncio.timeout(3.0):
                await self._request(Packet(0, Opcode.TERMINATE_SESSION, session), path, "Closing")
        except (FtpFailed, NoReply, TimeoutError):
            return
        self._may_be_open = False

    # --- one request ------------------------------------------------------------------------------------

    async def _request(
        self, packet: Packet, path: str, activity: str, attempts: int = MAX_ATTEMPTS
    ) -> Packet:
        """Sends a request until the reply arrives, always with the same sequence number."""
        sequence = self.take_sequence()
        request = Packet(
            sequence, packet.opcode, packet.session, packet.size, offset=packet.offset, data=packet.data
        )
        timeout_s = FIRST_TIMEOUT_S
        with self.expect(Opcode(packet.opcode)) as waiter:
            for _ in range(attempts):
                self.send(request)
                try:
                    async with asyncio.timeout(timeout_s):
                        while True:
                            reply = packet_of(await waiter.next())
                            if reply is not None and reply.sequence == (sequence + 1) & 0xFFFF:
                                if reply.opcode == Opcode.NAK:
                                    raise codec.refusal(reply, path, activity)
                                return reply
                except TimeoutError:
                    timeout_s = min(timeout_s * 1.4, MAX_TIMEOUT_S)
        raise NoReply(
            f"Vehicle {self._vehicle.id} did not answer: {activity.lower()} {path or '/'}.",
            deadline_s=round(_total_timeout_s(attempts), 1),
            remedy="Check the link, then list the folder: it may have been done."
            if packet.opcode in CHANGING
            else "Check the link; nothing on the vehicle was changed.",
        )

    def expect(self, opcode: Opcode) -> AbstractContextManager[Waiter]:
        """Waits for replies to requests of this kind."""
        vehicle = self._vehicle

        def matches(message: Reply) -> bool:
            identity, reply = vehicle.identity, packet_of(message)
            return (
                reply is not None
                and reply.request_opcode == opcode
                and reply.opcode in (Opcode.ACK, Opcode.NAK)
                and (message.get_srcSystem(), message.get_srcComponent())
                == (identity.system_id, identity.component_id)
                and (message.target_system, message.target_component) == vehicle.own_ids
            )

        return vehicle.mailbox.expect(d.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL, matches=matches)

    def send(self, packet: Packet) -> None:
        """Sends a request once."""
        identity = self._vehicle.identity
        message = d.MAVLink_file_transfer_protocol_message(
            0, identity.system_id, identity.component_id, codec.encode(packet)
        )
        self._vehicle.send_payload(message.get_msgId(), encode_payload(message))

    def take_sequence(self) -> int:
        """The next sequence number. It increases by two, because the reply uses the number in between."""
        self.sequence = (self.sequence + 2) & 0xFFFF
        return self.sequence


@asynccontextmanager
async def _time_limit(limit_s: float, path: str, activity: str) -> AsyncGenerator[None]:
    """Limits the time of a block.

    Raises:
        FtpFailed: the time is over.
    """
    try:
        async with asyncio.timeout(limit_s):
            yield
    except TimeoutError:
        raise FtpFailed(
            f"{activity} {path or '/'}: not finished within {limit_s:.0f} s, so the server gave up.",
            path=path,
            remedy="Check the link, then try again.",
        ) from None


def _total_timeout_s(attempts: int) -> float:
    timeout_s, total_s = FIRST_TIMEOUT_S, 0.0
    for _ in range(attempts):
        total_s += timeout_s
        timeout_s = min(timeout_s * 1.4, MAX_TIMEOUT_S)
    return total_s
