"""Viewers who open large and damaged logs and plot, export and fly them again all at once:
`python -m tests.hostile.flights HOST:PORT` prints the statuses of the responses."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import random
import struct
import sys
import time

import httpx

VIEWERS = 12
VIEW_S = 20.0
"""How long the logs are viewed."""
ROWS = 400_000
FIELDS = 12
STEP_US = 2000
MAX_PART_BYTES = 1_000_000
MAGIC = b"ULog\x01\x12\x35\x01"


def message(letter: str, body: bytes) -> bytes:
    """A message of a ULog."""
    return struct.pack("<HB", len(body), ord(letter)) + body


def head(definition: str) -> bytes:
    """The start of a ULog with one topic."""
    topic = message("F", definition.encode()) + message("A", b"\0\0\0big")
    return MAGIC + struct.pack("<Q", 0) + message("B", bytes(40)) + topic


def large_log() -> bytes:
    """A healthy ULog of some 25 MB: noise at 500 Hz."""
    rng = random.Random(1)
    rows = [struct.pack(f"<{FIELDS}f", *(rng.gauss(0, 1) for _ in range(FIELDS))) for _ in range(997)]
    fields = "".join(f"float v{n};" for n in range(FIELDS))
    data = (message("D", struct.pack("<HQ", 0, n * STEP_US) + rows[n % 997]) for n in range(ROWS))
    return head(f"big:uint64_t timestamp;{fields}") + b"".join(data)


def damaged_logs() -> list[bytes]:
    """Logs that promise too much: huge arrays, a type that contains itself, only a head, and noise."""
    noise = random.Random(2).randbytes(3_000_000)
    return [
        head("big:uint64_t timestamp;float[60000] v;") + message("D", struct.pack("<HQ", 0, 1)) * 50_000,
        head("big:uint64_t timestamp;big again;") + message("D", struct.pack("<HQ", 0, 1)) * 50_000,
        head("big:uint64_t timestamp;float v;") + noise,
        MAGIC + noise,
        b"".join(message("D", noise[:60_000]) for _ in range(40)),
    ]


async def add(client: httpx.AsyncClient, name: str, log: bytes, statuses: set[int]) -> str | None:
    """Adds a log in parts; returns its id."""
    begun = await client.post("/flights/uploads", json={"name": name, "bytes": len(log)})
    statuses.add(begun.status_code)
    flight = None
    for offset in range(0, len(log), MAX_PART_BYTES):
        path = f"/flights/uploads/{begun.json()['id']}?offset_bytes={offset}"
        answer = await client.post(path, content=log[offset : offset + MAX_PART_BYTES])
        statuses.add(answer.status_code)
        flight = answer.json().get("flight")
    return flight


def requests_for(flight: str) -> list[tuple[str, str, dict[str, object] | None]]:
    """The most expensive requests about a log."""
    plots = "&".join(f"field=big:0/v{n % FIELDS}" for n in range(32))
    costly = "field=derivative(norm({big:0/v0}, {big:0/v1}, {big:0/v2}) ** 2)"
    rerun: dict[str, object] = {"from_s": 0, "duration_s": 20}
    return [
        ("GET", f"/flights/{flight}", None),
        ("GET", f"/flights/{flight}/series?points=10000&{plots}", None),
        ("GET", f"/flights/{flight}/series?points=10000&{costly}", None),
        ("GET", f"/flights/{flight}/spectrum?field=big:0/v3", None),
        ("GET", f"/flights/{flight}/loops", None),
        ("GET", f"/flights/{flight}/findings", None),
        ("GET", f"/flights/{flight}/table?topic=big:0&at_s=700", None),
        ("GET", f"/flights/{flight}/export?format=csv&topic=big:0", None),
        ("POST", f"/flights/{flight}/rerun", rerun),
        ("GET", "/flights", None),
    ]


async def view(client: httpx.AsyncClient, first: int, flights: list[str], statuses: set[int]) -> None:
    """Sends the requests in turn; half of the answers are left after their first bytes."""
    end_s = time.monotonic() + VIEW_S
    requests = [each for flight in flights for each in requests_for(flight)]
    for n, (method, path, body) in enumerate(itertools.islice(itertools.cycle(requests), first, None)):
        if time.monotonic() > end_s:
            return
        with contextlib.suppress(httpx.TransportError):
            async with client.stream(method, path, json=body) as answer:
                statuses.add(answer.status_code)
                async for _ in answer.aiter_bytes():
                    if n % 2:
                        break


async def attack(address: str) -> set[int]:
    """Adds the logs, then views all of them as many clients."""
    statuses: set[int] = set()
    async with contextlib.AsyncExitStack() as stack:
        clients = [
            await stack.enter_async_context(
                httpx.AsyncClient(
                    base_url=f"http://{address}/api/v1", timeout=60, headers={"X-Client-Id": f"viewer {n}"}
                )
            )
            for n in range(VIEWERS)
        ]
        logs = [large_log(), *damaged_logs()]
        added = [await add(clients[0], f"log {n}.ulg", log, statuses) for n, log in enumerate(logs)]
        flights = [flight for flight in added if flight]
        await asyncio.gather(*(view(client, 5 * n, flights, statuses) for n, client in enumerate(clients)))
    return statuses


if __name__ == "__main__":
    print(*sorted(asyncio.run(attack(sys.argv[1]))))
