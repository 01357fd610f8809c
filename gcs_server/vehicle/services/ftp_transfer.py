"""Reads one open file: bursts transfer its end, several requests at a time the parts that were lost.

The vehicle's replies are untrusted: a transfer has a limit of replies, and ends with a reason.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Protocol

from gcs_server.clock import Clock
from gcs_server.errors import NoReply
from gcs_server.mavlink.mailbox import Reply, Waiter
from gcs_server.vehicle.services import ftp_codec as codec
from gcs_server.vehicle.services.ftp_codec import FtpError, FtpFailed, Opcode, Packet
from gcs_server.vehicle.services.ftp_pieces import PartialFile

BURST_SILENCE_S = 0.6
"""Time without a reply after which a burst has ended, or its last packet was lost [s]."""
MAX_EMPTY_BURSTS = 3
MIN_BURST_BYTES = 4 * codec.DATA_BYTES
"""A shorter end of a file is requested in pieces."""
MAX_HOLES = 1024
"""With so many lost parts they are requested before the next burst."""
MAX_AHEAD = 4096
"""A reply belongs to a burst if its number differs from the newest by at most this."""
WINDOW = 8
"""Requests under way; the first reply is awaited alone. PX4 handles one after the other."""
PASSED = 3
"""A request is repeated at once when so many later ones were answered."""
FIRST_TIMEOUT_S, MIN_TIMEOUT_S, MAX_TIMEOUT_S = 0.25, 0.1, 1.5
"""Time until a request is repeated; then three times the usual time of an answer, within these limits [s]."""
SILENCE_S = 12.0
"""Without any reply for this time the vehicle has stopped answering [s]; with 20 % of the packets lost each
way, of some fifty requests none is answered once in 10^22 times."""
REPLIES_PER_FULL_PIECE, EXTRA_REPLIES = 16, 256
"""Maximum number of replies per 239 bytes of a file (with 20 % loss, two replies are needed), and additional
replies for any file."""
YIELD_AFTER_REPLIES = 32
"""Number of replies that are handled before the event loop does other work."""

ReportBytes = Callable[[int, int], None]
"""Called with (bytes received, total bytes); an error that it raises ends the transfer."""


class Session(Protocol):
    """What a transfer uses of the client that has opened the file."""

    sequence: int
    """Number of the last request."""
    supports_burst: bool

    def take_sequence(self) -> int: ...
    def send(self, packet: Packet) -> None: ...
    def expect(self, opcode: Opcode) -> AbstractContextManager[Waiter]: ...


@dataclass(slots=True)
class _Request:
    """A request under way."""

    packet: Packet
    sent_s: float
    repeated: bool = False
    passed: int = 0
    """Number of later requests that were answered."""


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
        self._client, self._vehicle_id, self._clock = client, vehicle_id, clock
        self._path, self._session, self._file = path, session, file
        self._progress = progress
        missing = file.size - file.received
        self._replies_left = EXTRA_REPLIES + REPLIES_PER_FULL_PIECE * (missing // codec.DATA_BYTES)
        self._timeout_s = FIRST_TIMEOUT_S

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
        under_way: dict[int, _Request] = {}  # by the number of the reply, in the order of sending
        window, heard_s = 1, self._clock.monotonic_s()
        with self._client.expect(Opcode.READ_FILE) as waiter:
            while True:
                self._request(under_way, window, before)
                if not under_way:
                    return
                reply = await self._next(waiter, under_way)
                if reply is not None:
                    await self._count_reply()
                    if (request := under_way.pop(reply.sequence, None)) is not None:
                        heard_s = self._clock.monotonic_s()
                        self._take(reply, request, heard_s)
                        _count_passed(under_way, request)
                        window = min(window + 1, WINDOW)
                self._repeat(under_way)
                if self._clock.monotonic_s() - heard_s > SILENCE_S:
                    raise NoReply(
                        f"Vehicle {self._vehicle_id} did not answer: reading {self._path}.",
                        deadline_s=SILENCE_S,
                        remedy="Check the link; nothing on the vehicle was changed.",
                    )

    def _request(self, under_way: dict[int, _Request], window: int, before: int) -> None:
        starts = {request.packet.offset for request in under_way.values()}
        if len(starts) >= window:
            return
        for start, end in self._file.missing_pieces(codec.DATA_BYTES, before):
            if start in starts:
                continue
            sequence = self._client.take_sequence()
            packet = Packet(sequence, Opcode.READ_FILE, self._session, end - start, offset=start)
            under_way[(sequence + 1) & 0xFFFF] = _Request(packet, self._clock.monotonic_s())
            self._client.send(packet)
            if len(under_way) >= window:
                return

    async def _next(self, waiter: Waiter, under_way: dict[int, _Request]) -> Packet | None:
        """The next reply; None: a request is to be repeated."""
        first_s = min(request.sent_s for request in under_way.values())
        try:
            async with asyncio.timeout(max(0.0, first_s + self._timeout_s - self._clock.monotonic_s())):
                return packet_of(await waiter.next())
        except TimeoutError:
            return None

    def _take(self, reply: Packet, request: _Request, now_s: float) -> None:
        start, size = request.packet.offset, request.packet.size
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
        if not request.repeated:
            usual_s = min(max(3.0 * (now_s - request.sent_s), MIN_TIMEOUT_S), MAX_TIMEOUT_S)
            self._timeout_s += 0.25 * (usual_s - self._timeout_s)
        if self._file.put(start, reply.data[:size]):
            self._report()

    def _repeat(self, under_way: dict[int, _Request]) -> None:
        """Sends requests again, with their numbers, so that the vehicle repeats its reply."""
        now_s = self._clock.monotonic_s()
        for number, request in list(under_way.items()):
            if request.passed >= PASSED or now_s - request.sent_s >= self._timeout_s:
                del under_way[number]
                under_way[number] = _Request(request.packet, now_s, repeated=True)
                self._client.send(request.packet)

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


def packet_of(message: Reply) -> Packet | None:
    """The FTP packet of a message; None: it has none."""
    return codec.decode(bytes(message.payload))


def _count_passed(under_way: dict[int, _Request], answered: _Request) -> None:
    for request in under_way.values():
        if request.sent_s <= answered.sent_s and not answered.repeated:
            request.passed += 1
