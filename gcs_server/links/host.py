"""Links that connect to, send to or listen on a host and port."""

from __future__ import annotations

import socket
from abc import abstractmethod

from gcs_server.links.base import Link
from gcs_server.links.resolve import Address, resolve


class HostLink(Link):
    """A link with one socket, which is opened once the host's name is resolved.

    Args:
        host: address to listen on, or to connect or send to.
        port: port on that host.
    """

    def __init__(self, name: str, url: str, host: str, port: int, *, forward: bool = False) -> None:
        super().__init__(name, url, forward=forward)
        self._host, self._port = host, port
        self._socket: socket.socket | None = None

    @property
    def local_port(self) -> int | None:
        """The port in use, if the link is open."""
        return self._socket.getsockname()[1] if self._socket else None

    def _open(self) -> None:
        def on_address(address: Address) -> None:
            if self._should_be_open and self._socket is None:
                self._run_opening_step(self._open_socket, address)

        resolve(self._loop, self._host, self._port, on_address, self._lost)

    @abstractmethod
    def _open_socket(self, address: Address) -> None:
        """Opens the socket; may raise OSError."""
