"""Exchanges values between the server and the stream process over a socket that never blocks."""

from __future__ import annotations

import contextlib
import pickle
import socket
import struct

_LENGTH = struct.Struct("!I")
READ_BYTES = 1 << 16
READS_PER_WAKE = 64
"""Maximum number of reads per call, so that the caller can do other work between calls."""


class PipeFull(Exception):
    """The other side does not read, and the buffer is full."""


class MessagePipe:
    """One end of the pipe. Both ends belong to this server, so received values are trusted.

    Args:
        sock: a connected stream socket; the pipe owns it.
        max_waiting_bytes: size of the buffer for data that the system's buffer does not accept.
    """

    def __init__(self, sock: socket.socket, max_waiting_bytes: int) -> None:
        sock.setblocking(False)
        self._socket = sock
        self._max_waiting_bytes = max_waiting_bytes
        self._outgoing = bytearray()
        self._incoming = bytearray()

    def fileno(self) -> int:
        """File descriptor for `select`."""
        return self._socket.fileno()

    @property
    def has_unsent_data(self) -> bool:
        """Whether buffered data is not written yet: call `flush` when the socket is writable."""
        return bool(self._outgoing)

    def send(self, value: object) -> None:
        """Writes as much as the socket accepts and buffers the rest.

        Raises:
            PipeFull: the buffer is full; the value was not accepted.
            EOFError: the other side has closed the pipe.
        """
        data = pickle.dumps(value, pickle.HIGHEST_PROTOCOL)
        if self._outgoing and len(self._outgoing) + len(data) > self._max_waiting_bytes:
            raise PipeFull
        self._outgoing += _LENGTH.pack(len(data))
        self._outgoing += data
        self.flush()

    def flush(self) -> None:
        """Writes more of the buffer. Raises EOFError if the other side has closed the pipe."""
        try:
            while self._outgoing:
                del self._outgoing[: self._socket.send(self._outgoing)]
        except BlockingIOError:
            pass
        except OSError as error:
            raise EOFError from error

    def receive(self) -> list[object]:
        """Returns all complete values. Raises EOFError if the other side has closed the pipe."""
        ended = self._read()
        values: list[object] = []
        begin = 0
        while len(self._incoming) - begin >= _LENGTH.size:
            (size,) = _LENGTH.unpack_from(self._incoming, begin)
            end = begin + _LENGTH.size + size
            if len(self._incoming) < end:
                break
            values.append(pickle.loads(memoryview(self._incoming)[begin + _LENGTH.size : end]))
            begin = end
        del self._incoming[:begin]
        if ended and not values:
            raise EOFError
        return values

    def close(self) -> None:
        """Closes the pipe; buffered data is lost."""
        self._socket.close()

    def _read(self) -> bool:
        """Reads into the buffer; returns whether the other side has closed the pipe."""
        with contextlib.suppress(BlockingIOError):
            for _ in range(READS_PER_WAKE):
                try:
                    data = self._socket.recv(READ_BYTES)
                except ConnectionError:
                    return True
                if not data:
                    return True
                self._incoming += data
        return False
