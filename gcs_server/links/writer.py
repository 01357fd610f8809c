"""Writes the waiting packets of a link frame by frame, from any thread and from a timer of the event loop."""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from gcs_server.faults import FaultLog
from gcs_server.links.pacing import RECHECK_PERIOD_S, Pacer, Unpaced
from gcs_server.links.send_queue import Packet, SendCounts, SendQueue

if TYPE_CHECKING:
    from gcs_server.links.base import Peer

PURGE_EVERY_S = 0.1
Write = Callable[[bytes, "Peer"], int]
"""Writes some of the bytes and returns their number; raises BlockingIOError if it would block."""


class LinkWriter:
    """Sends a queue's packets as the pacer allows. `submit` writes immediately what can be sent; the rest is
    written by the next `submit` or by the event loop's timer. A packet is completed only when its bytes can
    be sent. The rest of a partly sent frame is sent before the next frame. If the frame expires first, its
    rest is sent with a wrong checksum, so that the vehicle ignores the frame and reads the next one.

    Args:
        loop: event loop for the timer; None if writing never blocks.
        now_s: clock for the expiry of packets (the event loop's).
        on_failure: called in the event loop if the descriptor fails; None: only the packet is lost.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop | None,
        write: Write,
        counts: SendCounts,
        faults: FaultLog,
        now_s: Callable[[], float],
        *,
        pacer: Pacer | None = None,
        on_failure: Callable[[OSError], None] | None = None,
    ) -> None:
        self._loop = loop
        self._now_s = now_s
        self._write = write
        self._counts = counts
        self._faults = faults
        self._pacer = pacer or Unpaced()
        self._on_failure = on_failure
        self._queue = SendQueue(counts)
        self._partial: tuple[Packet, bytes] | None = None
        """The partly sent frame, and its remaining bytes."""
        self._lost: Packet | None = None
        """The packet that could not be sent during the current `submit`."""
        self._timer: asyncio.TimerHandle | None = None
        self._timer_requested = False
        self._next_purge_s = 0.0
        self._closed = False

    @property
    def waiting(self) -> int:
        """Number of waiting packets."""
        return len(self._queue)

    def submit(self, packet: Packet) -> bool:
        """Sends or queues a packet, from any thread; False if it was dropped."""
        with self._counts.lock:
            if self._closed:
                return False
            now_s = self._now_s()
            self._lost = None
            if not self._may_write_now(packet, now_s):
                queued = self._queue.put(packet, now_s)
                self._write_waiting(now_s)
                return queued and not self._was_lost(packet)
            if not self._write_packet(packet, now_s):
                self._write_waiting(now_s, RECHECK_PERIOD_S)
            elif self._partial is not None:
                self._write_waiting(now_s)
            return not self._was_lost(packet)

    def close(self) -> None:
        """Drops waiting packets and writes nothing more. Call before the descriptor is closed."""
        with self._counts.lock:
            self._closed = True
            self._partial = None
            self._queue.clear()
        if self._timer is not None:
            self._timer.cancel()

    # --- with the lock held -----------------------------------------------------------------------

    def _write_waiting(self, now_s: float, wait_s: float = 0.0) -> None:
        """Writes what waits, after `wait_s`, as the pacer allows."""
        while not self._closed and wait_s <= 0 and (self._partial is not None or self._queue):
            wait_s = self._pacer.wait_s(now_s)
            if wait_s <= 0 and not self._write_one(now_s):
                wait_s = RECHECK_PERIOD_S
        if wait_s > 0:
            if now_s >= self._next_purge_s:
                self._next_purge_s = now_s + PURGE_EVERY_S
                self._queue.purge(now_s)
            if self._partial is not None or self._queue:
                self._wake_in(wait_s)

    def _may_write_now(self, packet: Packet, now_s: float) -> bool:
        """Whether the packet need not be queued, because no other packet waits."""
        if self._partial is not None or self._queue or packet.expires_s < now_s:
            return False
        return self._pacer.wait_s(now_s) <= 0

    def _write_one(self, now_s: float) -> bool:
        """Writes the rest of a frame, or the next one; False if the descriptor is blocked."""
        if self._partial is None:
            packet = self._queue.take(now_s)
            return packet is None or self._write_packet(packet, now_s)
        packet, data = self._partial
        if packet.expires_s < now_s:
            data = data[:-1] + bytes([data[-1] ^ 0xFF])
            packet.expires_s = math.inf  # the checksum is changed only once
        return self._write_bytes(packet, data, now_s)

    def _write_packet(self, packet: Packet, now_s: float) -> bool:
        """Completes and writes a packet; False if the descriptor is blocked, and the packet waits."""
        try:
            data = packet.finish()
        except Exception as error:  # only this packet is lost
            self._faults.add(error, "finishing a frame")
            self._drop(packet)
            return True
        return self._write_bytes(packet, data, now_s)

    def _write_bytes(self, packet: Packet, data: bytes, now_s: float) -> bool:
        partial = self._partial
        try:
            written = self._write(data, packet.peer)
        except (BlockingIOError, InterruptedError):
            written = 0
        except OSError as error:
            self._drop(packet)
            self._fail(error)
            return True
        if not written:
            if partial is None:
                self._queue.put_back(packet)
            else:
                self._partial = packet, data
            return False
        self._pacer.wrote(written, now_s)
        self._counts.bytes_sent += written
        self._partial = (packet, data[written:]) if written < len(data) else None
        if partial is None:
            self._counts.frames_sent += 1
            try:
                packet.on_sent(data)
            except Exception as error:
                self._faults.add(error, "recording a sent frame")
        return True

    def _was_lost(self, packet: Packet) -> bool:
        return self._lost is packet

    def _drop(self, packet: Packet) -> None:
        self._lost = packet
        self._counts.frames_dropped += 1
        self._counts.bytes_dropped += packet.size_bytes

    def _fail(self, error: OSError) -> None:
        if self._on_failure is not None and self._loop is not None:
            self._closed = True
            self._partial = None
            self._queue.clear()
            self._call_in_loop(self._on_failure, error)

    def _wake_in(self, wait_s: float) -> None:
        if self._loop is not None and not self._timer_requested:
            self._timer_requested = True
            self._call_in_loop(self._set_timer, self._now_s() + wait_s)

    def _call_in_loop(self, callback: Callable[..., None], argument: object) -> None:
        assert self._loop is not None
        with contextlib.suppress(RuntimeError):  # the event loop is closed, so the server has ended
            self._loop.call_soon_threadsafe(callback, argument)

    # --- in the event loop ---------------------------------------------------------------------------

    def _set_timer(self, at_s: float) -> None:
        if not self._closed and self._loop is not None:
            self._timer = self._loop.call_at(at_s, self._wake)

    def _wake(self) -> None:
        with self._counts.lock:
            self._timer_requested = False
            try:
                self._write_waiting(self._now_s())
            except Exception as error:
                self._faults.add(error, "sending")
                self._wake_in(RECHECK_PERIOD_S)
