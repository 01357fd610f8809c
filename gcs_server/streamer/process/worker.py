"""The process that runs all setpoint streams, so that nothing the server does can delay one.

`handle.py` starts it with two sockets. The first carries the server's messages (`messages.py`), and the
answers and updates back. The second carries the sockets of the server's links to the process, and reports
of what was sent by them back (for the recordings). What a link without datagrams is to carry goes back to
the server, where a thread passes it on. Neither side ever waits for the other to read.

The process ends with the server: when the first socket closes, it sends nothing more.
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
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import replace

from gcs_server.clock import Clock, SystemClock
from gcs_server.mavlink.codec import encode_frame
from gcs_server.mavlink.signing import FrameSigner, SecretKey, SigningClock
from gcs_server.streamer.process.message_pipe import MessagePipe, PipeFull
from gcs_server.streamer.process.messages import Answer, Hello, Numbered, Request, Route, RouteSigning, Update
from gcs_server.streamer.schedule.scheduler import StreamScheduler
from gcs_server.streamer.schedule.streams import StreamState
from gcs_server.streamer.values.order import Order

log = logging.getLogger(__name__)

SENT_EVERY_S = 0.01
"""What went out is told no more often than this."""
SENT_AT_ONCE = 100
SENT_WAITING = 20_000
"""So many frames wait for a server that stands still; more are missing from its recording."""
UPDATE_EVERY_S = 0.05
"""How the streams stand is told so often while there are any, and at once when a phase changes."""
AWAKE_ANYWAY_S = 0.01
"""So much earlier where the process is awake for a setpoint: what wakes for an update delays the next one."""
MOST_WAITING_BYTES = 8_000_000
"""For a server that stands still; answers alone wait, so that this is never reached by one that lives."""
LONGEST_RUN_US = 1_000_000
"""With real-time priority: of processor time without a pause, after which the system ends the process."""
LONGEST_SPELL_S, REST_S = 0.05, 0.005
"""Streams that want more than a processor are late rather than leave nothing to the server."""
LONGEST_HANDOVER = 64

Sent = tuple[int, int, bytes]
"""Number of the link's socket, time since 1970 [us], frame."""


class WorkerReports:
    """What the server is told without being waited for."""

    def __init__(self, way: socket.socket) -> None:
        self._way = way
        self._sent: deque[Sent] = deque(maxlen=SENT_WAITING)
        self._told_s = 0.0

    @property
    def due_s(self) -> float:
        """When what waits is to be told; infinity where nothing does."""
        return self._told_s + SENT_EVERY_S if self._sent else float("inf")

    def sent(self, what: Sent) -> None:
        """A frame went out."""
        self._sent.append(what)

    def relay(self, vehicle_id: str, msg_id: int, payload: bytes) -> bool:
        """The server shall send it, unless it comes to it too late. False where it takes nothing more."""
        try:
            self._way.send(pickle.dumps(("relay", vehicle_id, msg_id, payload, time.monotonic())))
        except OSError:  # it does not read, or is gone
            return False
        return True

    def tell(self, now_s: float) -> None:
        """Tells what went out, unless it did so just now."""
        if now_s < self.due_s:
            return
        self._told_s = now_s
        while self._sent:
            some = [self._sent.popleft() for _ in range(min(SENT_AT_ONCE, len(self._sent)))]
            try:
                self._way.send(pickle.dumps(("sent", some)))
            except OSError:
                self._sent.extendleft(reversed(some))
                return


class WorkerSender:
    """One vehicle's way out of this process."""

    def __init__(self, vehicle_id: str, worker: Worker) -> None:
        self._vehicle_id = vehicle_id
        self._worker = worker
        self._seq = 0
        self.route: Route | None = None

    def send_payload(self, msg_id: int, payload: bytes, *, made_s: float | None = None) -> bool:
        """Sends a datagram, or has the server send it by another way."""
        worker, route = self._worker, self.route
        if route is None:
            return worker.reports.relay(self._vehicle_id, msg_id, payload)
        signer = None if route.signing is None else worker.signer(route.signing)
        raw = encode_frame(msg_id, payload, self._seq, *worker.own_ids, signer)
        try:
            worker.sockets[route.socket_number].sendto(raw, route.address)
        except OSError:
            return worker.reports.relay(self._vehicle_id, msg_id, payload)
        self._seq = (self._seq + 1) & 0xFF
        worker.reports.sent((route.socket_number, int(worker.clock.unix_s() * 1e6), raw))
        return True

    def way_out(self) -> None:
        """The server's side knows."""
        return None


class Worker:
    """The loop: runs the scheduler when a step is due, takes the server's messages, sends updates.

    Args:
        messages: from and to the server.
        way: for sockets in, and for what went out by them.
        own_ids: system and component id of the frames.
        scheduler: what is run.
    """

    def __init__(
        self,
        messages: MessagePipe,
        way: socket.socket,
        own_ids: tuple[int, int],
        clock: Clock,
        scheduler: StreamScheduler,
    ) -> None:
        self._messages = messages
        self._way = way
        self._senders: dict[str, WorkerSender] = {}
        self._updates = StreamUpdates(scheduler)
        self.scheduler = scheduler
        self.clock = clock
        self.own_ids = own_ids
        self.reports = WorkerReports(way)
        self.sockets: dict[int, socket.socket] = {}
        self._signing_clock = SigningClock(lambda: clock.unix_s())
        """One for all vehicles: a link's setpoints are one stream of signatures."""
        self._signers: dict[RouteSigning, FrameSigner] = {}

    def signer(self, signing: RouteSigning) -> FrameSigner:
        """Of a route."""
        signer = self._signers.get(signing)
        if signer is None:
            self._signing_clock.run_ahead(signing.ahead_ticks)
            key = SecretKey(signing.key)
            self._signers = {k: s for k, s in self._signers.items() if k.link_id != signing.link_id}
            signer = self._signers[signing] = FrameSigner(key, signing.link_id, self._signing_clock)
        return signer

    def run(self) -> None:
        """Returns when the server has gone."""
        rested_s = self.clock.monotonic_s()
        try:
            while True:
                due_s = self.scheduler.step()
                now_s = self.clock.monotonic_s()
                self.reports.tell(now_s)
                if self._updates.is_due(now_s) and not self._messages.waits:
                    self._messages.send((self._updates.update(now_s),))
                news_due_s = float("inf") if self._messages.waits else self._updates.due_s
                wake_s = min(due_s, news_due_s, self.reports.due_s)
                now_s = self.clock.monotonic_s()  # what was told took time, by which the wait is shorter
                if now_s - rested_s > LONGEST_SPELL_S:
                    wake_s = max(wake_s, now_s + REST_S)
                wait_s = wake_s - now_s
                if wait_s > 0:
                    rested_s = wake_s
                self._wait(None if wait_s == float("inf") else max(0.0, wait_s))
        except (EOFError, PipeFull):
            return

    def _wait(self, timeout_s: float | None) -> None:
        pipe = [self._messages.fileno()]
        readable, writable, _ = select.select(pipe, pipe if self._messages.waits else [], [], timeout_s)
        if writable:
            self._messages.flush()
        if readable:
            for numbered in self._messages.receive():
                assert isinstance(numbered, Numbered)
                self._take(numbered)

    def _take(self, numbered: Numbered) -> None:
        """Carries a message out, and sends what it has made due before the server hears of it."""
        message, error, result = numbered.message, None, None
        try:
            result = message.apply(self)
        except Exception as problem:
            log.exception("%s failed", type(message).__name__)
            error = (type(problem).__name__, str(problem))
        self._updates.handled(numbered.number)
        if isinstance(message, Request):
            self.scheduler.step()
            update = self._updates.update(self.clock.monotonic_s(), message.vehicles())
            self._messages.send((update, Answer(numbered.number, result, error)))

    def attach(self, vehicle_id: str, target: tuple[int, int], number: int) -> None:
        """A vehicle becomes known."""
        sender = self._senders[vehicle_id] = WorkerSender(vehicle_id, self)
        self.scheduler.attach(vehicle_id, sender, target, number)

    def set_routes(self, routes: Mapping[str, Route | None]) -> None:
        """Ways out of the vehicles that are streamed to; sockets of no other are kept."""
        with contextlib.suppress(BlockingIOError):  # all that were handed over are here
            while True:
                head, descriptors, _, _ = socket.recv_fds(self._way, LONGEST_HANDOVER, 1)
                if not descriptors:
                    break
                self.sockets[int(head)] = socket.socket(fileno=descriptors[0])
        for vehicle_id, sender in self._senders.items():
            route = routes.get(vehicle_id)
            sender.route = route if route is not None and route.socket_number in self.sockets else None
        used = {route.socket_number for route in routes.values() if route is not None}
        for number in [n for n in self.sockets if n not in used]:
            self.sockets.pop(number).close()


class StreamUpdates:
    """What the server is yet to be told of the streams, and when.

    Args:
        scheduler: whose.
    """

    def __init__(self, scheduler: StreamScheduler) -> None:
        self._scheduler = scheduler
        self._handled = self._told_handled = 0
        self._told_s = 0.0
        self._phases: dict[str, tuple[str, int]] = {}
        self._guards: list[tuple[str, str, int]] = []
        self._orders: dict[str, Order | None] = {}
        self.due_s = float("inf")
        """When the next update is due if nothing happens until then."""

    def handled(self, number: int) -> None:
        """A message of the server's was taken."""
        self._handled = number

    def is_due(self, now_s: float) -> bool:
        """Whether something has happened, or it is time."""
        scheduler = self._scheduler
        phases = scheduler.phases()
        going = any(phase != "idle" for phase, _ in phases.values())
        self.due_s = self._told_s + UPDATE_EVERY_S if going else float("inf")
        changed = (
            phases != self._phases
            or scheduler.guard_phases() != self._guards
            or scheduler.has_news
            or (self._handled != self._told_handled and not going)  # else the next one says so
        )
        return changed or now_s >= self.due_s - AWAKE_ANYWAY_S

    def update(self, now_s: float, only: tuple[str, ...] | None = None) -> Update:
        """Of these vehicles, or of all that are streamed to or have just ended."""
        scheduler = self._scheduler
        phases = scheduler.phases()
        if only is None:
            told = [v for v, at in phases.items() if at[0] != "idle" or at != self._phases.get(v)]
            self._phases, self._guards = phases, scheduler.guard_phases()
            self._told_handled, self._told_s = self._handled, now_s
            self.due_s = max(self.due_s, now_s + UPDATE_EVERY_S)
        else:
            told = [v for v in only if v in phases]
        states: dict[str, StreamState] = {}
        same: set[str] = set()
        for vehicle_id in told:
            try:
                state = scheduler.state(vehicle_id)
            except Exception:  # of one; the others are to be told
                log.exception("how the stream to vehicle %s stands cannot be told", vehicle_id)
                continue
            if state.order is not None and state.order is self._orders.get(vehicle_id):
                same.add(vehicle_id)
                states[vehicle_id] = replace(state, order=None)
            else:
                self._orders[vehicle_id] = state.order
                states[vehicle_id] = state
        return Update(
            self._handled,
            now_s,
            states,
            frozenset(same),
            scheduler.guard_states(),
            tuple(scheduler.take_reports()),
            tuple(scheduler.take_findings()),
        )


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
    """`worker MESSAGES_FD WAY_FD SYSTEM_ID COMPONENT_ID SILENT_LIMIT_S`."""
    for number in (signal.SIGINT, signal.SIGTERM):  # the server's: it puts the vehicles into Hold first
        signal.signal(number, signal.SIG_IGN)
    logging.basicConfig(format="%(levelname)s %(name)s: %(message)s")
    messages = MessagePipe(socket.socket(fileno=int(arguments[0])), MOST_WAITING_BYTES)
    way = socket.socket(fileno=int(arguments[1]))
    way.setblocking(False)
    clock = SystemClock()
    scheduler = StreamScheduler(clock, server_silent_limit_s=float(arguments[4]))
    worker = Worker(messages, way, (int(arguments[2]), int(arguments[3])), clock, scheduler)
    gc.collect()
    gc.freeze()
    messages.send((Hello(take_priority()),))
    worker.run()


if __name__ == "__main__":
    main(sys.argv[1:])
