"""Values between the server and the process of the streams, by a socket that never makes anybody wait."""

from __future__ import annotations

import contextlib
import pickle
import socket
import struct

_LENGTH = struct.Struct("!I")
READ_BYTES = 1 << 16
READS_A_WAKE = 64
"""So much is read before the caller does something else."""


class PipeFull(Exception):
    """The other side does not read, and as much waits for it as may."""


class MessagePipe:
    """One end. Both ends are our own processes: what arrives is trusted.

    Args:
        sock: a connected stream socket, owned from now on.
        most_waiting_bytes: what may wait here when the system's own buffer is full.
    """

    def __init__(self, sock: socket.socket, most_waiting_bytes: int) -> None:
        sock.setblocking(False)
        self._socket = sock
        self._most_waiting_bytes = most_waiting_bytes
        self._out = bytearray()
        self._in = bytearray()

    def fileno(self) -> int:
        """For `select`."""
        return self._socket.fileno()

    @property
    def waits(self) -> bool:
        """Whether something is yet to be written: call `flush` when the socket takes more."""
        return bool(self._out)

    def send(self, value: object) -> None:
        """Writes what the socket takes now and keeps the rest.

        Raises:
            PipeFull: too much waits already; the value was not taken.
            EOFError: the other side has gone.
        """
        data = pickle.dumps(value, pickle.HIGHEST_PROTOCOL)
        if self._out and len(self._out) + len(data) > self._most_waiting_bytes:
            raise PipeFull
        self._out += _LENGTH.pack(len(data))
        self._out += data
        self.flush()

    def flush(self) -> None:
        """Writes on. Raises EOFError where the other side has gone."""
        try:
            while self._out:
                del self._out[: self._socket.send(self._out)]
        except BlockingIOError:
            pass
        except OSError as error:
            raise EOFError from error

    def receive(self) -> list[object]:
        """All that has arrived completely. Raises EOFError where the other side has gone."""
        ended = self._read()
        values: list[object] = []
        begin = 0
        while len(self._in) - begin >= _LENGTH.size:
            (size,) = _LENGTH.unpack_from(self._in, begin)
            end = begin + _LENGTH.size + size
            if len(self._in) < end:
                break
            values.append(pickle.loads(memoryview(self._in)[begin + _LENGTH.size : end]))
            begin = end
        del self._in[:begin]
        if ended and not values:
            raise EOFError
        return values

    def close(self) -> None:
        """What still waits is lost."""
        self._socket.close()

    def _read(self) -> bool:
        """Whether the other side has gone."""
        with contextlib.suppress(BlockingIOError):
            for _ in range(READS_A_WAKE):
                try:
                    data = self._socket.recv(READ_BYTES)
                except ConnectionError:
                    return True
                if not data:
                    return True
                self._in += data
        return False
