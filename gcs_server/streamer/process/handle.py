"""One run of the stream process (`worker.py`): starts it, writes to it, reads from it, and ends it. No call
waits for the process. A thread starts the process, passes on its reports and waits for its end.
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

import msgspec

from gcs_server.faults import FaultLog
from gcs_server.mavlink.connection import Connection
from gcs_server.mavlink.signing import TICKS_PER_S
from gcs_server.streamer.process.message_pipe import MessagePipe, PipeFull
from gcs_server.streamer.process.messages import (
    AnyRoute,
    Call,
    Relay,
    Route,
    RouteSigning,
    SentFrames,
)
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
            return path.peer.dds
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
