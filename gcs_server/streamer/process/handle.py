"""One run of the process of the streams (`worker.py`): starts it, writes to it, reads from it, ends it.

Nothing here waits for that process. A thread starts it, passes on what it reports and waits for its end.
"""

from __future__ import annotations

import array
import asyncio
import contextlib
import logging
import pickle
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from typing import Any

from gcs_server.faults import FaultLog
from gcs_server.mavlink.connection import Connection
from gcs_server.mavlink.signing import TICKS_PER_S
from gcs_server.streamer.process.message_pipe import MessagePipe, PipeFull
from gcs_server.streamer.process.messages import Numbered, Post, Request, Route, RouteSigning
from gcs_server.streamer.transport.sender import PayloadSender

log = logging.getLogger(__name__)

MOST_WAITING_BYTES = 8_000_000
"""A process that leaves so much unread counts as gone."""
ENDS_WITHIN_S = 1.0
LONGEST_MAIL = 1 << 20
LATE_MAIL_SOCKETS = 20
"""Of so many sockets given up last it may still be told what went out by them."""


Relay = Callable[[str, int, bytes, float], None]
"""Vehicle, message id, payload, when it was made (monotonic)."""
WORKER_GONE = (EOFError, PipeFull)
"""What `WorkerHandle.send` raises."""


class WorkerHandle:
    """One run of the process. Belongs to the running event loop.

    Args:
        own_ids: system and component id of what is sent.
        silent_limit_s: the loop's silence after which sending stops.
        on_value: gets each thing that the process says, in the loop.
        on_end: called in the loop, once, when the process has ended by itself.
        relay: sends what the process cannot, in a thread.
    """

    def __init__(
        self,
        own_ids: tuple[int, int],
        silent_limit_s: float,
        on_value: Callable[[object], None],
        on_end: Callable[[], None],
        relay: Relay,
    ) -> None:
        self._loop = asyncio.get_running_loop()
        self._on_value, self._on_end, self._relay = on_value, on_end, relay
        messages, its_messages = socket.socketpair()
        self._way, its_way = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._pipe = MessagePipe(messages, MOST_WAITING_BYTES)
        self._process: subprocess.Popen[bytes] | None = None
        self._faults = FaultLog("setpoint streams")
        self._closed = False
        self._posted = 0
        self._handled = 0
        self._writing = False
        self._handed_over = 0
        self._numbers: dict[socket.socket, int] = {}
        """Of the sockets that the process has now."""
        self.connections: dict[int, Connection] = {}
        """By the number of their socket."""
        self.attached: set[str] = set()
        """Vehicles that the process knows."""
        self.up = False
        """Whether it has said that it has started."""
        self._loop.add_reader(self._pipe.fileno(), self.read)
        self._thread = threading.Thread(
            target=self._attend,
            args=(own_ids, silent_limit_s, its_messages, its_way),
            name="offboard-mail",
            daemon=True,
        )
        self._thread.start()

    @property
    def pid(self) -> int | None:
        """Of the process; None before it is there."""
        return None if self._process is None else self._process.pid

    @property
    def owes(self) -> bool:
        """Whether the process has not yet taken all that was sent to it."""
        return self._handled < self._posted

    def handled(self, number: int) -> bool:
        """The process has taken all up to there. Whether that is more than was known."""
        before, self._handled = self._handled, max(self._handled, number)
        return number > before

    def send(self, message: Post | Request[Any]) -> int:
        """Writes a message and numbers it.

        Raises:
            EOFError: the process has gone.
            PipeFull: it does not read.
        """
        self._pipe.send(Numbered(self._posted + 1, message))
        self._posted += 1
        self._write_on()
        return self._posted

    def read(self) -> None:
        """Takes what has arrived."""
        if self._closed:
            return
        try:
            values = self._pipe.receive()
        except EOFError:
            self._lost()
            return
        for several in values:
            assert isinstance(several, tuple)
            for value in several:  # pyright: ignore[reportUnknownVariableType]
                try:
                    self._on_value(value)  # pyright: ignore[reportUnknownArgumentType]
                except Exception as error:  # what else it says is heard
                    self._faults.add(error, "taking what the process says")

    def routes(self, senders: Mapping[str, PayloadSender]) -> dict[str, Route | None]:
        """Each vehicle's way as the process takes it, its socket handed over; None: by the server.

        To be told to the process, which keeps the sockets of these alone.
        """
        routes = {vehicle_id: self._route(sender) for vehicle_id, sender in senders.items()}
        used = {route.socket_number for route in routes.values() if route is not None}
        if len(used) < len(self._numbers):
            self._numbers = {s: number for s, number in self._numbers.items() if number in used}
            late = self._handed_over - LATE_MAIL_SOCKETS
            self.connections = {n: c for n, c in self.connections.items() if n in used or n > late}
        return routes

    @property
    def holds_sockets(self) -> bool:
        """Whether the process has any."""
        return bool(self._numbers)

    @property
    def holds_closed_sockets(self) -> bool:
        """Whether it has one that the server has closed since: the port stays taken while it does."""
        return any(link_socket.fileno() < 0 for link_socket in self._numbers)

    def _route(self, sender: PayloadSender) -> Route | None:
        way = sender.way_out()
        if way is None or way.peer.address is None:
            return None
        link_socket = way.connection.link.datagrams()
        if link_socket is None or link_socket.fileno() < 0:
            return None
        if link_socket not in self._numbers:
            number = self._handed_over + 1
            rights = (socket.SOL_SOCKET, socket.SCM_RIGHTS, array.array("i", [link_socket.fileno()]))
            try:
                self._way.sendmsg([b"%d" % number], [rights], socket.MSG_DONTWAIT)
            except OSError:  # it does not read, or has gone: told by other means, tried again with the next
                return None
            self._handed_over = self._numbers[link_socket] = number
            self.connections[number] = way.connection
        return Route(self._numbers[link_socket], way.peer.address, _signing(way.connection))

    # --- its end ----------------------------------------------------------------------------------

    def kill(self) -> None:
        """At once, whatever it does; nothing is heard of it afterwards."""
        self._close()
        if self._process is not None:
            self._process.kill()

    def end(self) -> None:
        """Closes its messages, at which it ends by itself; waits for it, as the server ends, too."""
        self._close()
        self._thread.join(2 * ENDS_WITHIN_S)

    def _close(self) -> None:
        if self._closed:
            return
        self._closed = True
        self._loop.remove_reader(self._pipe.fileno())
        if self._writing:
            self._loop.remove_writer(self._pipe.fileno())
        self._pipe.close()
        with contextlib.suppress(OSError):
            self._way.shutdown(socket.SHUT_RDWR)  # wakes the thread

    def _lost(self) -> None:
        if not self._closed:
            self._close()
            self._on_end()

    def _write_on(self) -> None:
        """The rest when the process reads."""
        if self._pipe.waits and not self._writing:
            self._writing = True
            self._loop.add_writer(self._pipe.fileno(), self._flush)

    def _flush(self) -> None:
        try:
            self._pipe.flush()
        except EOFError:
            self._lost()
            return
        if not self._pipe.waits:
            self._writing = False
            self._loop.remove_writer(self._pipe.fileno())

    # --- the thread -------------------------------------------------------------------------------

    def _attend(
        self,
        own_ids: tuple[int, int],
        silent_limit_s: float,
        its_messages: socket.socket,
        its_way: socket.socket,
    ) -> None:
        ends = [its_messages.fileno(), its_way.fileno()]
        arguments = [*ends, *own_ids, silent_limit_s]
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "gcs_server.streamer.process.worker", *map(str, arguments)],
                stdin=subprocess.DEVNULL,
                pass_fds=ends,
                start_new_session=True,  # Ctrl-C is the server's: it puts the vehicles into Hold first
            )
        except OSError:
            log.exception("the process that flies setpoint streams could not be started")
        finally:
            its_messages.close()  # at which the loop hears of an end, too
            its_way.close()
        while data := self._mail():
            try:
                self._pass_on(*pickle.loads(data))
            except Exception as error:  # the thread goes on: other vehicles' setpoints pass through it
                self._faults.add(error, "passing on what the process sends")
        self._reap()
        self._way.close()

    def _mail(self) -> bytes:
        """Waits for the next; empty when the process has ended."""
        try:
            return self._way.recv(LONGEST_MAIL)
        except OSError:
            return b""

    def _pass_on(self, kind: str, *what: Any) -> None:
        if kind == "relay":
            self._relay(*what)
            return
        for number, time_us, raw in what[0]:
            connection = self.connections.get(number)
            if connection is not None:
                connection.sent_elsewhere(time_us, raw)

    def _reap(self) -> None:
        if self._process is None:
            return
        try:
            self._process.wait(ENDS_WITHIN_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def _signing(connection: Connection) -> RouteSigning | None:
    signing = connection.signing
    if signing is None:
        return None
    ahead_s = signing.signer.clock.ahead_ticks // TICKS_PER_S  # seldom another one
    return RouteSigning(signing.signer.key.reveal(), signing.signer.link_id, ahead_s * TICKS_PER_S)
