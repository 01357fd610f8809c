"""Detects TCP connections that do not use MAVLink: web pages and browsers, by their first bytes.

Any web page can make a browser send a request with any body to a TCP port of this computer, and the body
could be read as MAVLink. However, a page cannot choose the first bytes, which are a method and a space (RFC
9112, 3), the preface of HTTP/2 (`PRI * HTTP/2.0`, RFC 9113, 3.4), or a TLS record (RFC 8446, 5.1).
"""

from __future__ import annotations

import logging
import re

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
