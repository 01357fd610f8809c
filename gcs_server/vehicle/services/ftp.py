"""Reads files of the vehicle over links that lose packets.

Operations run one at a time, because PX4 has one session per link. An unanswered request is sent again with
the same sequence number, so that the vehicle repeats its reply. Nothing is written to the vehicle. A burst
transfers most of a file; lost parts are read one by one.

The vehicle's replies are untrusted: a transfer has limits of bytes, replies and time, and fails with a reason
if the vehicle exceeds a limit.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager

from gcs_server.errors import Disconnected, NoReply
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import encode_payload
from gcs_server.mavlink.mailbox import Reply
from gcs_server.vehicle.services import ftp_codec as codec
from gcs_server.vehicle.services.ftp_codec import DirectoryEntry, FtpError, FtpFailed, Opcode, Packet
from gcs_server.vehicle.services.ftp_pieces import PartialFile
from gcs_server.vehicle.services.port import VehiclePort

FIRST_TIMEOUT_S = 0.25
MAX_TIMEOUT_S = 1.5
MAX_ATTEMPTS = 12
"""Maximum number of attempts; with 20 % loss each way, one request in 200,000 fails."""
BURST_SILENCE_S = 0.6
"""Time without a reply after which a burst has ended, or its last packet was lost [s]."""
MAX_EMPTY_BURSTS = 3
BUSY_ATTEMPTS, BUSY_PAUSE_S = 4, 3.0
"""Attempts to open a file while all sessions are in use, and the pause between them [s]; PX4 closes
an unused session after this pause."""
MAX_BYTES = 8_000_000
MAX_ENTRIES = 10_000
REPLIES_PER_FULL_PIECE, EXTRA_REPLIES = 16, 256
"""Maximum number of replies per 239 bytes of a file (with 20 % loss, two replies are needed), and additional
replies for any file."""
MIN_BYTES_S, EXTRA_TIME_S = 400, 60.0
"""Minimum average speed of a transfer [bytes/s], and additional time for any file [s]."""
LIST_TIMEOUT_S = 120.0
YIELD_AFTER_REPLIES = 32
"""Number of replies that are handled before the event loop does other work."""

ReportBytes = Callable[[int, int], None]
"""Called with (bytes received, total bytes)."""


class FtpService:
    """Reads one vehicle's files."""

    def __init__(self, vehicle: VehiclePort) -> None:
        self._vehicle = vehicle
        self._lock = asyncio.Lock()
        self._sequence = 0
        self._may_be_open = True
        """Whether a session of this server, or of its previous run, may still be open."""
        self._supports_burst = True
        self._replies_left = 0
        """Number of further replies that are accepted for the current file."""

    async def list(self, path: str) -> list[DirectoryEntry]:
        """Lists a folder.

        Raises:
            FtpFailed: the vehicle refused, or sends an endless list.
            NoReply: the vehicle stopped answering.
        """
        self._vehicle.require("files")
        async with self._lock, _time_limit(LIST_TIMEOUT_S, path, "Listing"):
            return await self._list(path)

    async def crc32(self, path: str) -> int:
        """Requests MAVLink's checksum of a file from the vehicle; raises the errors of `list`."""
        self._vehicle.require("files")
        async with self._lock:
            reply = await self._request(codec.request(Opcode.CALC_FILE_CRC32, 0, path=path), path, "Checking")
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
        self._vehicle.require("files")
        async with self._lock:
            opened = await self._open(path)
            disconnected = False
            try:
                size = int.from_bytes(opened.data[:4], "little") if len(opened.data) >= 4 else 0
                if size > max_bytes:
                    raise FtpFailed(
                        f"{path} has {size:,} bytes; more than {max_bytes:,} are not read.", path=path
                    )
                self._replies_left = EXTRA_REPLIES + REPLIES_PER_FULL_PIECE * (size // codec.DATA_BYTES)
                async with _time_limit(EXTRA_TIME_S + size / MIN_BYTES_S, path, "Reading"):
                    return await self._transfer(path, opened.session, PartialFile(size), progress)
            except Disconnected:
                disconnected = True
                raise
            finally:
                if not disconnected:
                    await self._terminate(path, opened.session)

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

    async def _open(self, path: str) -> Packet:
        for attempt in range(BUSY_ATTEMPTS):
            try:
                opened = await self._request(
                    codec.request(Opcode.OPEN_FILE_RO, 0, path=path), path, "Opening"
                )
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

    async def _transfer(
        self, path: str, session: int, file: PartialFile, progress: ReportBytes | None
    ) -> bytes:
        empty_bursts = 0
        while not file.complete:
            if self._supports_burst and file.tail_missing and empty_bursts < MAX_EMPTY_BURSTS:
                received_any = await self._burst(path, session, file, progress)
                empty_bursts = 0 if received_any else empty_bursts + 1
            else:
                await self._read_missing(path, session, file)
                if progress is not None:
                    progress(file.received, file.size)
        return file.content

    async def _read_missing(self, path: str, session: int, file: PartialFile) -> None:
        part = file.first_missing
        assert part is not None
        start, end = part
        size = min(end - start, codec.DATA_BYTES)
        reply = await self._request(Packet(0, Opcode.READ_FILE, session, size, offset=start), path, "Reading")
        await self._count_reply(path)
        if reply.offset != start:
            raise FtpFailed(
                f"Reading {path}: the vehicle answered with byte {reply.offset:,} instead of {start:,}.",
                path=path,
            )
        if not file.put(start, reply.data[:size]):
            raise FtpFailed(f"Reading {path}: the file ended before its {file.size:,} bytes.", path=path)

    async def _burst(self, path: str, session: int, file: PartialFile, progress: ReportBytes | None) -> bool:
        """Reads from the first missing part in one burst; returns whether a new piece was received."""
        part = file.first_missing
        assert part is not None
        first = self._take_sequence()
        max_packets = (part[1] - part[0]) // codec.DATA_BYTES + 3
        request = Packet(first, Opcode.BURST_READ_FILE, session, codec.DATA_BYTES, offset=part[0])
        received_any = False
        with self._expect(Opcode.BURST_READ_FILE) as waiter:
            self._send(request)
            while not file.complete:
                try:
                    async with asyncio.timeout(BURST_SILENCE_S):
                        reply = _packet(await waiter.next())
                except TimeoutError:
                    break
                await self._count_reply(path)
                if reply is None or not 1 <= (reply.sequence - first) & 0xFFFF <= max_packets:
                    continue
                if reply.opcode == Opcode.NAK:
                    self._burst_refused(reply, path, received_any, file, part[0])
                    break
                if reply.session == session and file.put(reply.offset, reply.data):
                    received_any = True
                    if progress is not None:
                        progress(file.received, file.size)
                if reply.burst_complete:
                    break
        # The next number must be higher than all numbers of this burst. Otherwise the vehicle treats the next
        # request as a repetition, and replies with a piece of the burst.
        self._sequence = (first + max_packets + 1) & 0xFFFF
        return received_any

    def _burst_refused(
        self, reply: Packet, path: str, received_any: bool, file: PartialFile, start: int
    ) -> None:
        error = codec.refusal(reply, path, "Reading")
        if error.ftp_error == FtpError.UNKNOWN_COMMAND:
            self._supports_burst = False
        elif error.ftp_error != FtpError.END_OF_FILE:
            raise error
        elif not received_any and reply.offset <= start < file.size:
            raise FtpFailed(f"Reading {path}: the file ended before its {file.size:,} bytes.", path=path)

    async def _count_reply(self, path: str) -> None:
        """Counts a reply; periodically lets the event loop do other work."""
        self._replies_left -= 1
        if self._replies_left < 0:
            raise FtpFailed(
                f"Reading {path}: the vehicle sends the file in too many pieces, so the server gave up.",
                path=path,
            )
        if self._replies_left % YIELD_AFTER_REPLIES == 0:
            await asyncio.sleep(0)

    # --- one request ------------------------------------------------------------------------------------

    async def _request(self, packet: Packet, path: str, activity: str) -> Packet:
        """Sends a request until the reply arrives, always with the same sequence number."""
        sequence = self._take_sequence()
        request = Packet(
            sequence, packet.opcode, packet.session, packet.size, offset=packet.offset, data=packet.data
        )
        timeout_s = FIRST_TIMEOUT_S
        with self._expect(Opcode(packet.opcode)) as waiter:
            for _ in range(MAX_ATTEMPTS):
                self._send(request)
                try:
                    async with asyncio.timeout(timeout_s):
                        while True:
                            reply = _packet(await waiter.next())
                            if reply is not None and reply.sequence == (sequence + 1) & 0xFFFF:
                                if reply.opcode == Opcode.NAK:
                                    raise codec.refusal(reply, path, activity)
                                return reply
                except TimeoutError:
                    timeout_s = min(timeout_s * 1.4, MAX_TIMEOUT_S)
        raise NoReply(
            f"Vehicle {self._vehicle.id} did not answer: {activity.lower()} {path or '/'}.",
            deadline_s=round(_total_timeout_s(), 1),
            remedy="Check the link; nothing on the vehicle was changed.",
        )

    def _expect(self, opcode: Opcode):  # noqa: ANN202 the mailbox's context manager
        vehicle = self._vehicle

        def matches(message: Reply) -> bool:
            identity, reply = vehicle.identity, _packet(message)
            return (
                reply is not None
                and reply.request_opcode == opcode
                and reply.opcode in (Opcode.ACK, Opcode.NAK)
                and (message.get_srcSystem(), message.get_srcComponent())
                == (identity.system_id, identity.component_id)
                and (message.target_system, message.target_component) == vehicle.own_ids
            )

        return vehicle.mailbox.expect(d.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL, matches=matches)

    def _send(self, packet: Packet) -> None:
        identity = self._vehicle.identity
        message = d.MAVLink_file_transfer_protocol_message(
            0, identity.system_id, identity.component_id, codec.encode(packet)
        )
        self._vehicle.send_payload(message.get_msgId(), encode_payload(message))

    def _take_sequence(self) -> int:
        """The next sequence number. It increases by two, because the reply uses the number in between."""
        self._sequence = (self._sequence + 2) & 0xFFFF
        return self._sequence


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


def _packet(message: Reply) -> Packet | None:
    return codec.decode(bytes(message.payload))


def _total_timeout_s() -> float:
    timeout_s, total_s = FIRST_TIMEOUT_S, 0.0
    for _ in range(MAX_ATTEMPTS):
        total_s += timeout_s
        timeout_s = min(timeout_s * 1.4, MAX_TIMEOUT_S)
    return total_s
