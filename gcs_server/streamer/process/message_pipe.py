"""Exchanges values between the server and the stream process over a socket that never blocks."""

from __future__ import annotations

import contextlib
import copyreg
import dataclasses
import io
import operator
import pickle
import socket
import struct
from collections.abc import Callable
from typing import Any

_LENGTH = struct.Struct("!I")
READ_BYTES = 1 << 16
READS_PER_WAKE = 64
"""Maximum number of reads per call, so that the caller can do other work between calls."""


Reduce = Callable[[Any], Any]
"""Returns the value's class and the arguments with which a call of the class creates an equal value."""


class PipeFull(Exception):
    """The other side does not read, and the buffer is full."""


class _DispatchTable(dict[type, Reduce]):
    """Python's table of reducers, and in addition one for each frozen dataclass: a call of the class with all
    fields. `dataclasses` itself reads and sets each field in Python code, which takes twice the time."""

    def __missing__(self, value_type: type) -> Reduce:
        if not _is_plain_value(value_type):
            raise KeyError(value_type)  # pickled as usual
        names = [each.name for each in dataclasses.fields(value_type)]
        if len(names) > 1:
            values_of: Callable[[Any], tuple[Any, ...]] = operator.attrgetter(*names)
        else:
            values_of = lambda value: tuple(getattr(value, name) for name in names)  # noqa: E731
        reducer = self[value_type] = lambda value: (value_type, values_of(value))
        return reducer


def _is_plain_value(value_type: type) -> bool:
    """Whether a call with all fields, in their order, creates an equal value."""
    if not dataclasses.is_dataclass(value_type) or hasattr(value_type, "__post_init__"):
        return False
    frozen = value_type.__dataclass_params__.frozen  # type: ignore[attr-defined]
    return frozen and all(each.init and not each.kw_only for each in dataclasses.fields(value_type))


_dispatch_table = _DispatchTable(copyreg.dispatch_table)


def pickled(value: object) -> bytes:
    """The value as bytes, for `pickle.loads`."""
    stream = io.BytesIO()
    pickler = pickle.Pickler(stream, pickle.HIGHEST_PROTOCOL)
    pickler.dispatch_table = _dispatch_table
    pickler.dump(value)
    return stream.getvalue()


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
        data = pickled(value)
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
                if len(data) < READ_BYTES:  # nothing more waits
                    break
        return False
