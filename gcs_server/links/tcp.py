"""TCP links: `tcp` connects to a server, `tcpin` listens for several clients.

Connections that do not use MAVLink (web pages and browsers) are detected by their first bytes. Any web page
can make a browser send a request with any body to a TCP port of this computer, and the body could be read as
MAVLink. However, a page cannot choose the first bytes, which are a method and a space (RFC 9112, 3), the
preface of HTTP/2 (`PRI * HTTP/2.0`, RFC 9113, 3.4), or a TLS record (RFC 8446, 5.1).
"""

from __future__ import annotations

import asyncio
import errno
import logging
import re
import socket
from dataclasses import replace

from gcs_server.links.base import MAX_RETRY_S, LinkInfo, Peer
from gcs_server.links.channel import StreamSession
from gcs_server.links.host import Address, HostLink
from gcs_server.links.pacing import AckPacer, bytes_in_output_queue, round_trip_s
from gcs_server.links.writer import LinkWriter

log = logging.getLogger(__name__)

MAX_UNDECIDED_BYTES = 24
"""With this many bytes the protocol is known, because every HTTP method is shorter."""
LOG_INTERVAL_S = 10.0
SHOWN_FOR_S = 600.0
"""Time for which a link's detail shows the last closed connection [s]."""

_HTTP = re.compile(rb"[A-Z]{3,20} |HTTP/")
_MAYBE_HTTP = re.compile(rb"[A-Z]{1,20}|HTTP/?")
_TLS = re.compile(rb"[\x14-\x17]\x03")


def foreign_protocol(first: bytes) -> str | None:
    """The protocol ("HTTP" or "TLS") that the first bytes of a connection match; None: neither; "": more
    bytes are needed."""
    if _HTTP.match(first):
        return "HTTP"
    if _TLS.match(first):
        return "TLS"
    undecided = _MAYBE_HTTP.fullmatch(first) is not None or (len(first) == 1 and 0x14 <= first[0] <= 0x17)
    return "" if undecided and len(first) < MAX_UNDECIDED_BYTES else None


class FirstBytes:
    """Buffers a connection's first bytes until it is certain that the other side is not a web client."""

    __slots__ = ("_buffer", "_decided")

    def __init__(self) -> None:
        self._buffer = b""
        self._decided = False

    def accept(self, data: bytes) -> bytes:
        """The bytes that may be read as MAVLink; empty until the protocol is known.

        Raises:
            ForeignProtocol: the protocol is HTTP or TLS; close the connection without reading the bytes.
        """
        if self._decided:
            return data
        self._buffer += data
        protocol = foreign_protocol(self._buffer)
        if protocol:
            raise ForeignProtocol(protocol)
        if protocol == "":
            return b""
        self._decided = True
        buffered, self._buffer = self._buffer, b""
        return buffered


class ForeignProtocol(Exception):
    """A connection uses HTTP or TLS."""

    def __init__(self, protocol: str) -> None:
        super().__init__(protocol)
        self.protocol = protocol


class ClosedConnections:
    """Counts and reports connections that a listening link closed because of their first bytes."""

    def __init__(self, link_name: str) -> None:
        self._link_name = link_name
        self._count = 0
        self._last = ("", "", float("-inf"))
        """Host, protocol, monotonic time [s]."""
        self._logged_s = float("-inf")

    def add(self, host: str, protocol: str, now_s: float) -> None:
        """Counts a closed connection."""
        self._count += 1
        self._last = (host, protocol, now_s)
        if now_s - self._logged_s >= LOG_INTERVAL_S:
            self._logged_s = now_s
            log.warning("link %s: %s", self._link_name, self.text(now_s))

    def text(self, now_s: float) -> str:
        """Text for the link's detail; empty if nothing was closed recently."""
        host, protocol, last_s = self._last
        if now_s - last_s > SHOWN_FOR_S:
            return ""
        connections = "1 connection" if self._count == 1 else f"{self._count} connections"
        return (
            f"Closed {connections} that used {protocol}, not MAVLink, the last from {host}: a web page or a "
            "browser tried this port. The server read nothing from it. Close that page."
        )


MAX_CLIENTS = 256
"""Maximum number of connections of one listening link; further ones are closed immediately."""
OUT_OF_RESOURCES = frozenset({errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM})
ACCEPT_AGAIN_AFTER_S = 1.0


class TcpLink(HostLink):
    """A client of one TCP server."""

    def __init__(self, name: str, url: str, host: str, port: int, *, forward: bool = False) -> None:
        super().__init__(name, url, host, port, forward=forward)
        self._connecting = False
        self._session: StreamSession | None = None
        self._peer = Peer(f"{host}:{port}")
        self._first_bytes = FirstBytes()

    def _open_socket(self, address: Address) -> None:
        self._socket = sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        result = sock.connect_ex(address)
        if result not in (0, errno.EINPROGRESS):
            self._lost(self._explain(OSError(result, "")))
            return
        self._connecting = True
        self._loop.add_writer(sock.fileno(), self._run_opening_step, self._connected)

    def _connected(self) -> None:
        sock = self._socket
        if sock is None:
            return
        self._loop.remove_writer(sock.fileno())
        self._connecting = False
        result = sock.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if result:
            self._lost(self._explain(OSError(result, "")))
            return
        self._first_bytes = FirstBytes()
        self._session = StreamSession(
            self._loop,
            sock.fileno(),
            read=sock.recv,
            write=sock.send,
            pacer=_pacer(sock),
            counts=self._counts,
            on_received=self._receive_if_mavlink,
            on_end=lambda why: self._lost(f"{self._peer.name}: {why}"),
            faults=self.faults,
        )
        self._peers[self._peer.name] = self._peer
        self._opened()

    def _receive_if_mavlink(self, data: bytes) -> None:
        try:
            data = self._first_bytes.accept(data)
        except ForeignProtocol as error:
            self._retry_s = MAX_RETRY_S  # the other side will not switch to MAVLink later
            reason = f"{self._peer.name} speaks {error.protocol}, not MAVLink."
            self._lost(f"{reason} Check the port; the server tries again.")
            return
        if data:
            self._received(data, self._peer)

    def _explain(self, error: OSError) -> str:
        if error.errno == errno.ECONNREFUSED:
            return f"No program listens on {self._host}:{self._port} yet (TCP); the server tries again."
        if error.errno in (errno.EHOSTUNREACH, errno.ENETUNREACH, errno.ETIMEDOUT):
            return f"{self._host} cannot be reached. Check the network; the server tries again."
        if error.errno in (errno.EMFILE, errno.ENFILE):
            return super()._explain(error)
        return f"{self._host}:{self._port}: {errno.errorcode.get(error.errno or 0, error)}"

    def _writer(self, peer: Peer) -> LinkWriter | None:
        session = self._session
        return None if session is None else session.writer

    def _close(self) -> None:
        if self._session is not None:
            self._session.close()
            self._session = None
        sock, self._socket = self._socket, None
        if sock is not None:
            if self._connecting:
                self._loop.remove_writer(sock.fileno())
                self._connecting = False
            sock.close()


class TcpServerLink(HostLink):
    """A listening link; every client is a peer."""

    def __init__(self, name: str, url: str, host: str, port: int, *, forward: bool = False) -> None:
        super().__init__(name, url, host, port, forward=forward)
        self._clients: dict[str, tuple[socket.socket, StreamSession]] = {}
        self._closed_connections = ClosedConnections(name)
        self._accept_again: asyncio.TimerHandle | None = None

    def info(self) -> LinkInfo:
        info = super().info()
        if info.state != "open":
            return info
        return replace(info, detail=self._closed_connections.text(self._loop.time()))

    def _open_socket(self, address: Address) -> None:
        sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            sock.setblocking(False)
            sock.bind(address)
            sock.listen()
        except OSError as error:
            sock.close()
            self._lost(self._explain(error))
            return
        self._socket = sock
        self._start_accepting()
        self._opened()

    def _explain(self, error: OSError) -> str:
        if error.errno == errno.EADDRINUSE:
            return (
                f"TCP port {self._port} on {self._host} is taken by another program. "
                "Close it, or choose another port; the server tries again."
            )
        return super()._explain(error)

    def _accept(self) -> None:
        listener = self._socket
        if listener is None:
            return
        try:
            sock, address = listener.accept()
        except OSError as error:
            if error.errno in OUT_OF_RESOURCES:  # the socket stays readable: pause to avoid a busy loop
                self.faults.add(error, "accepting a connection")
                self._loop.remove_reader(listener.fileno())
                self._accept_again = self._loop.call_later(ACCEPT_AGAIN_AFTER_S, self._start_accepting)
            return
        try:
            self._add_client(sock, Peer(f"{address[0]}:{address[1]}", (address[0], address[1])))
        except Exception as error:
            self.faults.add(error, "accepting a connection")
            sock.close()

    def _start_accepting(self) -> None:
        if self._socket is not None:
            self._loop.add_reader(self._socket.fileno(), self._accept)

    def _add_client(self, sock: socket.socket, peer: Peer) -> None:
        if len(self._clients) >= MAX_CLIENTS:
            sock.close()
            return
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        first_bytes = FirstBytes()
        session = StreamSession(
            self._loop,
            sock.fileno(),
            read=sock.recv,
            write=sock.send,
            pacer=_pacer(sock),
            counts=self._counts,
            on_received=lambda data: self._receive_if_mavlink(data, peer, first_bytes),
            on_end=lambda _why: self._remove_client(peer),
            faults=self.faults,
        )
        self._clients[peer.name] = (sock, session)
        self._peers[peer.name] = peer
        self._changed()

    def _receive_if_mavlink(self, data: bytes, peer: Peer, first_bytes: FirstBytes) -> None:
        try:
            data = first_bytes.accept(data)
        except ForeignProtocol as error:
            self._closed_connections.add(peer.name.rpartition(":")[0], error.protocol, self._loop.time())
            self._remove_client(peer)
            self._changed()
            return
        if data:
            self._received(data, peer)

    def _remove_client(self, peer: Peer) -> None:
        client = self._clients.pop(peer.name, None)
        if client is not None:
            client[1].close()
            client[0].close()
        self._forget(peer)

    def _writer(self, peer: Peer) -> LinkWriter | None:
        client = self._clients.get(peer.name)
        return None if client is None else client[1].writer

    def _close(self) -> None:
        for peer in self.peers():
            self._remove_client(peer)
        if self._accept_again is not None:
            self._accept_again.cancel()
        sock, self._socket = self._socket, None
        if sock is not None:
            self._loop.remove_reader(sock.fileno())
            sock.close()


def _pacer(sock: socket.socket) -> AckPacer:
    return AckPacer(lambda: bytes_in_output_queue(sock.fileno()), lambda: round_trip_s(sock))
