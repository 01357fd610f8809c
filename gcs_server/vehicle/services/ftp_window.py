"""Several FTP requests under way at a time: each until its reply arrives, or the vehicle stopped answering.

PX4 handles one request after the other, so that several under way make a slow link as fast as it is; one that
is repeated late is executed again, so that only requests that may be are sent this way: reading and writing
at an offset.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Protocol

from gcs_server.clock import Clock
from gcs_server.errors import NoReply
from gcs_server.mavlink.mailbox import Reply, Waiter
from gcs_server.vehicle.services import ftp_codec as codec
from gcs_server.vehicle.services.ftp_codec import Opcode, Packet

WINDOW = 8
"""Requests under way; the first reply is awaited alone."""
PASSED = 3
"""A request is repeated at once when so many later ones were answered."""
FIRST_TIMEOUT_S, MIN_TIMEOUT_S, MAX_TIMEOUT_S = 0.25, 0.1, 1.5
"""Time until a request is repeated; then three times the usual time of an answer, within these limits [s]."""
MIN_WAIT_S = 0.001
"""So that time passes although rounding makes a request's time over here and not yet over elsewhere [s]."""
SILENCE_S = 12.0
"""Without any reply for this time the vehicle has stopped answering [s]; with 20 % of the packets lost each
way, of some fifty requests none is answered once in 10^22 times."""


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


class RequestWindow:
    """Requests of one open file.

    Args:
        client: the client that has opened the file.
        clock: the vehicle's clock.
        silent: what to say if the vehicle stops answering.
    """

    def __init__(self, client: Session, clock: Clock, silent: str) -> None:
        self._client, self._clock, self._silent = client, clock, silent
        self._timeout_s = FIRST_TIMEOUT_S

    async def run(
        self,
        opcode: Opcode,
        missing: Callable[[], Iterator[Packet]],
        take: Callable[[Packet, Packet], None],
        count_reply: Callable[[], Awaitable[None]],
    ) -> None:
        """Sends requests until nothing is missing.

        Args:
            opcode: their kind.
            missing: the requests that are still to be answered, by offset, without sequence numbers.
            take: called with each reply and its request; what it raises ends the transfer.
            count_reply: called with each reply.

        Raises:
            NoReply: the vehicle stopped answering.
            Disconnected: the vehicle was lost.
        """
        under_way: dict[int, _Request] = {}  # by the number of the reply, in the order of sending
        window, heard_s = 1, self._clock.monotonic_s()
        with self._client.expect(opcode) as waiter:
            while True:
                self._request(under_way, window, missing())
                if not under_way:
                    return
                reply = await self._next(waiter, under_way)
                if reply is not None:
                    await count_reply()
                    if (request := under_way.pop(reply.sequence, None)) is not None:
                        heard_s = self._clock.monotonic_s()
                        take(reply, request.packet)
                        self._note_time(request, heard_s)
                        _count_passed(under_way, request)
                        window = min(window + 1, WINDOW)
                self._repeat(under_way)
                if self._clock.monotonic_s() - heard_s > SILENCE_S:
                    raise NoReply(
                        self._silent, deadline_s=SILENCE_S, remedy="Check the link, then try again."
                    )

    def _request(self, under_way: dict[int, _Request], window: int, missing: Iterator[Packet]) -> None:
        starts = {request.packet.offset for request in under_way.values()}
        if len(starts) >= window:
            return
        for packet in missing:
            if packet.offset in starts:
                continue
            sequence = self._client.take_sequence()
            numbered = Packet(
                sequence,
                packet.opcode,
                packet.session,
                packet.size,
                offset=packet.offset,
                data=packet.data,
            )
            under_way[(sequence + 1) & 0xFFFF] = _Request(numbered, self._clock.monotonic_s())
            self._client.send(numbered)
            if len(under_way) >= window:
                return

    async def _next(self, waiter: Waiter, under_way: dict[int, _Request]) -> Packet | None:
        """The next reply; None: a request is to be repeated."""
        first_s = min(request.sent_s for request in under_way.values())
        left_s = first_s + self._timeout_s - self._clock.monotonic_s()
        try:
            async with asyncio.timeout(max(MIN_WAIT_S, left_s)):
                return packet_of(await waiter.next())
        except TimeoutError:
            return None

    def _note_time(self, request: _Request, now_s: float) -> None:
        if not request.repeated:
            usual_s = min(max(3.0 * (now_s - request.sent_s), MIN_TIMEOUT_S), MAX_TIMEOUT_S)
            self._timeout_s += 0.25 * (usual_s - self._timeout_s)

    def _repeat(self, under_way: dict[int, _Request]) -> None:
        """Sends requests again, with their numbers, so that the vehicle repeats its reply."""
        now_s = self._clock.monotonic_s()
        for number, request in list(under_way.items()):
            if request.passed >= PASSED or now_s - request.sent_s >= self._timeout_s:
                del under_way[number]
                under_way[number] = _Request(request.packet, now_s, repeated=True)
                self._client.send(request.packet)


def packet_of(message: Reply) -> Packet | None:
    """The FTP packet of a message; None: it has none."""
    return codec.decode(bytes(message.payload))


def _count_passed(under_way: dict[int, _Request], answered: _Request) -> None:
    for request in under_way.values():
        if request.sent_s <= answered.sent_s and not answered.repeated:
            request.passed += 1
