"""UDP links: `udpin` listens and sends to peers from which it received data; `udpout` sends first."""

from __future__ import annotations

import asyncio
import errno
import socket
from time import monotonic

from gcs_server.links.base import Peer
from gcs_server.links.channel import MAX_READ_S, LinkReader
from gcs_server.links.host import Address, HostLink
from gcs_server.links.writer import LinkWriter

FORGET_AFTER_S = 30.0
"""Time without bytes after which a peer is removed [s]."""
MAX_PEERS = 256
EVICT_AFTER_S = 5.0
"""If there are MAX_PEERS peers, a new peer replaces one that sent nothing for this long [s]; if there is
none, the new peer is ignored."""
EVICT_RETRY_S = 0.25
"""Time until a full link searches again for a peer to replace [s]."""
DATAGRAMS_PER_WAKE = 4000
RECEIVE_BUFFER_BYTES = 4_000_000
MAX_DATAGRAM_BYTES = 65536
SEND_BUFFER_BYTES = 32_768
"""About 80 datagrams. The buffer is small because data in the buffer of a blocked interface (Wi-Fi retries)
cannot expire."""


class UdpLink(HostLink):
    """One socket for all peers.

    Args:
        host: address to listen on, or to send to.
        outgoing: whether the link sends first to `host:port`, from a port chosen by the system.
    """

    def __init__(
        self, name: str, url: str, host: str, port: int, *, outgoing: bool, forward: bool = False
    ) -> None:
        super().__init__(name, url, host, port, forward=forward)
        self._outgoing = outgoing
        self._reader: LinkReader | None = None
        self._socket_writer: LinkWriter | None = None
        self._by_address: dict[Address, Peer] = {}
        self._last_received_s: dict[str, float] = {}
        self._fixed_peer: str | None = None
        """Name of the peer of an outgoing link, which is never removed."""
        self._full_until_s = float("-inf")
        self._sweep_timer: asyncio.TimerHandle | None = None

    def datagram_socket(self) -> socket.socket | None:
        return self._socket

    def _open_socket(self, address: Address) -> None:
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            sock.setblocking(False)
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
            if not self._outgoing:
                sock.bind(address)
        except OSError as error:
            sock.close()
            self._lost(self._explain(error))
            return
        self._socket = sock
        self._socket_writer = LinkWriter(
            self._loop,
            lambda data, peer: self._write(sock, data, peer),
            self._counts,
            self.faults,
            self.now_s,
        )
        self._reader = LinkReader(self._loop, sock.fileno(), self._read_available, self.faults)
        if self._outgoing:
            self._fixed_peer = self._new_peer(address).name
        self._sweep_timer = self._loop.call_later(FORGET_AFTER_S / 4, self._forget_inactive_peers)
        self._opened()

    def _explain(self, error: OSError) -> str:
        if error.errno == errno.EADDRINUSE:
            return (
                f"UDP port {self._port} on {self._host} is taken by another program "
                "(another ground station?). Close it, or choose another port; the server tries again."
            )
        if error.errno == errno.EADDRNOTAVAIL:
            return (
                f"This machine has no address {self._host}. "
                "Use 127.0.0.1, 0.0.0.0 or an address of this machine."
            )
        if error.errno == errno.EACCES:
            return f"UDP port {self._port} may not be used by this user. Choose one above 1023."
        return super()._explain(error)

    def _read_available(self) -> int:
        sock, count, size_bytes, now_s = self._socket, 0, 0, self._loop.time()
        by_address, last_received_s, on_bytes = self._by_address, self._last_received_s, self._on_bytes
        end_s = now_s + MAX_READ_S
        for _ in range(DATAGRAMS_PER_WAKE):
            if sock is None or self._socket is not sock:  # the handler of a datagram closed the link
                break
            if monotonic() > end_s:  # the clock of the event loop, read at half the cost
                break
            try:
                data, address = sock.recvfrom(MAX_DATAGRAM_BYTES)
            except BlockingIOError:
                break
            except ConnectionError:  # no receiver for an earlier datagram of this server; reading continues
                continue
            except OSError as error:
                self._lost(self._explain(error))
                break
            count += 1
            peer = by_address.get(address) or self._add_peer(address, now_s)
            if peer is None:
                continue
            last_received_s[peer.name] = now_s
            size_bytes += len(data)
            try:  # like `_received`, without a call for each datagram
                on_bytes(data, peer, now_s)
            except Exception as error:
                self.faults.add(error, "handling received bytes")
        self._bytes_received += size_bytes
        return count

    def _add_peer(self, address: Address, now_s: float) -> Peer | None:
        """Adds a new peer; None if there are too many already."""
        if len(self._peers) < MAX_PEERS:
            return self._new_peer(address)
        if now_s < self._full_until_s:
            return None
        least_active = min(
            (n for n in self._last_received_s if n != self._fixed_peer), key=self._last_received_s.__getitem__
        )
        if now_s - self._last_received_s[least_active] > EVICT_AFTER_S:
            self._forget_peer(least_active)
            return self._new_peer(address)
        self._full_until_s = now_s + EVICT_RETRY_S
        self._set_state("open", f"{MAX_PEERS} addresses send on this link; further addresses are ignored.")
        return None

    def _new_peer(self, address: Address) -> Peer:
        peer = Peer(f"{address[0]}:{address[1]}", address)
        self._by_address[address] = peer
        self._peers[peer.name] = peer
        self._last_received_s[peer.name] = self._loop.time()
        self._changed()
        return peer

    def _forget_peer(self, name: str) -> None:
        peer = self._peers[name]
        if peer.address is not None:
            self._by_address.pop(peer.address, None)
        self._last_received_s.pop(name, None)
        self._forget(peer)

    def _forget_inactive_peers(self) -> None:
        self._sweep_timer = self._loop.call_later(FORGET_AFTER_S / 4, self._forget_inactive_peers)
        before_s = self._loop.time() - FORGET_AFTER_S
        if self._loop.time() > self._full_until_s + FORGET_AFTER_S:
            self._set_state("open", "")
        for name in [
            n
            for n, last_received_s in self._last_received_s.items()
            if last_received_s < before_s and n != self._fixed_peer
        ]:
            self._forget_peer(name)

    def _writer(self, peer: Peer) -> LinkWriter | None:
        return None if peer.address is None else self._socket_writer

    def _write(self, sock: socket.socket, data: bytes, peer: Peer) -> int:
        assert peer.address is not None
        try:
            return sock.sendto(data, peer.address)
        except OSError as error:
            if error.errno == errno.ENOBUFS:  # the interface's queue is full; handled like a blocked socket
                raise BlockingIOError from error
            raise

    def _close(self) -> None:
        if self._sweep_timer is not None:
            self._sweep_timer.cancel()
        if self._reader is not None:
            self._reader.close()
            self._reader = None
        if self._socket_writer is not None:
            self._socket_writer.close()
            self._socket_writer = None
        sock, self._socket = self._socket, None
        if sock is not None:
            sock.close()
        self._by_address.clear()
        self._last_received_s.clear()
        self._fixed_peer = None
