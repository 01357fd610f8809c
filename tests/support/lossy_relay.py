"""A UDP relay between one simulated vehicle and the server that loses datagrams in both directions."""

from __future__ import annotations

import contextlib
import random
import selectors
import socket
import threading
from collections.abc import Generator

LARGEST_DATAGRAM = 2048


@contextlib.contextmanager
def lossy_relay(server_port: int, loss: float, seed: int) -> Generator[int]:
    """Yields the port to which the vehicle sends.

    Args:
        server_port: UDP port of the server.
        loss: share of the datagrams that are lost, in each direction.
        seed: seed of the losses.
    """
    rng, running = random.Random(seed), True
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle_side,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server_side,
        selectors.DefaultSelector() as selector,
    ):
        for side in (vehicle_side, server_side):
            side.bind(("127.0.0.1", 0))
            selector.register(side, selectors.EVENT_READ)

        def run() -> None:
            vehicle = None
            while running:
                for key, _ in selector.select(0.1):
                    with contextlib.suppress(OSError):
                        if key.fileobj is vehicle_side:
                            data, vehicle = vehicle_side.recvfrom(LARGEST_DATAGRAM)
                            if rng.random() >= loss:
                                server_side.sendto(data, ("127.0.0.1", server_port))
                        else:
                            data = server_side.recv(LARGEST_DATAGRAM)
                            if vehicle is not None and rng.random() >= loss:
                                vehicle_side.sendto(data, vehicle)

        thread = threading.Thread(target=run, daemon=True)
        thread.start()
        try:
            yield vehicle_side.getsockname()[1]
        finally:
            running = False
            thread.join(2)
