"""One run of the process that flies the streams (`worker.py`): started, called, listened to, ended."""

from __future__ import annotations

import contextlib
import logging
import pickle
import socket
import subprocess
import sys
from collections.abc import Mapping
from multiprocessing.connection import Connection as Pipe
from typing import Any

from gcs_server.mavlink.connection import Connection
from gcs_server.streamer.streams import PayloadSender
from gcs_server.streamer.worker import Route

log = logging.getLogger(__name__)

STARTS_WITHIN_S = 10.0
ANSWERS_WITHIN_S = 2.0
"""A process that does not answer for so long counts as gone: the vehicles fail safe rather than fly on
unseen."""
LONGEST_MAIL = 1 << 20
LATE_MAIL_SOCKETS = 20
"""Of so many sockets given up last it may still be told what went out by them."""


class Gone(Exception):
    """The process does not answer."""


class Child:
    """One run of the process."""

    def __init__(self, own_ids: tuple[int, int], silent_limit_s: float) -> None:
        calls, its_calls = socket.socketpair()
        self._way, its_way = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        ends = [its_calls.fileno(), its_way.fileno()]
        arguments = [*ends, *own_ids, silent_limit_s]
        self._process = subprocess.Popen(
            [sys.executable, "-m", "gcs_server.streamer.worker", *map(str, arguments)],
            stdin=subprocess.DEVNULL,
            pass_fds=ends,
            start_new_session=True,  # Ctrl-C is the server's: it puts the vehicles into Hold first
        )
        its_calls.close()
        its_way.close()
        self._calls = Pipe(calls.detach())
        self._greeted = False
        self._handed_over = 0
        self._numbers: dict[socket.socket, int] = {}
        """Of the sockets that the process has now."""
        self.connections: dict[int, Connection] = {}
        """By the number of their socket."""
        self.known: set[str] = set()
        """Vehicles that the process knows."""

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid

    @property
    def dead(self) -> bool:
        """Whether it has ended."""
        return self._process.poll() is not None

    def call(self, name: str, *arguments: object) -> Any:
        """Waits for the answer.

        Raises:
            Gone: there is none.
            ValueError: what was asked for cannot be.
            RuntimeError: it failed otherwise; the process has logged how.
        """
        try:
            if not self._greeted:
                self._expect(STARTS_WITHIN_S)
                self._hear_greeting()
            self._calls.send_bytes(pickle.dumps((name, arguments)))
            self._expect(ANSWERS_WITHIN_S)
            error, result = pickle.loads(self._calls.recv_bytes())
        except (EOFError, OSError) as problem:
            raise Gone from problem
        if error:
            raise (ValueError if error == "ValueError" else RuntimeError)(result)
        return result

    def is_up(self) -> bool:
        """Whether it has started; until then a call would have to wait for that.

        Raises:
            Gone: it ended instead.
        """
        try:
            if not self._greeted and self._calls.poll(0):
                self._hear_greeting()
        except (EOFError, OSError) as problem:
            raise Gone from problem
        return self._greeted

    def _hear_greeting(self) -> None:
        if not pickle.loads(self._calls.recv_bytes()):
            log.info("setpoint streams have no real-time priority: see docs/performance.md")
        self._greeted = True

    def _expect(self, within_s: float) -> None:
        if not self._calls.poll(within_s):
            raise EOFError

    @property
    def holds_sockets(self) -> bool:
        """Whether the process keeps sockets of links, and with them their ports."""
        return bool(self._numbers)

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

    def _route(self, sender: PayloadSender) -> Route | None:
        way = sender.way_out()
        if way is None or way.peer.address is None:
            return None
        link_socket = way.connection.link.datagrams()
        if link_socket is None:
            return None
        if link_socket not in self._numbers:
            self._handed_over += 1
            number = self._numbers[link_socket] = self._handed_over
            self.connections[number] = way.connection
            with contextlib.suppress(OSError):  # gone: the next call says so
                socket.send_fds(self._way, [b"%d" % number], [link_socket.fileno()])
        return Route(self._numbers[link_socket], way.peer.address)

    def mail(self) -> tuple[Any, ...] | None:
        """Waits for the next; None when the process has ended."""
        try:
            data = self._way.recv(LONGEST_MAIL)
        except OSError:
            return None
        return pickle.loads(data) if data else None

    def end(self) -> None:
        """Closes its calls, at which it ends by itself."""
        self._calls.close()
        try:
            self._process.wait(1.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        with contextlib.suppress(OSError):
            self._way.shutdown(socket.SHUT_RDWR)  # wakes whoever waits for mail
        self._way.close()
