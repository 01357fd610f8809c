"""Hostile clients: `python -m tests.hostile.clients ATTACK HOST:PORT` prints the statuses of the
responses."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import sys
import time
from collections.abc import Awaitable, Callable

API = "/api/v1"
CHUNK = b"x" * 65536
IDLE_S = 8.0
"""How long the idle connections stay open."""
DOCUMENTS_S = 20.0
"""How long documents are sent."""
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


async def documents(host: str, port: int) -> Statuses:
    """64 connections of one client that send the largest plans, files and dry runs again and again."""
    requests = _document_requests()
    statuses: Statuses = set()
    end_s = time.monotonic() + DOCUMENTS_S

    async def send_in_turn(first: int) -> None:
        for request in itertools.islice(itertools.cycle(requests), first, None):
            if time.monotonic() > end_s:
                return
            statuses.add(await send_request(host, port, [request], wait_s=60.0))

    await asyncio.gather(*(send_in_turn(n) for n in range(64)))
    return statuses


def _document_requests() -> list[bytes]:
    at_20_m = {"altitude": {"value_m": 20, "reference": "home"}}
    items = [{"kind": "waypoint", "lat_deg": 47.4, "lon_deg": 8.5 + 1e-6 * n, **at_20_m} for n in range(9000)]
    home = {"lat_deg": 47.4, "lon_deg": 8.5, "alt_amsl_m": 488}
    plan = json.dumps({"planned_home": home, "items": items}, separators=(",", ":"))
    points = [{"offset_ned_m": [n % 50, n % 40, -10 - n % 7]} for n in range(6000)]
    steps = [
        {"step": "take_off", "height_m": 9},
        *({"step": "fly", "points": points[n : n + 50]} for n in range(0, 6000, 50)),
    ]
    mission = json.dumps(
        {"format": "offboard-gcs-mission", "name": "Long", "steps": steps}, separators=(",", ":")
    )
    line = {"type": "LineString", "coordinates": [[8.5 + 1e-6 * n, 47.4, 20] for n in range(9000)]}
    geojson = json.dumps({"type": "Feature", "properties": {}, "geometry": line})
    path = {"type": "path", "points": [{"t_s": n / 10, "position_ned_m": [n, n, -10]} for n in range(5000)]}
    bodies = [
        ("/plans/check", f'{{"plan":{plan},"vehicle":"101"}}'),
        ("/plans/check", f'{{"plan":{mission}}}'),
        ("/plans/check", f'{{"plan":{plan.replace("waypoint", "waypoints")}}}'),
        ("/plans", f'{{"name":"Hostile","plan":{plan}}}'),
        ("/plans/export?format=kml", f'{{"plan":{plan}}}'),
        ("/plans/convert", f'{{"name":"Hostile","plan":{plan}}}'),
        ("/plans/import?filename=a.geojson&altitude_m=20&altitude_reference=home", geojson),
        ("/dry_runs", f'{{"plan":{plan},"flights":20}}'),
        ("/vehicles/101/mission/upload", f'{{"plan":{plan}}}'),
        ("/vehicles/101/mission/compare", f'{{"plan":{plan}}}'),
        ("/vehicles/101/offboard_mission/start", f'{{"mission":{mission}}}'),
        ("/vehicles/101/offboard/setpoint", json.dumps({"setpoint": path})),
        ("/plans/check", json.dumps({f"k{n}": "x" * 900 for n in range(1000)})),
    ]
    headers = "X-Client-Id: hostile\r\nConnection: close\r\nContent-Length: "
    return [post(where, f"{headers}{len(body.encode())}\r\n", body.encode()) for where, body in bodies]


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
        documents,
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
