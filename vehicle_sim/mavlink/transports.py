"""Non-blocking UDP and TCP sockets of a vehicle."""

from __future__ import annotations

import contextlib
import logging
import socket
import string
from collections.abc import Callable

log = logging.getLogger(__name__)

RECEIVE_BYTES = 65536
READS_PER_STEP = 200
"""Maximum number of reads from a socket per step, so that a fast sender cannot delay the simulation."""
MAX_DATAGRAM_BYTES = 1400
MAX_BACKLOG_BYTES = 1_000_000
"""The server disconnects a client with more unread bytes."""
MAX_METHOD_LENGTH = 20
MIN_METHOD_LENGTH = 3
"""Length of the shortest HTTP method ("GET")."""
TLS_HANDSHAKE_START = b"\x16\x03"
"""Record type and major version."""
_CAPITALS = string.ascii_uppercase.encode()


class PortUnavailable(OSError):
    """A port cannot be bound; the text names the port and the reason."""


class UdpTransport:
    """One UDP port: sends to a fixed address until it receives a datagram, then to that datagram's sender."""

    def __init__(self, bind: str, port: int, remote: tuple[str, int] | None) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        try:
            self.socket.bind((bind, port))
        except OSError as error:
            self.socket.close()
            raise PortUnavailable(f"UDP port {port} on {bind}: {error.strerror or error}") from error
        self.port: int = self.socket.getsockname()[1]
        self._remote = remote
        self._first_sender: tuple[str, int] | None = None

    @property
    def readable(self) -> socket.socket:
        """The socket to wait on."""
        return self.socket

    def receive(self) -> bytes:
        """Bytes of the received datagrams, of all senders."""
        chunks: list[bytes] = []
        for _ in range(READS_PER_STEP):
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
        """Sends frames in as few datagrams as possible; frames are lost if nobody receives them."""
        remote = self._first_sender or self._remote
        if remote is None:
            return
        for datagram in _datagrams(frames):
            with contextlib.suppress(OSError):
                self.socket.sendto(datagram, remote)

    def close(self) -> None:
        """Closes the socket."""
        self.socket.close()


def _datagrams(frames: list[bytes]) -> list[bytes]:
    datagrams: list[bytes] = []
    pending: list[bytes] = []
    size = 0
    for frame in frames:
        if size + len(frame) > MAX_DATAGRAM_BYTES and pending:
            datagrams.append(b"".join(pending))
            pending, size = [], 0
        pending.append(frame)
        size += len(frame)
    if pending:
        datagrams.append(b"".join(pending))
    return datagrams


def is_web_client(first_bytes: bytes) -> bool | None:
    """Whether a client is a web browser: its first bytes are an HTTP method and a space, or TLS.

    Any web page can make the browser send bytes to this port, but the page cannot choose the first bytes.
    None: more bytes are needed.
    """
    letters = len(first_bytes) - len(first_bytes.lstrip(_CAPITALS))
    if letters == len(first_bytes) or first_bytes == TLS_HANDSHAKE_START[:1]:
        return None if letters <= MAX_METHOD_LENGTH else False
    if first_bytes.startswith(TLS_HANDSHAKE_START):
        return True
    return MIN_METHOD_LENGTH <= letters <= MAX_METHOD_LENGTH and first_bytes[letters] == ord(" ")


class TcpServer:
    """One TCP port for one client at a time; a second client waits until the first one has disconnected.

    The server disconnects a web browser, and ignores its bytes.
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
            raise PortUnavailable(f"TCP port {port} on {bind}: {error.strerror or error}") from error
        self.port: int = self.socket.getsockname()[1]
        self._on_connect = on_connect
        self._on_disconnect = on_disconnect
        self._client: socket.socket | None = None
        self._backlog = bytearray()
        self._first_bytes: bytes | None = b""
        """First bytes of the client, while it may be a web browser; None: it is not a web browser."""
        self._reported_web_client = False

    @property
    def connected(self) -> bool:
        """Whether a client is connected."""
        return self._client is not None

    @property
    def readable(self) -> socket.socket:
        """The socket to wait on: the client's socket, or without a client the listening socket."""
        return self._client or self.socket

    def receive(self) -> bytes:
        """Bytes received from the client; accepts a waiting client if none is connected."""
        if self._client is None:
            self._accept()
        chunks: list[bytes] = []
        for _ in range(READS_PER_STEP):
            if self._client is None:
                break
            try:
                data = self._client.recv(RECEIVE_BYTES)
            except (BlockingIOError, InterruptedError):
                break
            except OSError:
                self._disconnect()
                break
            if not data:
                self._disconnect()
                break
            chunks.append(data)
        return self._data_unless_web_client(b"".join(chunks))

    def _data_unless_web_client(self, data: bytes) -> bytes:
        """The client's data; empty if the client is a web browser, or while the client may be one."""
        if self._first_bytes is None:
            return data
        first_bytes = self._first_bytes + data
        is_web = is_web_client(first_bytes)
        if is_web is None:
            self._first_bytes = first_bytes
            return b""
        if not is_web:
            self._first_bytes = None
            return first_bytes
        self._disconnect()
        if not self._reported_web_client:
            self._reported_web_client = True
            log.warning(
                "TCP port %d: a web browser connected. The simulator closed the connection. Close the web "
                "page that connects. (The simulator closes further connections without a message.)",
                self.port,
            )
        return b""

    def send(self, frames: list[bytes]) -> None:
        """Sends frames to the client; frames that the socket does not accept yet wait in the backlog."""
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
            self._disconnect()
            return
        del self._backlog[:sent]
        if len(self._backlog) > MAX_BACKLOG_BYTES:
            self._disconnect()

    def close(self) -> None:
        """Closes the socket."""
        self._disconnect()
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

    def _disconnect(self) -> None:
        if self._client is None:
            return
        with contextlib.suppress(OSError):
            self._client.close()
        self._client = None
        self._backlog.clear()
        self._on_disconnect()
