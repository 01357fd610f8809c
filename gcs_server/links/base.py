"""What every link is: bytes in with the peer they came from, bytes out from any thread."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class Peer:
    """Who is at the other end: `host:port` for UDP, one for the whole link otherwise."""

    name: str
    address: tuple[str, int] | None = None


@dataclass(frozen=True, slots=True)
class LinkInfo:
    """One line of `GET /links`."""

    name: str
    url: str
    state: str
    """connecting, open, waiting (it will try again), closed, ended (a replay that came to its end)."""
    detail: str
    """For people: what is wrong and what to do about it; empty when all is well."""
    replay: bool
    forward: bool
    peers: tuple[str, ...]
    bytes_received: int
    bytes_sent: int
    bytes_dropped: int
    """Not sent because the outbox was full or nobody was connected."""


OnBytes = Callable[[bytes, Peer, float], None]
"""(data, peer, received_monotonic_s); called in the event loop."""

OnPeerGone = Callable[[Peer], None]
OnState = Callable[[], None]


class Link(Protocol):
    """Bytes only; a link opens itself, and again after it was lost."""

    name: str
    url: str
    replay: bool
    """True where what arrives is a recording; nothing can be sent."""
    forward: bool
    """True for a link to another ground station, which gets what the vehicles say."""

    def start(self, on_bytes: OnBytes, on_peer_gone: OnPeerGone, on_state: OnState) -> None:
        """Begins; never raises for what may get better (a port taken, a device missing): see `info()`."""
        ...

    def send(self, data: bytes, peer: Peer) -> bool:
        """Sends or queues; callable from any thread; False where the bytes were dropped."""
        ...

    def info(self) -> LinkInfo:
        """State and counters now."""
        ...

    async def close(self) -> None:
        """Gives back the socket or device; returns when that is done."""
        ...
