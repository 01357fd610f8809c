"""Telemetry clients that watch everything: `python -m tests.bench.watchers URL CLIENTS SECONDS`."""

from __future__ import annotations

import asyncio
import sys

from gcs_server.client import Gcs

RATE_HZ = 20.0


async def watch(url: str, number: int) -> int:
    """Reads all samples of all vehicles until it is cancelled."""
    samples = 0
    async with Gcs(url, client=f"watcher {number}") as gcs:
        async for _ in gcs.telemetry(rate_hz=RATE_HZ):
            samples += 1
    return samples


async def main(url: str, clients: int, seconds: float) -> None:
    """Runs all clients for this time."""
    try:
        async with asyncio.timeout(seconds), asyncio.TaskGroup() as group:
            for number in range(clients):
                group.create_task(watch(url, number))
    except TimeoutError:
        return


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], int(sys.argv[2]), float(sys.argv[3])))
