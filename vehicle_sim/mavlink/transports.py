"""The sockets around a vehicle: UDP and TCP on loopback, non-blocking, and nothing but bytes."""

from __future__ import annotations

import contextlib
import logging
import socket
import string
from collections.abc import Callable

log = logging.getLogger(__name__)

RECEIVE_BYTES = 65536
DATAGRAMS_PER_TURN = 200
"""A flood must not keep the vehicles from being simulated."""
DATAGRAM_LIMIT = 1400
TCP_BACKLOG_LIMIT = 1_000_000
"""A client that does not read for so many bytes is let go."""
LONGEST_METHOD = 20
SHORTEST_METHOD = 3
"""Letters of an HTTP request's method ("GET" to "VERSION-CONTROL", custom ones included)."""
TLS_HANDSHAKE = b"\x16\x03"
_CAPITALS = string.ascii_uppercase.encode()


class PortTaken(OSError):
    """A port cannot be bound; the text says which and why."""


class UdpTransport:
    """One UDP port: sends to a fixed address until somebody writes to it, then answers the first who did."""

    def __init__(self, bind: str, port: int, remote: tuple[str, int] | None) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        try:
            self.socket.bind((bind, port))
        except OSError as error:
            self.socket.close()
            raise PortTaken(f"UDP port {port} on {bind}: {error.strerror or error}") from error
        self.port: int = self.socket.getsockname()[1]
        self._remote = remote
        self._first_sender: tuple[str, int] | None = None

    @property
    def readable(self) -> socket.socket:
        """What to watch for something to arrive."""
        return self.socket

    def receive(self) -> bytes:
        """What has arrived from the partner."""
        chunks: list[bytes] = []
        for _ in range(DATAGRAMS_PER_TURN):
            try:
                data, sender = self.socket.recvfrom(RECEIVE_BYTES)
            except (BlockingIOError, InterruptedError):
                break
            except OSError:
                continue
            if self._first_sender is None:
                self._first_sender = sender
            chunks.append(data)
        return b"".join(chunks)

    def send(self, frames: list[bytes]) -> None:
        """Frames packed into few datagrams; what nobody hears is lost, as on any UDP link."""
        to = self._first_sender or self._remote
        if to is None:
            return
        for datagram in _packed(frames):
            with contextlib.suppress(OSError):
                self.socket.sendto(datagram, to)

    def close(self) -> None:
        """Give the port back."""
        self.socket.close()


def _packed(frames: list[bytes]) -> list[bytes]:
    out: list[bytes] = []
    pending: list[bytes] = []
    size = 0
    for frame in frames:
        if size + len(frame) > DATAGRAM_LIMIT and pending:
            out.append(b"".join(pending))
            pending, size = [], 0
        pending.append(frame)
        size += len(frame)
    if pending:
        out.append(b"".join(pending))
    return out


def is_web_client(first: bytes) -> bool | None:
    """Whether a connection's first bytes are a web browser's: an HTTP method and a blank, or a TLS handshake.

    A web page anywhere can have the browser send it bytes; only the first ones are not the page's to choose.
    None: more bytes are needed to tell.
    """
    letters = len(first) - len(first.lstrip(_CAPITALS))
    if letters == len(first) or first == TLS_HANDSHAKE[:1]:
        return None if letters <= LONGEST_METHOD else False
    if first.startswith(TLS_HANDSHAKE):
        return True
    return SHORTEST_METHOD <= letters <= LONGEST_METHOD and first[letters] == ord(" ")


class TcpServer:
    """One TCP port for one client at a time; a second has to wait until the first has gone.

    A web browser that connects is let go before anything of it is read.
    """

    def __init__(
        self, bind: str, port: int, on_connect: Callable[[], None], on_disconnect: Callable[[], None]
    ) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.socket.setblocking(False)
        try:
            self.socket.bind((bind, port))
            self.socket.listen(1)
        except OSError as error:
            self.socket.close()
            raise PortTaken(f"TCP port {port} on {bind}: {error.strerror or error}") from error
        self.port: int = self.socket.getsockname()[1]
        self._on_connect = on_connect
        self._on_disconnect = on_disconnect
        self._client: socket.socket | None = None
        self._backlog = bytearray()
        self._first_bytes: bytes | None = b""
        """What the client said so far, while it may still be a web browser; None: it is none."""
        self._told_of_web_client = False

    @property
    def connected(self) -> bool:
        """Whether there is a client."""
        return self._client is not None

    @property
    def readable(self) -> socket.socket:
        """What to watch: the client, or where the next one knocks; a second one waits unheard."""
        return self._client or self.socket

    def receive(self) -> bytes:
        """What the client has sent; takes a waiting client when there is none."""
        if self._client is None:
            self._accept()
        chunks: list[bytes] = []
        for _ in range(DATAGRAMS_PER_TURN):
            if self._client is None:
                break
            try:
                data = self._client.recv(RECEIVE_BYTES)
            except (BlockingIOError, InterruptedError):
                break
            except OSError:
                self._drop()
                break
            if not data:
                self._drop()
                break
            chunks.append(data)
        return self._screened(b"".join(chunks))

    def _screened(self, data: bytes) -> bytes:
        """`data` unless its sender is a web browser, or may be one."""
        if self._first_bytes is None:
            return data
        first = self._first_bytes + data
        verdict = is_web_client(first)
        if verdict is None:
            self._first_bytes = first
            return b""
        if not verdict:
            self._first_bytes = None
            return first
        self._drop()
        if not self._told_of_web_client:
            self._told_of_web_client = True
            log.warning(
                "TCP port %d: a web browser connected; the vehicle closed the connection and read nothing of "
                "it. Close the page that does so. (Further ones are closed without a word.)",
                self.port,
            )
        return b""

    def send(self, frames: list[bytes]) -> None:
        """Frames to the client, as far as it takes them."""
        if self._client is None:
            return
        self._backlog += b"".join(frames)
        if not self._backlog:
            return
        try:
            sent = self._client.send(self._backlog)
        except (BlockingIOError, InterruptedError):
            sent = 0
        except OSError:
            self._drop()
            return
        del self._backlog[:sent]
        if len(self._backlog) > TCP_BACKLOG_LIMIT:
            self._drop()

    def close(self) -> None:
        """Give the port back."""
        self._drop()
        self.socket.close()

    def _accept(self) -> None:
        try:
            client, _ = self.socket.accept()
        except OSError:
            return
        client.setblocking(False)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._client = client
        self._first_bytes = b""
        self._on_connect()

    def _drop(self) -> None:
        if self._client is None:
            return
        with contextlib.suppress(OSError):
            self._client.close()
        self._client = None
        self._backlog.clear()
        self._on_disconnect()
