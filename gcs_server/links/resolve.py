"""Resolves host names without blocking the event loop."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable

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
