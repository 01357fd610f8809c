"""Writes what waits for a link, frame by frame, from any thread and a timer of the loop."""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from gcs_server.faults import FaultLog
from gcs_server.links.pacing import LOOK_AGAIN_S, Pacer, Unpaced
from gcs_server.links.send_queue import Packet, SendCounts, SendQueue

if TYPE_CHECKING:
    from gcs_server.links.base import Peer

PURGE_EVERY_S = 0.1
Write = Callable[[bytes, "Peer"], int]
"""Writes some of the bytes and says how many; raises BlockingIOError where it would wait."""


class LinkWriter:
    """Lets a queue's packets leave as its pacer allows.

    Whoever submits writes at once what can leave now; what has to wait is written by whoever submits next,
    or by the loop's timer. A packet is finished only when its bytes can leave. A frame that was begun is
    completed before the next one; where its end comes too late, it is sent so that its checksum fails: the
    vehicle reads what follows and does not obey it.

    Args:
        loop: for the timer; None where nothing ever has to wait.
        now_s: the clock by which packets expire (the loop's).
        failed: called in the loop when the descriptor is broken; None: a packet that fails is lost, no more.
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
        failed: Callable[[OSError], None] | None = None,
    ) -> None:
        self._loop = loop
        self._now_s = now_s
        self._write = write
        self._counts = counts
        self._faults = faults
        self._pacer = pacer or Unpaced()
        self._failed = failed
        self._queue = SendQueue(counts)
        self._begun: tuple[Packet, bytes] | None = None
        """The frame of which a part has left, and what is left of it."""
        self._lost: Packet | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._timer_wanted = False
        self._next_purge_s = 0.0
        self._closed = False

    @property
    def waiting(self) -> int:
        """Packets that wait."""
        return len(self._queue)

    def submit(self, packet: Packet) -> bool:
        """Sends it or lets it wait; from any thread. False: it was dropped."""
        with self._counts.lock:
            if self._closed:
                return False
            now_s = self._now_s()
            self._lost = None
            kept = self._queue.put(packet, now_s)
            self._pump(now_s)
            return kept and not self._was_lost(packet)

    def close(self) -> None:
        """Drops what waits; call before the descriptor is closed. Afterwards nothing is written."""
        with self._counts.lock:
            self._closed = True
            self._begun = None
            self._queue.clear()
        if self._timer is not None:
            self._timer.cancel()

    # --- with the lock held -----------------------------------------------------------------------

    def _pump(self, now_s: float) -> None:
        wait_s = 0.0
        while not self._closed and wait_s <= 0 and (self._begun is not None or len(self._queue)):
            wait_s = self._pacer.wait_s(now_s)
            if wait_s <= 0 and not self._write_one(now_s):
                wait_s = LOOK_AGAIN_S
        if wait_s > 0:
            if now_s >= self._next_purge_s:
                self._next_purge_s = now_s + PURGE_EVERY_S
                self._queue.purge(now_s)
            if self._begun is not None or len(self._queue):
                self._wake_in(wait_s)

    def _write_one(self, now_s: float) -> bool:
        """Writes the rest of a frame, or the next one; False where the descriptor takes nothing now."""
        begun = self._begun
        if begun is not None:
            packet, data = begun
            if packet.expires_s < now_s:
                data = data[:-1] + bytes([data[-1] ^ 0xFF])
                packet.expires_s = math.inf  # spoilt once
        else:
            packet = self._queue.take(now_s)
            if packet is None:
                return True
            try:
                data = packet.finish()
            except Exception as error:  # it costs this packet, not those that wait behind it
                self._faults.add(error, "finishing a frame")
                self._drop(packet)
                return True
        try:
            written = self._write(data, packet.peer)
        except (BlockingIOError, InterruptedError):
            written = 0
        except OSError as error:
            self._drop(packet)
            self._fail(error)
            return True
        if not written:
            if begun is None:
                self._queue.put_back(packet)
            else:
                self._begun = packet, data
            return False
        self._pacer.wrote(written, now_s)
        self._counts.bytes_sent += written
        self._begun = (packet, data[written:]) if written < len(data) else None
        if begun is None:
            self._counts.frames_sent += 1
            try:
                packet.left(data)
            except Exception as error:
                self._faults.add(error, "noting a frame that left")
        return True

    def _was_lost(self, packet: Packet) -> bool:
        return self._lost is packet

    def _drop(self, packet: Packet) -> None:
        self._lost = packet
        self._counts.frames_dropped += 1
        self._counts.bytes_dropped += packet.size_bytes

    def _fail(self, error: OSError) -> None:
        if self._failed is not None and self._loop is not None:
            self._closed = True
            self._begun = None
            self._queue.clear()
            self._in_loop(self._failed, error)

    def _wake_in(self, wait_s: float) -> None:
        if self._loop is not None and not self._timer_wanted:
            self._timer_wanted = True
            self._in_loop(self._set_timer, self._now_s() + wait_s)

    def _in_loop(self, callback: Callable[..., None], argument: object) -> None:
        assert self._loop is not None
        with contextlib.suppress(RuntimeError):  # the loop has ended, and with it the server
            self._loop.call_soon_threadsafe(callback, argument)

    # --- in the loop ------------------------------------------------------------------------------

    def _set_timer(self, at_s: float) -> None:
        if not self._closed and self._loop is not None:
            self._timer = self._loop.call_at(at_s, self._wake)

    def _wake(self) -> None:
        with self._counts.lock:
            self._timer_wanted = False
            try:
                self._pump(self._now_s())
            except Exception as error:
                self._faults.add(error, "sending")
                self._wake_in(LOOK_AGAIN_S)
