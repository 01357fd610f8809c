"""Hostile clients: `python -m tests.hostile.clients ATTACK HOST:PORT` prints the statuses of the
responses."""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
from collections.abc import Awaitable, Callable

API = "/api/v1"
CHUNK = b"x" * 65536
IDLE_S = 8.0
"""How long the idle connections stay open."""
Statuses = set[int]


async def send_request(
    host: str, port: int, pieces: list[bytes], repeat: int = 0, *, wait_s: float = 20.0
) -> int:
    """Sends a request as bytes and repeats its last piece; returns the status of the response, 0 without a
    response."""
    with contextlib.suppress(OSError, asyncio.IncompleteReadError, TimeoutError):
        reader, writer = await asyncio.open_connection(host, port)
        try:
            with contextlib.suppress(OSError):
                for piece in [*pieces, *([pieces[-1]] * repeat)]:
                    writer.write(piece)
                    await asyncio.wait_for(writer.drain(), wait_s)  # noqa: TID251 an attacker, not the server
            async with asyncio.timeout(wait_s):
                line = await reader.readline()
            return int(line.split()[1]) if line.startswith(b"HTTP/") else 0
        finally:
            writer.close()
    return 0


def post(path: str, headers: str, body: bytes = b"") -> bytes:
    """The bytes of a POST request."""
    head = f"POST {API}{path} HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n{headers}\r\n"
    return head.encode() + body


async def large_bodies(host: str, port: int) -> Statuses:
    """Bodies of several megabytes: with Content-Length, in chunks, as one deeply nested or very wide JSON
    value."""
    wide_json = json.dumps({f"k{n}": n for n in range(250_000)}).encode()
    deep_json = b"[" * 400_000
    path = "/vehicles/101/offboard/setpoint"
    attempts = [
        send_request(host, port, [post(path, f"Content-Length: {len(body)}\r\n"), body])
        for body in (wide_json, deep_json, b"9" * 3_500_000)
    ]
    attempts.append(send_request(host, port, [post(path, "Content-Length: 100000000\r\n"), CHUNK], 1500))
    chunk = b"10000\r\n" + CHUNK + b"\r\n"
    attempts.append(send_request(host, port, [post(path, "Transfer-Encoding: chunked\r\n"), chunk], 1500))
    return set(await asyncio.gather(*attempts))


async def endless_headers(host: str, port: int) -> Statuses:
    """A very long header, a very large number of headers, and a very long address."""
    request_start = f"GET {API}/vehicles".encode()
    request_end = b" HTTP/1.1\r\nHost: 127.0.0.1\r\n"
    return set(
        await asyncio.gather(
            send_request(host, port, [request_start + request_end + b"X-Long: ", CHUNK], 3000),
            send_request(host, port, [request_start + request_end, b"X-Many: 1\r\n" * 6000], 500),
            send_request(host, port, [request_start + b"?", CHUNK], 3000),
        )
    )


async def idle_connections(host: str, port: int) -> Statuses:
    """1100 connections; half of them send nothing, the others one byte."""
    writers: list[asyncio.StreamWriter] = []
    for n in range(1100):
        with contextlib.suppress(OSError):
            _, writer = await asyncio.open_connection(host, port)
            writers.append(writer)
            if n % 2:
                writer.write(b"G")
    await asyncio.sleep(IDLE_S)
    for writer in writers:
        writer.close()
    return set()


async def unread_replies(host: str, port: int) -> Statuses:
    """WebSockets that send invalid messages and never read the replies."""
    websocket_headers = "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n"
    upgrade = f"Host: 127.0.0.1\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n{websocket_headers}\r\n"
    invalid_message = b"\x81\xfe\x00\x80\0\0\0\0" + b"{" * 128  # a masked text message
    statuses: Statuses = set()
    for path in ("/telemetry", "/vehicles/101/offboard/stream"):
        for _ in range(4):
            request = f"GET {API}{path} HTTP/1.1\r\n{upgrade}".encode()
            statuses.add(await send_request(host, port, [request, invalid_message * 400], 2000, wait_s=4.0))
    return statuses


async def control_requests(host: str, port: int) -> Statuses:
    """A thousand requests for control and two thousand commands, each from a different client."""
    statuses: Statuses = set()

    async def send_as_stranger(n: int) -> None:
        body = json.dumps({"reason": "now" * 50}).encode()
        path = ("/vehicles/101/control/request", "/vehicles/101/arm", "/vehicles/101/takeoff")[n % 3]
        request_headers = f"X-Client-Id: stranger-{n}\r\nContent-Length: {len(body)}\r\nConnection: close\r\n"
        statuses.add(await send_request(host, port, [post(path, request_headers, body)]))

    for start in range(0, 3000, 20):
        await asyncio.gather(*(send_as_stranger(n) for n in range(start, start + 20)))
    return statuses


async def invalid_http(host: str, port: int) -> Statuses:
    """Bytes that are not HTTP, invalid requests, and 500 requests at once."""
    requests = [
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + CHUNK,
        b"GET / HTTP/9.9\r\n\r\n",
        b"\0" * 1000 + b"\r\n\r\n",
        b"GET /\xff\xfe%00%zz HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
        post("/vehicles/101/arm", "Content-Length: -5\r\n"),
        post("/vehicles/101/arm", "Content-Length: 5\r\nTransfer-Encoding: chunked\r\n", b"zz\r\n"),
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" * 500,
    ]
    statuses: Statuses = set()
    for _ in range(30):
        statuses |= set(
            await asyncio.gather(*(send_request(host, port, [request], wait_s=3.0) for request in requests))
        )
    return statuses


Attack = Callable[[str, int], Awaitable[Statuses]]
ATTACKS: dict[str, Attack] = {
    f.__name__: f
    for f in (
        large_bodies,
        endless_headers,
        idle_connections,
        unread_replies,
        control_requests,
        invalid_http,
    )
}


def main(name: str, address: str) -> None:
    """Runs one attack and prints the statuses of its responses."""
    host, _, port = address.rpartition(":")

    async def run() -> Statuses:
        return await ATTACKS[name](host, int(port))

    print(*sorted(asyncio.run(run())))


if __name__ == "__main__":
    main(*sys.argv[1:])
