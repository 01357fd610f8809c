"""Runs the stream process (`worker.py`) and calls its methods. `post` returns immediately; `request` returns
a future. The server starts the process when it is needed, and kills and restarts it if it stops reading. No
call waits for the process: a thread starts it, passes on its reports and waits for its end.
"""

from __future__ import annotations

import array
import asyncio
import contextlib
import logging
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Concatenate, ParamSpec, TypeVar

import msgspec

from gcs_server.clock import Clock
from gcs_server.faults import FaultLog
from gcs_server.mavlink.connection import Connection
from gcs_server.mavlink.signing import TICKS_PER_S
from gcs_server.ros2.formats import with_formats_of
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
    WorkerStarted,
)
from gcs_server.streamer.transport.ros2 import TOPIC_TYPES
from gcs_server.streamer.transport.vehicle_transport import PayloadSender

log = logging.getLogger(__name__)

MAX_WAITING_BYTES = 8_000_000
"""Maximum number of unread bytes; above it, the process counts as dead and is killed."""
END_TIMEOUT_S = 1.0
MAX_REPORT_BYTES = 1 << 16
LATE_REPORT_SOCKETS = 20
"""Number of released sockets that are remembered for late reports of sent frames."""

OnRelay = Callable[[Relay], None]
_report_decoder = msgspec.msgpack.Decoder(Relay | SentFrames)
SEND_ERRORS = (EOFError, PipeFull)
"""Errors that `WorkerHandle.send` raises."""


class WorkerHandle:
    """One run of the process; used in one event loop.

    Args:
        own_ids: system and component id of the sent messages.
        server_silent_limit_s: time without a message from the event loop after which sending stops.
        on_value: called in the event loop with each value from the process.
        on_end: called once in the event loop when the process has ended by itself.
        relay: sends setpoints that the process cannot send; called in a thread.
    """

    def __init__(
        self,
        own_ids: tuple[int, int],
        server_silent_limit_s: float,
        on_value: Callable[[object], None],
        on_end: Callable[[], None],
        relay: OnRelay,
    ) -> None:
        self._loop = asyncio.get_running_loop()
        self._on_value, self._on_end, self._relay = on_value, on_end, relay
        pipe_socket, worker_pipe_socket = socket.socketpair()
        self._side_channel, worker_side_channel = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._pipe = MessagePipe(pipe_socket, MAX_WAITING_BYTES)
        self._process: subprocess.Popen[bytes] | None = None
        self._faults = FaultLog("setpoint streams")
        self._closed = False
        self._sent_number = self._handled_number = 0
        """Numbers of the last call, and of the last call that the process has executed."""
        self._writing = False
        self._last_socket_number = 0
        self._socket_numbers: dict[socket.socket, int] = {}
        """Numbers of the sockets that the process has received."""
        self.connections: dict[int, Connection] = {}
        """By socket number."""
        self.attached: set[str] = set()
        """Ids of the vehicles that the process knows."""
        self.started = False
        """Whether the process has reported that it started."""
        self._loop.add_reader(self._pipe.fileno(), self.read)
        self._thread = threading.Thread(
            target=self._watch_process,
            args=(own_ids, server_silent_limit_s, worker_pipe_socket, worker_side_channel),
            name="offboard-reports",
            daemon=True,
        )
        self._thread.start()

    @property
    def pid(self) -> int | None:
        """Process id; None before the process exists."""
        return None if self._process is None else self._process.pid

    @property
    def has_unhandled_calls(self) -> bool:
        """Whether the process has not yet executed all calls."""
        return self._handled_number < self._sent_number

    def record_handled(self, number: int) -> bool:
        """Records that the process has executed all calls up to this number; returns whether the number is
        new."""
        before, self._handled_number = self._handled_number, max(self._handled_number, number)
        return number > before

    def send(
        self,
        method: str,
        arguments: tuple[object, ...],
        named: Mapping[str, object],
        states_of: tuple[str, ...] | None,
    ) -> int:
        """Writes a call; returns its number.

        Raises:
            EOFError: the process has died.
            PipeFull: the process does not read.
        """
        self._pipe.send(Call(self._sent_number + 1, method, arguments, named, states_of))
        self._sent_number += 1
        self._write_rest()
        return self._sent_number

    def read(self) -> None:
        """Reads the values that have arrived."""
        if self._closed:
            return
        try:
            batches = self._pipe.receive()
        except EOFError:
            self._on_process_death()
            return
        for batch in batches:
            assert isinstance(batch, tuple)
            for value in batch:  # pyright: ignore[reportUnknownVariableType]
                try:
                    self._on_value(value)  # pyright: ignore[reportUnknownArgumentType]
                except Exception as error:  # the other values are still read
                    self._faults.add(error, "handling a value from the stream process")

    def routes(self, senders: Mapping[str, PayloadSender]) -> dict[str, AnyRoute | None]:
        """Each vehicle's route for the process; None: the server sends. Passes new sockets to the process;
        the process closes all sockets without a route.
        """
        routes = {vehicle_id: self._route(sender) for vehicle_id, sender in senders.items()}
        used = {route.socket_number for route in routes.values() if isinstance(route, Route)}
        if len(used) < len(self._socket_numbers):
            self._socket_numbers = {s: number for s, number in self._socket_numbers.items() if number in used}
            oldest_remembered = self._last_socket_number - LATE_REPORT_SOCKETS
            self.connections = {
                n: c for n, c in self.connections.items() if n in used or n > oldest_remembered
            }
        return routes

    @property
    def has_sockets(self) -> bool:
        """Whether the process has any socket."""
        return bool(self._socket_numbers)

    @property
    def has_closed_sockets(self) -> bool:
        """Whether the process still has a socket that the server has closed. The port stays in use until the
        process closes the socket.
        """
        return any(link_socket.fileno() < 0 for link_socket in self._socket_numbers)

    def _route(self, sender: PayloadSender) -> AnyRoute | None:
        path = sender.send_path()
        if path is not None and path.peer.dds is not None:
            address = path.connection.link.dds_address(path.peer)
            return None if address is None else with_formats_of(address, TOPIC_TYPES)
        if path is None or path.peer.address is None:
            return None
        link_socket = path.connection.link.datagram_socket()
        if link_socket is None or link_socket.fileno() < 0:
            return None
        if link_socket not in self._socket_numbers:
            number = self._last_socket_number + 1
            ancillary = (socket.SOL_SOCKET, socket.SCM_RIGHTS, array.array("i", [link_socket.fileno()]))
            try:
                self._side_channel.sendmsg([b"%d" % number], [ancillary], socket.MSG_DONTWAIT)
            except OSError:  # the process does not read, or has died; the next message tries again
                return None
            self._last_socket_number = self._socket_numbers[link_socket] = number
            self.connections[number] = path.connection
        return Route(self._socket_numbers[link_socket], path.peer.address, _signing(path.connection))

    # --- end --------------------------------------------------------------------------------------

    def kill(self) -> None:
        """Kills the process immediately; nothing more is read from the process."""
        self._close()
        if self._process is not None:
            self._process.kill()

    def end(self) -> None:
        """Closes the message pipe, so that the process ends by itself, and waits for its end."""
        self._close()
        self._thread.join(2 * END_TIMEOUT_S)

    def _close(self) -> None:
        if self._closed:
            return
        self._closed = True
        self._loop.remove_reader(self._pipe.fileno())
        if self._writing:
            self._loop.remove_writer(self._pipe.fileno())
        self._pipe.close()
        with contextlib.suppress(OSError):
            self._side_channel.shutdown(socket.SHUT_RDWR)  # wakes the report thread

    def _on_process_death(self) -> None:
        if not self._closed:
            self._close()
            self._on_end()

    def _write_rest(self) -> None:
        """Writes unsent data once the process reads."""
        if self._pipe.has_unsent_data and not self._writing:
            self._writing = True
            self._loop.add_writer(self._pipe.fileno(), self._flush)

    def _flush(self) -> None:
        try:
            self._pipe.flush()
        except EOFError:
            self._on_process_death()
            return
        if not self._pipe.has_unsent_data:
            self._writing = False
            self._loop.remove_writer(self._pipe.fileno())

    # --- the thread -------------------------------------------------------------------------------

    def _watch_process(
        self,
        own_ids: tuple[int, int],
        server_silent_limit_s: float,
        worker_pipe_socket: socket.socket,
        worker_side_channel: socket.socket,
    ) -> None:
        descriptors = [worker_pipe_socket.fileno(), worker_side_channel.fileno()]
        arguments = [*descriptors, *own_ids, server_silent_limit_s]
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "gcs_server.streamer.process.worker", *map(str, arguments)],
                stdin=subprocess.DEVNULL,
                pass_fds=descriptors,
                # Ctrl-C is handled by the server, which first puts the vehicles into Hold
                start_new_session=True,
            )
        except OSError:
            log.exception("the process that flies setpoint streams could not be started")
        finally:
            worker_pipe_socket.close()  # so that the event loop notices the end of the process
            worker_side_channel.close()
        while data := self._next_report():
            try:
                self._handle_report(_report_decoder.decode(data))
            # the thread continues, because it also sends the setpoints of other vehicles
            except Exception as error:
                self._faults.add(error, "passing on a report of the stream process")
        self._wait_for_exit()
        self._side_channel.close()

    def _next_report(self) -> bytes:
        """Waits for the next report; empty when the process has ended."""
        try:
            return self._side_channel.recv(MAX_REPORT_BYTES)
        except OSError:
            return b""

    def _handle_report(self, report: Relay | SentFrames) -> None:
        if isinstance(report, Relay):
            self._relay(report)
            return
        for number, time_us, raw in report.frames:
            connection = self.connections.get(number)
            if connection is not None:
                connection.count_sent_elsewhere(time_us, raw)

    def _wait_for_exit(self) -> None:
        if self._process is None:
            return
        try:
            self._process.wait(END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def _signing(connection: Connection) -> RouteSigning | None:
    signing = connection.signing
    if signing is None:
        return None
    # whole seconds, so that the route rarely changes
    ahead_s = signing.signer.clock.ahead_ticks // TICKS_PER_S
    return RouteSigning(signing.signer.key.reveal(), signing.signer.link_id, ahead_s * TICKS_PER_S)


T = TypeVar("T")
P = ParamSpec("P")

ANSWER_TIMEOUT_S = 2.0
"""Time after which a process that does not read is killed [s]; the vehicles' failsafes then take over."""
LOOP_STALLED_S = 0.5
"""If the event loop itself stalled for this long, the process is not checked [s]."""
RESTART_PERIOD_S = 1.0
"""Minimum time between two starts of the process [s]."""


class WorkerDied(Exception):
    """The process has died, or does not answer."""


@dataclass(frozen=True, slots=True)
class _PendingRequest:
    """A call that has no answer yet."""

    future: asyncio.Future[Any]
    on_answer: Callable[[Any], None] | None
    """Called with the answer, even if the future was cancelled."""


class WorkerCalls:
    """Starts the process, restarts it, and calls its methods.

    Args:
        clock: the system's monotonic clock.
        own_ids: system and component id of the sent messages.
        server_silent_limit_s: time without a message from the event loop after which sending stops.
        on_update: called with each update from the process.
        on_end: called when the process has ended or does not answer; pending requests fail afterwards.
        relay: sends setpoints that the process cannot send; called in a thread.
    """

    def __init__(
        self,
        clock: Clock,
        own_ids: tuple[int, int],
        server_silent_limit_s: float,
        on_update: Callable[[Update], None],
        on_end: Callable[[], None],
        relay: OnRelay,
    ) -> None:
        self._clock = clock
        self._own_ids = own_ids
        self._server_silent_limit_s = server_silent_limit_s
        self._on_update, self._on_end, self._relay = on_update, on_end, relay
        self._pending: dict[int, _PendingRequest] = {}
        self._started_s = self._checked_s = self._last_progress_s = float("-inf")
        """Times of the last start, of the last check, and of the last sign that the process executes calls
        [s, monotonic]."""
        self.worker: WorkerHandle | None = None
        """The running process; None if there is no process."""

    def spawn(self) -> None:
        """Starts the process if there is none, at most once per `RESTART_PERIOD_S`."""
        now_s = self._clock.monotonic_s()
        if self.worker is not None or now_s - self._started_s < RESTART_PERIOD_S:
            return
        self._started_s = now_s
        try:
            self.worker = WorkerHandle(
                self._own_ids, self._server_silent_limit_s, self._handle_value, self._drop_worker, self._relay
            )
        except OSError:  # no free file descriptor; the next update tries again
            log.exception("the setpoint streams' process could not be started")

    def close(self) -> None:
        """Ends the process; pending requests fail."""
        worker, self.worker = self.worker, None
        if worker is not None:
            worker.end()
        self._fail_all()

    def check_alive(self) -> None:
        """Kills a process that has stopped reading, unless the event loop itself stalled; called
        periodically."""
        now_s = self._clock.monotonic_s()
        loop_stalled, self._checked_s = now_s - self._checked_s > LOOP_STALLED_S, now_s
        worker = self.worker
        if worker is None or not worker.started or not worker.has_unhandled_calls:
            return
        if loop_stalled:
            self._last_progress_s = now_s
        worker.read()
        if (
            self.worker is worker
            and worker.has_unhandled_calls
            and now_s - self._last_progress_s >= ANSWER_TIMEOUT_S
        ):
            self._drop_worker()

    def post(
        self, method: Callable[Concatenate[Any, P], object], *arguments: P.args, **named: P.kwargs
    ) -> int:
        """Calls a method without waiting; returns the call's number; 0: there is no process."""
        return self._send(method, None, arguments, named)

    def request(
        self,
        method: Callable[Concatenate[Any, P], T],
        states_of: tuple[str, ...],
        on_answer: Callable[[T], None] | None,
        *arguments: P.args,
        **named: P.kwargs,
    ) -> asyncio.Future[T]:
        """Calls a method immediately; the future receives its result, or WorkerDied.

        Args:
            method: the method, of its class.
            states_of: vehicles whose state is updated before the answer.
            on_answer: called with the result when it arrives, even if the future was cancelled.
            arguments: the method's arguments.
            named: the method's named arguments.
        """
        future: asyncio.Future[T] = asyncio.get_running_loop().create_future()
        number = self._send(method, states_of, arguments, named)
        if number:
            self._pending[number] = _PendingRequest(future, on_answer)
        else:
            future.set_exception(WorkerDied())
        return future

    def _send(
        self,
        method: Callable[..., object],
        states_of: tuple[str, ...] | None,
        arguments: tuple[object, ...],
        named: dict[str, object],
    ) -> int:
        worker = self.worker
        if worker is None:
            return 0
        if not worker.has_unhandled_calls:
            self._last_progress_s = self._clock.monotonic_s()
        try:
            return worker.send(method.__qualname__, arguments, named, states_of)
        except SEND_ERRORS:
            self._drop_worker()
            return 0

    async def wait_for_answer(self, future: asyncio.Future[T]) -> T:
        """Waits for the answer to a request; a process that does not answer in time is killed.

        Raises:
            WorkerDied: there is no process.
            ValueError: the process cannot execute the request.
            RuntimeError: another failure, which the process has logged.
        """
        try:
            await asyncio.wait({future}, timeout=ANSWER_TIMEOUT_S)
        except asyncio.CancelledError:
            future.cancel()
            raise
        if not future.done():
            self._drop_worker()
        return await future

    async def result_or_false(self, future: asyncio.Future[bool]) -> bool:
        """Like `wait_for_answer`; False if there is no process."""
        try:
            return await self.wait_for_answer(future)
        except WorkerDied:
            return False

    def _handle_value(self, value: object) -> None:
        if isinstance(value, Update):
            if self.worker is not None and self.worker.record_handled(value.last_handled):
                self._last_progress_s = self._clock.monotonic_s()
            self._on_update(value)
        elif isinstance(value, Answer):
            self._handle_answer(value)
        elif isinstance(value, WorkerStarted) and self.worker is not None:
            self.worker.started = True
            if not value.real_time:
                log.info("setpoint streams run without real-time priority: see docs/performance.md")

    def _handle_answer(self, answer: Answer) -> None:
        pending = self._pending.pop(answer.number, None)
        if pending is None:
            return
        if answer.error is None and pending.on_answer is not None:
            pending.on_answer(answer.result)
        if pending.future.done():
            return
        if answer.error is None:
            pending.future.set_result(answer.result)
        else:
            name, text = answer.error
            pending.future.set_exception(ValueError(text) if name == "ValueError" else RuntimeError(text))

    def _drop_worker(self) -> None:
        worker, self.worker = self.worker, None
        if worker is None:
            return
        log.error("the setpoint streams' process (%s) ended", worker.pid)
        worker.kill()
        self._on_end()
        self._fail_all()

    def _fail_all(self) -> None:
        pending, self._pending = self._pending, {}
        for each in pending.values():
            if not each.future.done():
                each.future.set_exception(WorkerDied())
