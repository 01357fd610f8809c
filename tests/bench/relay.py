"""A relay between simulated vehicles and a station that records the arrival times of setpoints."""

from __future__ import annotations

import contextlib
import selectors
import socket
import struct
import threading
import time

SETPOINT_IDS = (82, 84, 86)
"""SET_ATTITUDE_TARGET, SET_POSITION_TARGET_LOCAL_NED and _GLOBAL_INT."""
LOCAL_NED = 84
LOCAL_TARGET_OFFSET = 10 + 50
"""Offset of target_system in a frame of SET_POSITION_TARGET_LOCAL_NED."""

SO_TIMESTAMPNS = 35
"""The kernel records each arrival, so the times are correct even if the relay waits for the CPU."""
TIMESPEC = struct.Struct("@qq")

Arrival = tuple[float, bytes]
"""Monotonic arrival time [s], frame."""


class Relay:
    """Vehicles → `vehicle_port` → station's `server_port`, and back; runs in a thread of its own.

    Each vehicle has its own socket to the station, so that the station sees each vehicle as a peer.
    """

    def __init__(self, server_port: int) -> None:
        self._vehicle_socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._vehicle_socket.bind(("127.0.0.1", 0))
        self._server = ("127.0.0.1", server_port)
        self._server_sockets: dict[tuple[str, int], socket.socket] = {}
        self._vehicles: dict[socket.socket, tuple[str, int]] = {}
        self._running = True
        self._epoch_s = time.clock_gettime(time.CLOCK_REALTIME) - time.monotonic()
        """Unix time of the monotonic clock's zero: the kernel's timestamps are Unix times."""
        self._selector = selectors.DefaultSelector()
        self.vehicle_port: int = self._vehicle_socket.getsockname()[1]
        self.setpoints: list[Arrival] = []
        """Every setpoint sent to a vehicle."""
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Relay:
        self._selector.register(self._vehicle_socket, selectors.EVENT_READ)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._running = False
        self._thread.join(2)
        self._selector.close()
        for each in (self._vehicle_socket, *self._server_sockets.values()):
            each.close()

    def arrivals_s(self) -> dict[int, list[float]]:
        """Arrival times of the local setpoints so far, by target system."""
        by_vehicle: dict[int, list[float]] = {}
        for arrival_s, frame in self.setpoints:
            if int.from_bytes(frame[7:10], "little") == LOCAL_NED:
                by_vehicle.setdefault(frame[LOCAL_TARGET_OFFSET], []).append(arrival_s)
        return by_vehicle

    def streams_s(self) -> list[list[float]]:
        """Arrival times of the setpoints of each vehicle."""
        return list(self.arrivals_s().values())

    def sent_at_s(self, north_m: float) -> float | None:
        """Arrival time of the first local setpoint with this position."""
        expected_north = struct.pack("<f", north_m)
        for arrival_s, frame in self.setpoints:
            if int.from_bytes(frame[7:10], "little") == LOCAL_NED and frame[14:18] == expected_north:
                return arrival_s
        return None

    def clear(self) -> None:
        """Deletes the recorded setpoints."""
        self.setpoints.clear()

    def _run(self) -> None:
        while self._running:
            for key, _ in self._selector.select(0.1):
                with contextlib.suppress(OSError):
                    if key.fileobj is self._vehicle_socket:
                        self._forward_to_server()
                    else:
                        assert isinstance(key.fileobj, socket.socket)
                        self._forward_to_vehicle(key.fileobj)

    def _forward_to_server(self) -> None:
        data, vehicle = self._vehicle_socket.recvfrom(2048)
        server_socket = self._server_sockets.get(vehicle)
        if server_socket is None:
            server_socket = self._server_sockets[vehicle] = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            server_socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
            server_socket.bind(("127.0.0.1", 0))
            self._vehicles[server_socket] = vehicle
            self._selector.register(server_socket, selectors.EVENT_READ)
        server_socket.sendto(data, self._server)

    def _forward_to_vehicle(self, server_socket: socket.socket) -> None:
        data, timestamps, _, _ = server_socket.recvmsg(2048, socket.CMSG_SPACE(TIMESPEC.size))
        if data[:1] == b"\xfd" and int.from_bytes(data[7:10], "little") in SETPOINT_IDS:
            seconds, nanoseconds = TIMESPEC.unpack(timestamps[0][2])
            self.setpoints.append((seconds + nanoseconds * 1e-9 - self._epoch_s, data))
        self._vehicle_socket.sendto(data, self._vehicles[server_socket])
