"""A UDP relay between one simulated vehicle and the server that loses datagrams in both directions, or is
slow towards the server."""

from __future__ import annotations

import contextlib
import math
import random
import selectors
import socket
import threading
import time
from collections import Counter, deque
from collections.abc import Generator

LARGEST_DATAGRAM = 2048
LONGEST_QUEUE_S = 0.5
"""A slow link loses what would wait longer than this [s]."""


class SlowLink:
    """Lets datagrams through at a rate, and counts the bytes of each MAVLink message that it let through.

    Args:
        bytes_s: rate [byte/s].
    """

    def __init__(self, bytes_s: float) -> None:
        self._bytes_s = bytes_s
        self._free_s = 0.0
        self._waiting: deque[tuple[float, bytes]] = deque()
        self.sent_bytes: Counter[int] = Counter()
        """By message id."""

    def put(self, data: bytes, now_s: float) -> None:
        """Takes a datagram, unless the queue is full."""
        if self._free_s - now_s < LONGEST_QUEUE_S:
            self._free_s = max(self._free_s, now_s) + len(data) / self._bytes_s
            self._waiting.append((self._free_s, data))

    def arrived(self, now_s: float) -> list[bytes]:
        """Removes what has arrived."""
        arrived: list[bytes] = []
        while self._waiting and self._waiting[0][0] <= now_s:
            arrived.append(self._waiting.popleft()[1])
        for data in arrived:
            start = 0
            while start + 10 <= len(data):  # a datagram has one or more unsigned MAVLink 2 frames
                size = data[start + 1] + 12
                self.sent_bytes[int.from_bytes(data[start + 7 : start + 10], "little")] += size
                start += size
        return arrived

    def wait_s(self, now_s: float) -> float:
        """How long until the next datagram arrives, at most 0.1 s."""
        return min(0.1, max(0.0, self._waiting[0][0] - now_s)) if self._waiting else 0.1


@contextlib.contextmanager
def lossy_relay(server_port: int, loss: float, seed: int, link: SlowLink | None = None) -> Generator[int]:
    """Yields the port to which the vehicle sends.

    Args:
        server_port: UDP port of the server.
        loss: share of the datagrams that are lost, in each direction.
        seed: seed of the losses.
        link: the link towards the server; None: as fast as this machine.
    """
    rng, running = random.Random(seed), True
    link = link or SlowLink(math.inf)
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
                for data in link.arrived(time.monotonic()):
                    server_side.sendto(data, ("127.0.0.1", server_port))
                for key, _ in selector.select(link.wait_s(time.monotonic())):
                    with contextlib.suppress(OSError):
                        if key.fileobj is vehicle_side:
                            data, vehicle = vehicle_side.recvfrom(LARGEST_DATAGRAM)
                            if rng.random() >= loss:
                                link.put(data, time.monotonic())
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
