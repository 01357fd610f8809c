"""Reads one open file: bursts transfer its end, several requests at a time the parts that were lost.

The vehicle's replies are untrusted: a transfer has a limit of replies, and ends with a reason.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator

from gcs_server.clock import Clock
from gcs_server.vehicle.services import ftp_codec as codec
from gcs_server.vehicle.services.ftp_codec import FtpError, FtpFailed, Opcode, Packet
from gcs_server.vehicle.services.ftp_pieces import PartialFile
from gcs_server.vehicle.services.ftp_window import RequestWindow, Session, packet_of

BURST_SILENCE_S = 0.6
"""Time without a reply after which a burst has ended, or its last packet was lost [s]."""
MAX_EMPTY_BURSTS = 3
MIN_BURST_BYTES = 4 * codec.DATA_BYTES
"""A shorter end of a file is requested in pieces."""
MAX_HOLES = 1024
"""With so many lost parts they are requested before the next burst."""
MAX_AHEAD = 4096
"""A reply belongs to a burst if its number differs from the newest by at most this."""
REPLIES_PER_FULL_PIECE, EXTRA_REPLIES = 16, 256
"""Maximum number of replies per 239 bytes of a file (with 20 % loss, two replies are needed), and additional
replies for any file."""
YIELD_AFTER_REPLIES = 32
"""Number of replies that are handled before the event loop does other work."""

ReportBytes = Callable[[int, int], None]
"""Called with (bytes received, total bytes); an error that it raises ends the transfer."""


class Transfer:
    """The transfer of one open file.

    Args:
        client: the client that has opened the file.
        vehicle_id: the vehicle, for the texts of errors.
        clock: the vehicle's clock.
        path: path on the vehicle.
        session: number of the session.
        file: what has arrived; may have parts already.
        progress: called after each new piece.
    """

    def __init__(
        self,
        client: Session,
        vehicle_id: str,
        clock: Clock,
        path: str,
        session: int,
        file: PartialFile,
        progress: ReportBytes | None,
    ) -> None:
        self._client = client
        self._path, self._session, self._file = path, session, file
        self._progress = progress
        missing = file.size - file.received
        self._replies_left = EXTRA_REPLIES + REPLIES_PER_FULL_PIECE * (missing // codec.DATA_BYTES)
        silent = f"Vehicle {vehicle_id} did not answer: reading {path}."
        self._window = RequestWindow(client, clock, silent)

    async def run(self) -> None:
        """Reads what is missing.

        Raises:
            FtpFailed: the vehicle refused, or the file arrives in too many pieces, from another offset than
                requested, or ends early.
            NoReply: the vehicle stopped answering.
            Disconnected: the vehicle was lost.
        """
        file, empty_bursts = self._file, 0
        while not file.complete:
            tail = file.tail
            if (
                tail is None
                or tail[1] - tail[0] < MIN_BURST_BYTES
                or not self._client.supports_burst
                or empty_bursts == MAX_EMPTY_BURSTS
            ):
                await self._read_before(file.size)
            elif file.missing_count > MAX_HOLES:
                await self._read_before(tail[0])
            else:
                empty_bursts = 0 if await self._burst(tail) else empty_bursts + 1

    # --- bursts ---------------------------------------------------------------------------------------

    async def _burst(self, part: tuple[int, int]) -> bool:
        """Reads from the beginning of a part in one burst; returns whether a new piece was received."""
        client, file = self._client, self._file
        first = newest = client.take_sequence()
        received_any = False
        with client.expect(Opcode.BURST_READ_FILE) as waiter:
            client.send(
                Packet(first, Opcode.BURST_READ_FILE, self._session, codec.DATA_BYTES, offset=part[0])
            )
            while not file.complete:
                try:
                    async with asyncio.timeout(BURST_SILENCE_S):
                        reply = packet_of(await waiter.next())
                except TimeoutError:
                    break
                await self._count_reply()
                if reply is None:
                    continue
                ahead, since_first = (reply.sequence - newest) & 0xFFFF, (reply.sequence - first) & 0xFFFF
                if 0 < ahead <= MAX_AHEAD:
                    newest = reply.sequence
                elif ahead < 0x10000 - MAX_AHEAD or not 1 <= since_first <= 0x8000:
                    continue
                if reply.opcode == Opcode.NAK:
                    self._burst_refused(reply, received_any, part[0])
                    break
                if reply.session == self._session and file.put(reply.offset, reply.data):
                    received_any = True
                    self._report()
                if reply.burst_complete:
                    break
        # The next number must be higher than all numbers of this burst. Otherwise the vehicle treats the next
        # request as a repetition, and replies with a piece of the burst.
        tail = file.tail
        lost = 0 if tail is None else (tail[1] - tail[0]) // codec.DATA_BYTES
        client.sequence = (newest + min(lost, MAX_AHEAD) + 4) & 0xFFFF
        return received_any

    def _burst_refused(self, reply: Packet, received_any: bool, start: int) -> None:
        error = codec.refusal(reply, self._path, "Reading")
        if error.ftp_error == FtpError.UNKNOWN_COMMAND:
            self._client.supports_burst = False
        elif error.ftp_error != FtpError.END_OF_FILE:
            raise error
        elif not received_any and reply.offset <= start < self._file.size:
            raise self._ended_early()

    # --- requests for pieces --------------------------------------------------------------------------

    async def _read_before(self, before: int) -> None:
        """Reads the missing parts that begin before an offset, several pieces at a time."""

        def missing() -> Iterator[Packet]:
            for start, end in self._file.missing_pieces(codec.DATA_BYTES, before):
                yield Packet(0, Opcode.READ_FILE, self._session, end - start, offset=start)

        await self._window.run(Opcode.READ_FILE, missing, self._take, self._count_reply)

    def _take(self, reply: Packet, request: Packet) -> None:
        start, size = request.offset, request.size
        if reply.opcode == Opcode.NAK:
            error = codec.refusal(reply, self._path, "Reading")
            raise self._ended_early() if error.ftp_error == FtpError.END_OF_FILE else error
        if reply.offset != start:
            raise FtpFailed(
                f"Reading {self._path}: the vehicle answered with byte {reply.offset:,} instead of "
                f"{start:,}.",
                path=self._path,
            )
        if not reply.data:
            raise self._ended_early()
        if self._file.put(start, reply.data[:size]):
            self._report()

    # --- both -----------------------------------------------------------------------------------------

    def _report(self) -> None:
        if self._progress is not None:
            self._progress(self._file.received, self._file.size)

    async def _count_reply(self) -> None:
        """Counts a reply; periodically lets the event loop do other work."""
        self._replies_left -= 1
        if self._replies_left < 0:
            raise FtpFailed(
                f"Reading {self._path}: the vehicle sends the file in too many pieces, so the server gave "
                "up.",
                path=self._path,
            )
        if self._replies_left % YIELD_AFTER_REPLIES == 0:
            await asyncio.sleep(0)

    def _ended_early(self) -> FtpFailed:
        return FtpFailed(
            f"Reading {self._path}: the file ended before its {self._file.size:,} bytes.", path=self._path
        )
