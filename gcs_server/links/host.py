"""Links that connect to, send to or listen on a host and port."""

from __future__ import annotations

import asyncio
import socket
from abc import abstractmethod
from collections.abc import Callable

from gcs_server.links.base import Link

Address = tuple[str, int]


def resolve(
    loop: asyncio.AbstractEventLoop,
    host: str,
    port: int,
    on_address: Callable[[Address], None],
    on_failure: Callable[[str], None],
) -> None:
    """Resolves a host. Calls `on_address`, immediately for an IPv4 address and later for a name, or
    `on_failure` with a message.

    Args:
        on_address: must not raise, because no caller would handle the error.
    """
    try:
        socket.inet_pton(socket.AF_INET, host)
    except OSError:
        pass
    else:
        on_address((host, port))
        return

    def on_lookup_done(future: asyncio.Future[list[tuple[object, ...]]]) -> None:
        error = future.exception()
        if error is not None:
            on_failure(f"The host {host!r} is not known ({error}). Check its spelling and the network.")
        else:
            address = future.result()[0][4]
            assert isinstance(address, tuple)
            on_address((str(address[0]), port))

    look_up = loop.run_in_executor(None, _look_up, host, port)
    look_up.add_done_callback(on_lookup_done)


def _look_up(host: str, port: int) -> list[tuple[object, ...]]:
    return list(socket.getaddrinfo(host, port, socket.AF_INET))


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
