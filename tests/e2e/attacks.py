"""Attacks on a server by a client: `python -m tests.e2e.attacks PORT PID ATTACK`, where PID is the server's
process id."""

from __future__ import annotations

import base64
import contextlib
import os
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from pathlib import Path

HOST = "127.0.0.1"
GET_REQUEST = b"GET /api/v1/health HTTP/1.1\r\nHost: localhost\r\n"
POST_REQUEST = (
    b"POST /api/v1/vehicles/1/takeoff HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
)


@dataclass
class Target:
    """The server under attack."""

    port: int
    pid: int
    connections: list[socket.socket] = field(default_factory=list[socket.socket])

    def connect(self, timeout_s: float = 5.0) -> socket.socket:
        """Opens a connection that stays open until the attack ends."""
        connection = socket.create_connection((HOST, self.port), timeout=timeout_s)
        self.connections.append(connection)
        return connection

    def send(self, connection: socket.socket, data: bytes, times: int = 1) -> int:
        """Sends data `times` times, or until the server stops reading; returns the number of bytes sent."""
        sent = 0
        with contextlib.suppress(OSError):
            for _ in range(times):
                connection.sendall(data)
                sent += len(data)
        return sent

    def websocket(self, path: str = "/api/v1/telemetry?client_id=hostile") -> socket.socket:
        """Requests a WebSocket; returns its connection without waiting for the server's reply."""
        connection = self.connect()
        key = base64.b64encode(os.urandom(16))
        connection.sendall(
            b"GET %s HTTP/1.1\r\nHost: localhost\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
            b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: %s\r\n\r\n" % (path.encode(), key)
        )
        return connection

    def close_connections(self) -> None:
        """Closes all connections of the attack."""
        for connection in self.connections:
            connection.close()
        self.connections.clear()

    def memory_mb(self) -> float:
        """Resident memory of the server's process [MB]."""
        for line in Path(f"/proc/{self.pid}/status").read_text().splitlines():
            if line.startswith("VmRSS:"):
                return int(line.split()[1]) / 1000
        raise OSError("the server has ended")


def websocket_frame(payload: bytes, opcode: int = 1, *, final: bool = True) -> bytes:
    """A masked WebSocket frame."""
    size = len(payload)
    head = bytes([opcode | (0x80 if final else 0)])
    if size < 126:
        head += bytes([0x80 | size])
    elif size < 65536:
        head += struct.pack("!BH", 0x80 | 126, size)
    else:
        head += struct.pack("!BQ", 0x80 | 127, size)
    return head + bytes(4) + payload  # masked with zeros


def read_response(connection: socket.socket, timeout_s: float = 5.0) -> bytes:
    """Everything that the server sends until it closes the connection or stops sending."""
    connection.settimeout(timeout_s)
    response = b""
    with contextlib.suppress(OSError):
        while received := connection.recv(65536):
            response += received
    return response


# --- the attacks ------------------------------------------------------------------------------------


def idle_sockets(target: Target) -> None:
    for _ in range(1500):
        with contextlib.suppress(OSError):
            target.connect()


def huge_headers(target: Target) -> None:
    for _ in range(4):
        connection = target.connect()
        target.send(connection, GET_REQUEST + b"x: ")
        target.send(connection, b"a" * 1_000_000, 50)


def many_headers(target: Target) -> None:
    for _ in range(4):
        connection = target.connect()
        target.send(connection, GET_REQUEST)
        target.send(connection, b"x:y\r\n" * 200_000, 20)


def huge_url(target: Target) -> None:
    for _ in range(4):
        connection = target.connect()
        target.send(connection, b"GET /")
        target.send(connection, b"a" * 1_000_000, 50)


def huge_bodies(target: Target) -> None:
    for _ in range(4):
        connection = target.connect()
        target.send(connection, POST_REQUEST + b"Content-Length: 100000000\r\n\r\n")
        target.send(connection, b"[" * 1_000_000, 25)


def huge_chunked_bodies(target: Target) -> None:
    for _ in range(4):
        connection = target.connect()
        target.send(connection, POST_REQUEST + b"Transfer-Encoding: chunked\r\n\r\n")
        target.send(connection, b"f4240\r\n" + b"[" * 1_000_000 + b"\r\n", 25)


def tiny_chunks(target: Target) -> None:
    for _ in range(4):
        connection = target.connect()
        target.send(connection, POST_REQUEST + b"Transfer-Encoding: chunked\r\n\r\n")
        target.send(connection, b"1\r\n[\r\n" * 100_000, 20)


def largest_json(target: Target) -> None:
    bodies = [
        b"{" + b",".join(b'"k%d":1' % n for n in range(80_000)) + b"}",
        b"[" * 1_000_000,
        b"[" + b"{}," * 300_000 + b"{}]",
        b'{"alt_home_m": ' + b"9" * 1_000_000 + b"}",
        b'{"alt_home_m": "' + b"," * 1_000_000 + b'"}',
        b'{"setpoint":{"type":"path","points":[' + b",".join([b'{"t":0,"a":[0,0,0]}'] * 5000) + b"]}}",
    ]
    for _ in range(5):
        for body in bodies:
            connection = target.connect()
            head = POST_REQUEST.replace(
                b"takeoff", b"offboard/setpoint"
            ) + b"Content-Length: %d\r\n\r\n" % len(body)
            target.send(connection, head + body)


def slow_bodies(target: Target) -> None:
    for _ in range(300):
        with contextlib.suppress(OSError):
            connection = target.connect()
            target.send(connection, POST_REQUEST + b"Content-Length: 1000000\r\n\r\n" + b" " * 250_000)


def slow_headers(target: Target) -> None:
    connections = [target.connect() for _ in range(50)]
    for byte in b"x-slow: 1":
        for connection in connections:
            target.send(connection, bytes([byte]))
        time.sleep(0.2)


def malformed_requests(target: Target) -> None:
    for _ in range(1000):
        with contextlib.suppress(OSError):
            connection = target.connect()
            target.send(connection, os.urandom(200) + b"\r\n\r\n")
            connection.close()


def pipelined_requests(target: Target) -> None:
    for _ in range(4):
        connection = target.connect()
        target.send(connection, (GET_REQUEST + b"\r\n") * 20_000, 3)


def unread_responses(target: Target) -> None:
    for _ in range(100):
        connection = target.connect()
        target.send(connection, b"GET /api/v1/openapi.json HTTP/1.1\r\nHost: localhost\r\n\r\n" * 6)


def unread_websocket(target: Target) -> None:
    for _ in range(4):
        connection = target.websocket()
        time.sleep(0.1)
        target.send(
            connection, websocket_frame(b'{"type":"subscribe","topics":["' + b"x" * 60_000 + b'"]}'), 200
        )


def unread_offboard(target: Target) -> None:
    for _ in range(4):
        connection = target.websocket("/api/v1/vehicles/1/offboard/stream?client_id=hostile")
        time.sleep(0.1)
        target.send(connection, websocket_frame(b'{"' + b"x" * 500_000 + b'":1}'), 40)


def tiny_frames(target: Target) -> None:
    for opcode in (1, 9, 10):
        connection = target.websocket()
        time.sleep(0.1)
        target.send(connection, websocket_frame(b"", opcode) * 40_000, 5)


def empty_fragments(target: Target) -> None:
    connection = target.websocket()
    time.sleep(0.1)
    target.send(
        connection, websocket_frame(b"x", 1, final=False) + websocket_frame(b"", 0, final=False) * 100_000, 5
    )


def many_websockets(target: Target) -> None:
    for number in range(1500):
        with contextlib.suppress(OSError):
            target.websocket(f"/api/v1/telemetry?client_id=hostile{number}")


def request_flood(target: Target) -> None:
    connections = [target.connect() for _ in range(20)]
    end_s = time.monotonic() + 3.0
    while time.monotonic() < end_s:
        for connection in connections:
            target.send(connection, GET_REQUEST + b"\r\n")


ATTACKS: list[Callable[[Target], None]] = [
    idle_sockets,
    huge_headers,
    many_headers,
    huge_url,
    huge_bodies,
    huge_chunked_bodies,
    tiny_chunks,
    largest_json,
    slow_bodies,
    slow_headers,
    malformed_requests,
    pipelined_requests,
    unread_responses,
    unread_websocket,
    unread_offboard,
    tiny_frames,
    empty_fragments,
    many_websockets,
    request_flood,
]


# --- effects on other clients -----------------------------------------------------------------------


@dataclass
class Effects:
    """Effects of an attack on another client and on the server's memory."""

    longest_loop_delay_s: float = 0.0
    """Longest response time of a request on the connection that stays open, which shows the longest delay of
    the server's event loop."""
    served_count: int = 0
    """Number of requests on new connections with status 200."""
    failures: list[str] = field(default_factory=list[str])
    """The first bytes of each response on a new connection with another status."""
    memory_mb: float = 0.0
    """Largest increase of the resident memory of the server's process [MB]."""


@contextlib.contextmanager
def running_attack(target: Target, attack: str, headers: bytes = b"") -> Generator[Effects]:
    """Runs an attack in another process to its end, then the block. Measures the effects on another client
    during the attack and the block."""
    effects, stopped = Effects(), threading.Event()
    before_mb = target.memory_mb()
    request = b"GET /api/v1/me HTTP/1.1\r\nHost: localhost\r\n" + headers

    def measure_new_connections() -> None:
        while not stopped.is_set():
            with (
                contextlib.suppress(OSError),
                socket.create_connection((HOST, target.port), timeout=20) as connection,
            ):
                connection.sendall(request + b"Connection: close\r\n\r\n")
                response = read_response(connection, 20)
                if response.startswith(b"HTTP/1.1 200"):
                    effects.served_count += 1
                else:
                    effects.failures.append(response[:60].decode(errors="replace"))
                connection.close()
            stopped.wait(0.02)

    def measure_open_connection() -> None:
        connection = socket.create_connection((HOST, target.port), timeout=20)
        while not stopped.is_set():
            began_s = time.monotonic()
            try:
                connection.sendall(request + b"\r\n")
                if not connection.recv(65536):
                    raise ConnectionError
            except OSError:
                connection.close()
                connection = socket.create_connection((HOST, target.port), timeout=20)
                continue
            effects.longest_loop_delay_s = max(effects.longest_loop_delay_s, time.monotonic() - began_s)
            effects.memory_mb = max(effects.memory_mb, target.memory_mb() - before_mb)
            stopped.wait(0.01)
        connection.close()

    threads = [threading.Thread(target=task) for task in (measure_new_connections, measure_open_connection)]
    for thread in threads:
        thread.start()
    command = [sys.executable, "-m", "tests.e2e.attacks", str(target.port), str(target.pid), attack]
    try:
        subprocess.run(command, check=True, timeout=120)
        yield effects
    finally:
        stopped.set()
        for thread in threads:
            thread.join()


def main(port: str, pid: str, name: str) -> None:
    """Runs one attack and keeps its connections open for another second."""
    target = Target(int(port), int(pid))
    next(attack for attack in ATTACKS if attack.__name__ == name)(target)
    time.sleep(1.0)
    target.close_connections()


if __name__ == "__main__":
    main(*sys.argv[1:])
