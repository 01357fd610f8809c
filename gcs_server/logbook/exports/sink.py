"""Where an export is written to: pieces of a few hundred kilobytes, sent as they come."""

from __future__ import annotations

import io
from collections.abc import Callable

PIECE_BYTES = 1 << 18
Send = Callable[[bytes], None]


class BadExport(ValueError):
    """A request that the log cannot fulfil.

    Args:
        field: the field of the request that is wrong.
        text: why.
    """

    def __init__(self, field: str, text: str) -> None:
        super().__init__(text)
        self.field = field


class Sink:
    """A file that can only be written to, once, from its begin to its end.

    Args:
        send: takes each piece; blocks while the reader is slow.
    """

    def __init__(self, send: Send) -> None:
        self._send = send
        self._pieces: list[bytes] = []
        self._waiting = self._written = 0

    def write(self, data: bytes | bytearray | memoryview | str) -> int:
        """Adds data, and returns its size [bytes]."""
        piece = data.encode() if isinstance(data, str) else bytes(data)
        self._pieces.append(piece)
        self._waiting += len(piece)
        self._written += len(piece)
        if self._waiting >= PIECE_BYTES:
            self.flush()
        return len(piece)

    def flush(self) -> None:
        """Sends what has not been sent."""
        if self._waiting:
            self._send(b"".join(self._pieces))
            self._pieces, self._waiting = [], 0

    def seek(self, offset: int, whence: int = 0) -> int:
        """Parquet's writer asks whether there is this method, and never calls it."""
        raise io.UnsupportedOperation("an export is written in order")

    def tell(self) -> int:
        """Size of what has been written [bytes]."""
        return self._written
