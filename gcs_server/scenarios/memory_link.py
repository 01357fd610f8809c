"""A link without a network, for tests: sent bytes go to a function, injected bytes are received."""

from __future__ import annotations

from collections.abc import Callable

from gcs_server.links.base import Link, Peer
from gcs_server.links.writer import LinkWriter


class MemoryLink(Link):
    """A link that is always open.

    Args:
        outgoing: called with (data, peer) for all sent bytes.
        replay: whether the link behaves as a recording.
    """

    def __init__(
        self,
        name: str = "memory",
        *,
        outgoing: Callable[[bytes, Peer], None] | None = None,
        replay: bool = False,
        forward: bool = False,
    ) -> None:
        super().__init__(name, f"memory://{name}", forward=forward)
        self.replay = replay
        self._outgoing = outgoing
        self._link_writer = LinkWriter(None, self._write, self._counts, self.faults, lambda: self.now_s())

    def inject(self, data: bytes, peer: Peer | str = "peer") -> None:
        """Simulates the arrival of bytes from `peer`."""
        if self._state != "open":
            return
        name = peer if isinstance(peer, str) else peer.name
        known = self._peers.get(name)
        if known is None:
            known = self._peers[name] = Peer(name) if isinstance(peer, str) else peer
        self._received(data, known)

    def drop_peer(self, name: str) -> None:
        """Simulates the loss of a peer."""
        self._forget(self._peers[name])

    def _open(self) -> None:
        self._opened()

    def _close(self) -> None:
        return

    def _writer(self, peer: Peer) -> LinkWriter | None:
        return self._link_writer

    def _write(self, data: bytes, peer: Peer) -> int:
        if self._outgoing is not None:
            self._outgoing(data, peer)
        return len(data)
