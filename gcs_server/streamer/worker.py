"""The process that flies all setpoint streams, so that nothing the server does can delay one.

`process.py` starts it with two sockets: one by which the server calls `Rounds` and waits for the answer, and
one by which it hands over its links' sockets and is told, later, what went out by them (for the recordings).
What a link without datagrams is to carry goes back to the server, where a thread of its own passes it on.

It ends with the server: when the first socket closes, nothing is sent any more.
"""

from __future__ import annotations

import contextlib
import gc
import logging
import os
import pickle
import resource
import select
import signal
import socket
import sys
from collections import deque
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from gcs_server.clock import Clock, SystemClock
from gcs_server.mavlink.codec import encode_frame
from gcs_server.streamer.news import Snapshot
from gcs_server.streamer.rounds import Rounds
from gcs_server.streamer.setpoints import Order
from gcs_server.streamer.streams import StreamState

SENT_EVERY_S = 0.01
"""What went out is told no more often than this."""
SENT_AT_ONCE = 100
SENT_WAITING = 20_000
"""So many frames wait for a server that stands still; more are missing from its recording."""
LONGEST_RUN_US = 1_000_000
"""With real-time priority: of processor time without a pause, after which the system ends the process."""
LONGEST_SPELL_S, REST_S = 0.05, 0.005
"""Streams that want more than a processor are late rather than leave nothing to the server."""
LONGEST_HANDOVER = 64

Address = tuple[str, int]
Sent = tuple[int, int, bytes]
"""Number of the link's socket, time since 1970 [us], frame."""


@dataclass(frozen=True, slots=True)
class Route:
    """Where a vehicle's datagrams go."""

    socket_number: int
    address: Address


class Mail:
    """What the server is told without being waited for."""

    def __init__(self, way: socket.socket) -> None:
        self._way = way
        self._sent: deque[Sent] = deque(maxlen=SENT_WAITING)
        self._told_s = 0.0

    @property
    def waits(self) -> bool:
        """Whether something is yet to be told."""
        return bool(self._sent)

    def sent(self, what: Sent) -> None:
        """A frame went out."""
        self._sent.append(what)

    def relay(self, vehicle_id: str, msg_id: int, payload: bytes) -> bool:
        """The server shall send it. False where it takes nothing more."""
        try:
            self._way.send(pickle.dumps(("relay", vehicle_id, msg_id, payload)))
        except BlockingIOError:
            return False
        return True

    def tell(self, now_s: float) -> None:
        """Tells what went out, unless it did so just now."""
        if now_s - self._told_s < SENT_EVERY_S:
            return
        self._told_s = now_s
        while self._sent:
            some = [self._sent.popleft() for _ in range(min(SENT_AT_ONCE, len(self._sent)))]
            try:
                self._way.send(pickle.dumps(("sent", some)))
            except BlockingIOError:
                self._sent.extendleft(reversed(some))
                return


class Outlet:
    """One vehicle's way out of this process."""

    def __init__(self, vehicle_id: str, worker: Worker) -> None:
        self._vehicle_id = vehicle_id
        self._worker = worker
        self._seq = 0
        self.route: Route | None = None

    def send_payload(self, msg_id: int, payload: bytes) -> bool:
        """Sends a datagram, or has the server send it by another way."""
        worker, route = self._worker, self.route
        if route is None:
            return worker.mail.relay(self._vehicle_id, msg_id, payload)
        raw = encode_frame(msg_id, payload, self._seq, *worker.own_ids)
        try:
            worker.sockets[route.socket_number].sendto(raw, route.address)
        except OSError:
            return worker.mail.relay(self._vehicle_id, msg_id, payload)
        self._seq = (self._seq + 1) & 0xFF
        worker.mail.sent((route.socket_number, int(worker.clock.unix_s() * 1e6), raw))
        return True

    def way_out(self) -> None:
        """The server's side knows."""
        return None


class Worker:
    """The loop: a round when one is due, an answer when the server calls.

    Args:
        calls: the server's calls.
        way: for sockets in, and for what went out by them.
        own_ids: system and component id of the frames.
        rounds: what is run.
    """

    def __init__(
        self, calls: Connection, way: socket.socket, own_ids: tuple[int, int], clock: Clock, rounds: Rounds
    ) -> None:
        self._calls = calls
        self._way = way
        self._rounds = rounds
        self._outlets: dict[str, Outlet] = {}
        self.clock = clock
        self.own_ids = own_ids
        self.mail = Mail(way)
        self.sockets: dict[int, socket.socket] = {}

    def run(self) -> None:
        """Returns when the server has gone."""
        calls = self._calls.fileno()
        rested_s = self.clock.monotonic_s()
        while True:
            due_s = self._rounds.step()
            now_s = self.clock.monotonic_s()
            self.mail.tell(now_s)
            wait_s = due_s - now_s
            if self.mail.waits:
                wait_s = min(wait_s, SENT_EVERY_S)
            if now_s - rested_s > LONGEST_SPELL_S:
                wait_s = max(wait_s, REST_S)
            if wait_s > 0:
                rested_s = now_s + wait_s
            timeout_s = None if wait_s == float("inf") else max(0.0, wait_s)
            if select.select([calls], [], [], timeout_s)[0]:
                try:
                    answer = self._answer(*pickle.loads(self._calls.recv_bytes()))
                    self._calls.send_bytes(pickle.dumps(answer))
                except (EOFError, OSError):
                    return

    def _answer(self, name: str, arguments: tuple[Any, ...]) -> tuple[str, Any]:
        """Carries a call out, and sends what it has made due before the server hears of it."""
        own = {"attach": self._attach, "routes": self._routes, "changed": self._changed}
        try:
            result = (own.get(name) or getattr(self._rounds, name))(*arguments)
        except Exception as error:
            logging.getLogger(__name__).exception("%s failed", name)
            return type(error).__name__, str(error)
        if name in ("begin", "change_together"):
            self._rounds.step()
        return "", result

    def _changed(
        self, vehicle_id: str, order: Order, snapshot: Snapshot
    ) -> tuple[bool, dict[str, StreamState]]:
        """A changed setpoint, sent, and how all streams stand then."""
        taken = self._rounds.change(vehicle_id, order, snapshot)
        self._rounds.step()
        return taken, self._rounds.states()

    def _attach(self, vehicle_id: str, target: tuple[int, int], number: int) -> None:
        outlet = self._outlets[vehicle_id] = Outlet(vehicle_id, self)
        self._rounds.attach(vehicle_id, outlet, target, number)

    def _routes(self, routes: dict[str, Route | None]) -> None:
        """Ways out of the vehicles that are streamed to; sockets of no other are kept."""
        with contextlib.suppress(BlockingIOError):  # all that were handed over are here
            while True:
                head, descriptors, _, _ = socket.recv_fds(self._way, LONGEST_HANDOVER, 1)
                self.sockets[int(head)] = socket.socket(fileno=descriptors[0])
        for vehicle_id, route in routes.items():
            here = route is not None and route.socket_number in self.sockets
            self._outlets[vehicle_id].route = route if here else None
        used = {route.socket_number for route in routes.values() if route is not None}
        for number in [n for n in self.sockets if n not in used]:
            self.sockets.pop(number).close()


def take_priority() -> bool:
    """Asks for the lowest real-time priority; False where the system does not grant it.

    With it a setpoint leaves on time however busy the machine is; without, it waits for its turn like any
    other process. See docs/performance.md.
    """
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_RTTIME, (LONGEST_RUN_US, LONGEST_RUN_US))
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(os.sched_get_priority_min(os.SCHED_FIFO)))
        return True
    return False


def main(arguments: list[str]) -> None:
    """`worker CALLS_FD WAY_FD SYSTEM_ID COMPONENT_ID SILENT_LIMIT_S`."""
    for number in (signal.SIGINT, signal.SIGTERM):  # the server's: it puts the vehicles into Hold first
        signal.signal(number, signal.SIG_IGN)
    logging.basicConfig(format="%(levelname)s %(name)s: %(message)s")
    calls, way = Connection(int(arguments[0])), socket.socket(fileno=int(arguments[1]))
    way.setblocking(False)
    clock = SystemClock()
    rounds = Rounds(clock, server_silent_limit_s=float(arguments[4]))
    worker = Worker(calls, way, (int(arguments[2]), int(arguments[3])), clock, rounds)
    gc.collect()
    gc.freeze()
    calls.send_bytes(pickle.dumps(take_priority()))
    worker.run()


if __name__ == "__main__":
    main(sys.argv[1:])
