"""The process that runs all setpoint streams, so that no work of the server can delay them.

`calls.py` starts it with two sockets. The first carries the server's calls (`messages.py`), and the
answers and updates back. The second carries the sockets of the server's links to the process, and reports of
sent frames back (for the recordings). Setpoints for a link without datagrams go back to the server, where a
thread sends them. Neither side ever waits until the other side reads.

The process ends with the server: when the first socket closes, the process removes its flight modes from PX4
and sends nothing more.
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

import msgspec

from gcs_server.clock import Clock, SystemClock
from gcs_server.links.base import DdsAddress
from gcs_server.mavlink.codec import encode_frame
from gcs_server.mavlink.signing import FrameSigner, SecretKey, SigningClock
from gcs_server.ros2.external_mode import Registration
from gcs_server.streamer.process.message_pipe import MessagePipe, PipeFull
from gcs_server.streamer.process.messages import (
    Answer,
    AnyRoute,
    Call,
    Relay,
    Route,
    RouteSigning,
    SentFrames,
    Update,
    WorkerMethods,
    WorkerStarted,
)
from gcs_server.streamer.process.ros2_senders import ModeTopics, Ros2Senders
from gcs_server.streamer.schedule.external_modes import ExternalModes
from gcs_server.streamer.schedule.scheduler import StreamScheduler, StreamState
from gcs_server.streamer.transport.ros2 import TopicSender
from gcs_server.streamer.values.snapshot import Snapshot
from gcs_server.streamer.values.stream_request import StreamRequest

log = logging.getLogger(__name__)

SENT_REPORT_PERIOD_S = 0.01
"""Minimum time between two reports of sent frames [s]."""
SENT_BATCH = 100
"""Maximum number of frames in one report."""
MAX_SENT_WAITING = 20_000
"""Maximum number of frames that wait for a stalled server; further frames are missing in the recording."""
UPDATE_PERIOD_S = 0.05
"""Period of updates while there are streams [s]; a changed phase is reported immediately."""
EARLY_UPDATE_S = 0.01
"""An update is sent up to this time earlier if the process is already awake for a setpoint, because another
wake-up would delay the next setpoint [s].
"""
MAX_WAITING_BYTES = 8_000_000
"""Size of the buffer for a stalled server; only answers wait in it, so it never fills up while the server
runs."""
MAX_RUN_US = 1_000_000
"""Uninterrupted processor time after which the system kills a process with real-time priority [µs]."""
MAX_BUSY_S, PAUSE_S = 0.05, 0.005
"""After MAX_BUSY_S without a wait, the worker pauses for PAUSE_S [s]: overloaded streams become late, but the
server still gets processor time."""
MAX_SOCKET_NUMBER_BYTES = 64
"""Maximum size of the text that accompanies a passed socket: its number."""

_report_encoder = msgspec.msgpack.Encoder()


class WorkerReports:
    """Sends reports to the server, and never waits for the server."""

    def __init__(self, side_channel: socket.socket) -> None:
        self._side_channel = side_channel
        self._sent: deque[tuple[int, int, bytes]] = deque(maxlen=MAX_SENT_WAITING)
        self._reported_s = 0.0

    @property
    def due_s(self) -> float:
        """Time at which waiting reports are due; infinity if no report waits."""
        return self._reported_s + SENT_REPORT_PERIOD_S if self._sent else float("inf")

    def add_sent(self, socket_number: int, unix_us: int, raw: bytes) -> None:
        """Records a sent frame."""
        self._sent.append((socket_number, unix_us, raw))

    def relay(self, vehicle_id: str, msg_id: int, payload: bytes) -> bool:
        """Passes a payload with its creation time to the server, which sends it. Returns False if the
        server's buffer is full."""
        try:
            relay = Relay(vehicle_id, msg_id, payload, time.monotonic())
            self._side_channel.send(_report_encoder.encode(relay))
        except OSError:  # the server does not read, or has died
            return False
        return True

    def report_sent(self, now_s: float) -> None:
        """Reports sent frames, at most once per `SENT_REPORT_PERIOD_S`."""
        if now_s < self.due_s:
            return
        self._reported_s = now_s
        while self._sent:
            batch = [self._sent.popleft() for _ in range(min(SENT_BATCH, len(self._sent)))]
            try:
                self._side_channel.send(_report_encoder.encode(SentFrames(batch)))
            except OSError:
                self._sent.extendleft(reversed(batch))
                return


class WorkerSender:
    """Sends to one vehicle from this process."""

    def __init__(self, vehicle_id: str, worker: Worker) -> None:
        self._vehicle_id = vehicle_id
        self._worker = worker
        self._seq = 0
        self.route: Route | None = None
        self.dds: DdsAddress | None = None
        """Set while the vehicle is reached over ROS 2."""

    def topics(self) -> TopicSender | None:
        """The vehicle's ROS 2 topics; None while the vehicle is reached over MAVLink."""
        return None if self.dds is None else self._worker.ros2.sender_for(self.dds)

    def send_payload(self, msg_id: int, payload: bytes, *, created_s: float | None = None) -> bool:
        """Sends a datagram, or passes the payload to the server, which sends it."""
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
        worker.reports.add_sent(route.socket_number, int(worker.clock.unix_s() * 1e6), raw)
        return True

    def send_path(self) -> None:
        """None, because only the server knows the link and the peer."""
        return None


class Worker(WorkerMethods):
    """The loop of the process: runs the scheduler when a step is due, executes the server's calls, and sends
    updates.

    Args:
        messages: the pipe to and from the server.
        side_channel: receives sockets, and sends reports of sent frames.
        own_ids: system and component id of the frames.
        scheduler: the streams.
    """

    def __init__(
        self,
        messages: MessagePipe,
        side_channel: socket.socket,
        own_ids: tuple[int, int],
        clock: Clock,
        scheduler: StreamScheduler,
    ) -> None:
        self._messages = messages
        self._side_channel = side_channel
        self._senders: dict[str, WorkerSender] = {}
        self._updates = StreamUpdates(scheduler)
        self.scheduler = scheduler
        self.clock = clock
        self.own_ids = own_ids
        self.reports = WorkerReports(side_channel)
        self.sockets: dict[int, socket.socket] = {}
        self.ros2 = Ros2Senders()
        self._signing_clock = SigningClock(lambda: clock.unix_s())
        self._signers: dict[RouteSigning, FrameSigner] = {}
        """One signer per key and link for all vehicles, because all setpoints of a link belong to one signing
        stream."""

    def signer(self, signing: RouteSigning) -> FrameSigner:
        """The signer of a route."""
        signer = self._signers.get(signing)
        if signer is None:
            self._signing_clock.run_ahead(signing.ahead_ticks)
            key = SecretKey(signing.key)
            self._signers = {k: s for k, s in self._signers.items() if k.link_id != signing.link_id}
            signer = self._signers[signing] = FrameSigner(key, signing.link_id, self._signing_clock)
        return signer

    def run(self) -> None:
        """Runs until the server closes the pipe."""
        last_wait_s = self.clock.monotonic_s()
        try:
            while True:
                due_s = self.scheduler.step()
                now_s = self.clock.monotonic_s()
                self.reports.report_sent(now_s)
                if self._updates.is_due(now_s) and not self._messages.has_unsent_data:
                    self._messages.send((self._updates.update(now_s),))
                update_due_s = float("inf") if self._messages.has_unsent_data else self._updates.due_s
                wake_s = min(due_s, update_due_s, self.reports.due_s)
                now_s = self.clock.monotonic_s()  # read again, because sending took time
                if now_s - last_wait_s > MAX_BUSY_S:
                    wake_s = max(wake_s, now_s + PAUSE_S)
                wait_s = wake_s - now_s
                if wait_s > 0:
                    last_wait_s = wake_s
                self._wait(None if wait_s == float("inf") else max(0.0, wait_s))
        except (EOFError, PipeFull):
            self.scheduler.close()  # also unregisters the modes, so that PX4 does not wait for their answers

    def _wait(self, timeout_s: float | None) -> None:
        pipe = [self._messages.fileno()]
        readable, writable, _ = select.select(
            pipe, pipe if self._messages.has_unsent_data else [], [], timeout_s
        )
        if writable:
            self._messages.flush()
        if readable:
            for call in self._messages.receive():
                assert isinstance(call, Call)
                self._execute(call)

    def _execute(self, call: Call) -> None:
        """Executes a call. If the server awaits the result, sends due setpoints, then an update and the
        answer."""
        error, result = None, None
        owner, _, name = call.method.partition(".")
        try:
            result = getattr(self._target(owner), name)(*call.arguments, **call.named)
        except Exception as problem:
            log.exception("%s failed", call.method)
            error = (type(problem).__name__, str(problem))
        self._updates.handled(call.number)
        if call.states_of is not None:
            self.scheduler.step()
            update = self._updates.update(self.clock.monotonic_s(), call.states_of)
            self._messages.send((update, Answer(call.number, result, error)))

    def _target(self, owner: str) -> object:
        """The object of this class."""
        if owner == WorkerMethods.__name__:
            return self
        return self.scheduler.external_modes if owner == ExternalModes.__name__ else self.scheduler

    def attach(self, vehicle_id: str, target: tuple[int, int], number: int) -> None:
        sender = self._senders[vehicle_id] = WorkerSender(vehicle_id, self)
        self.scheduler.attach(vehicle_id, sender, target, number, sender.topics)

    def set_routes(self, routes: Mapping[str, AnyRoute | None]) -> None:
        with contextlib.suppress(BlockingIOError):  # until no passed socket is left
            while True:
                head, descriptors, _, _ = socket.recv_fds(self._side_channel, MAX_SOCKET_NUMBER_BYTES, 1)
                if not descriptors:
                    break
                self.sockets[int(head)] = socket.socket(fileno=descriptors[0])
        for vehicle_id, sender in self._senders.items():
            route = routes.get(vehicle_id)
            by_datagram = route if isinstance(route, Route) else None
            sender.route = by_datagram if by_datagram and by_datagram.socket_number in self.sockets else None
            sender.dds = route if isinstance(route, DdsAddress) else None
            if sender.dds is not None:
                self.ros2.sender_for(sender.dds)  # opened before the first setpoint
        self.ros2.close_unused({route for route in routes.values() if isinstance(route, DdsAddress)})
        used = {route.socket_number for route in routes.values() if isinstance(route, Route)}
        for number in [n for n in self.sockets if n not in used]:
            self.sockets.pop(number).close()

    def update_snapshots(self, pickled_snapshots: Mapping[str, bytes]) -> None:
        snapshots: dict[str, Snapshot] = {}
        for vehicle_id, data in pickled_snapshots.items():
            try:
                snapshots[vehicle_id] = pickle.loads(data)
            except Exception:
                log.exception("the snapshot of vehicle %s cannot be read", vehicle_id)
        self.scheduler.update_snapshots(snapshots)


class StreamUpdates:
    """Decides which updates are sent to the server, and when.

    Args:
        scheduler: the streams.
    """

    def __init__(self, scheduler: StreamScheduler) -> None:
        self._scheduler = scheduler
        self._handled = self._reported_handled = 0
        self._reported_s = 0.0
        self._phases: dict[str, tuple[str, int]] = {}
        self._guards: list[tuple[str, str, int]] = []
        self._requests: dict[str, StreamRequest | None] = {}
        self._modes: dict[str, tuple[Registration, ...]] = {}
        self.due_s = float("inf")
        """Time of the next update if nothing changes [s, monotonic]."""

    def handled(self, number: int) -> None:
        """Records that the server's call with this number was executed."""
        self._handled = number

    def is_due(self, now_s: float) -> bool:
        """Whether something has changed, or an update is due."""
        scheduler = self._scheduler
        phases = scheduler.phases()
        streaming = any(phase != "idle" for phase, _ in phases.values())
        self.due_s = self._reported_s + UPDATE_PERIOD_S if streaming else float("inf")
        changed = (
            phases != self._phases
            or scheduler.guard_phases() != self._guards
            or scheduler.modes() != self._modes
            or scheduler.has_pending_reports
            # while a stream runs, the next periodic update contains the number
            or (self._handled != self._reported_handled and not streaming)
        )
        return changed or now_s >= self.due_s - EARLY_UPDATE_S

    def update(self, now_s: float, only: tuple[str, ...] | None = None) -> Update:
        """An update with the vehicles `only`; None: all vehicles whose stream runs or has just ended."""
        scheduler = self._scheduler
        phases = scheduler.phases()
        if only is None:
            vehicle_ids = [
                v for v, entry in phases.items() if entry[0] != "idle" or entry != self._phases.get(v)
            ]
            self._phases, self._guards = phases, scheduler.guard_phases()
            self._modes = scheduler.modes()
            self._reported_handled, self._reported_s = self._handled, now_s
            self.due_s = max(self.due_s, now_s + UPDATE_PERIOD_S)
        else:
            vehicle_ids = [v for v in only if v in phases]
        states: dict[str, StreamState] = {}
        unchanged: set[str] = set()
        for vehicle_id in vehicle_ids:
            try:
                state = scheduler.state(vehicle_id)
            except Exception:  # the other states are still reported
                log.exception("the state of the stream to vehicle %s cannot be reported", vehicle_id)
                continue
            if state.request is not None and state.request is self._requests.get(vehicle_id):
                unchanged.add(vehicle_id)
                states[vehicle_id] = replace(state, request=None)
            else:
                self._requests[vehicle_id] = state.request
                states[vehicle_id] = state
        return Update(
            self._handled,
            now_s,
            states,
            frozenset(unchanged),
            scheduler.guard_states(),
            tuple(scheduler.take_reports()),
            tuple(scheduler.take_findings()),
            scheduler.modes(),
        )


def request_priority() -> bool:
    """Requests the lowest real-time priority; False if the system does not grant it.

    With this priority, setpoints are sent on time even on a busy computer. Without it, the process waits for
    a processor like every other process. See docs/performance.md.
    """
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_RTTIME, (MAX_RUN_US, MAX_RUN_US))
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(os.sched_get_priority_min(os.SCHED_FIFO)))
        return True
    return False


def main(arguments: list[str]) -> None:
    """`worker MESSAGES_FD SIDE_CHANNEL_FD SYSTEM_ID COMPONENT_ID SILENT_LIMIT_S`."""
    # the server handles Ctrl-C, and first puts the vehicles into Hold
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    logging.basicConfig(format="%(levelname)s %(name)s: %(message)s")
    messages = MessagePipe(socket.socket(fileno=int(arguments[0])), MAX_WAITING_BYTES)
    side_channel = socket.socket(fileno=int(arguments[1]))
    side_channel.setblocking(False)
    clock = SystemClock()
    own_ids = (int(arguments[2]), int(arguments[3]))
    scheduler = StreamScheduler(
        clock, server_silent_limit_s=float(arguments[4]), own_ids=own_ids, open_mode_port=ModeTopics
    )
    worker = Worker(messages, side_channel, own_ids, clock, scheduler)
    gc.collect()
    gc.freeze()
    messages.send((WorkerStarted(request_priority()),))
    worker.run()


if __name__ == "__main__":
    main(sys.argv[1:])
