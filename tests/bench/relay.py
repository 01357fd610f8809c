"""A wire tap between a simulated vehicle and the server: passes datagrams on, notes when setpoints pass."""

from __future__ import annotations

import contextlib
import selectors
import socket
import threading
import time

SET_POSITION_TARGET_LOCAL_NED = 84


class Relay:
    """Vehicle → `vehicle_port` → server's `server_port`, and back; runs in a thread of its own."""

    def __init__(self, server_port: int) -> None:
        self._vehicle_side = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._vehicle_side.bind(("127.0.0.1", 0))
        self._server_side = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._server_side.bind(("127.0.0.1", 0))
        self._server = ("127.0.0.1", server_port)
        self._vehicle: tuple[str, int] | None = None
        self._running = True
        self.vehicle_port: int = self._vehicle_side.getsockname()[1]
        self.setpoints: list[tuple[float, bytes]] = []
        """(monotonic arrival time [s], frame) of each setpoint on its way to the vehicle."""
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Relay:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._running = False
        self._thread.join(2)
        self._vehicle_side.close()
        self._server_side.close()

    def _run(self) -> None:
        with selectors.DefaultSelector() as selector:
            selector.register(self._vehicle_side, selectors.EVENT_READ)
            selector.register(self._server_side, selectors.EVENT_READ)
            while self._running:
                for key, _ in selector.select(0.1):
                    with contextlib.suppress(OSError):
                        self._pass_on(key.fileobj is self._server_side)

    def _pass_on(self, from_server: bool) -> None:
        if from_server:
            data = self._server_side.recv(2048)
            if data[:1] == b"\xfd" and int.from_bytes(data[7:10], "little") == SET_POSITION_TARGET_LOCAL_NED:
                self.setpoints.append((time.monotonic(), data))
            if self._vehicle is not None:
                self._vehicle_side.sendto(data, self._vehicle)
        else:
            data, self._vehicle = self._vehicle_side.recvfrom(2048)
            self._server_side.sendto(data, self._server)
