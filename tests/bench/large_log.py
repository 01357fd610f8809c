"""A ULog of 100 MB with an hour of flight: until its first plot, pan and zoom, memory of the processes that
read it, and how late the server's loop was meanwhile; beside pyulog alone on the same file."""

from __future__ import annotations

import asyncio
import os
import statistics
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gcs_server.logbook.work import LogWork

from .process import load_average, process_tree, resident_mb

DURATION_S = 3600
TOPICS = {  # rate [Hz], number of floats
    "sensor_combined": (200, 8),
    "vehicle_attitude": (100, 6),
    "actuator_motors": (100, 12),
    "vehicle_local_position": (50, 40),
}
FIELDS = ["sensor_combined:0/value[0]", "vehicle_local_position:0/value[3]"]
WINDOWS = {
    "the whole log": (None, None),
    "a seventh": (1000.0, 1000.0 + DURATION_S / 7),
    "10 s": (1800.0, 1810.0),
}
STEPS, POINTS = 15, 2000
PYULOG = """
import sys, time
from pyulog import ULog
began_s = time.monotonic()
ULog(sys.argv[1])
print(time.monotonic() - began_s)
"""


def _message(letter: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(letter)) + body


def write_log(path: Path) -> None:
    """Writes the log: topics with values of a random walk, in the order of time."""
    rng = np.random.default_rng(1)
    content = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1_000_000), _message("B", bytes(40))]
    for name, (_, floats) in TOPICS.items():
        content.append(_message("F", f"{name}:uint64_t timestamp;float[{floats}] value;".encode()))
    rows = []
    for number, (name, (rate_hz, floats)) in enumerate(TOPICS.items()):
        content.append(_message("A", struct.pack("<BH", 0, number) + name.encode()))
        count = rate_hz * DURATION_S
        record = np.dtype(
            [("size", "<u2"), ("D", "u1"), ("id", "<u2"), ("t_us", "<u8"), ("value", "<f4", floats)]
        )
        values = np.zeros(count, record)
        values["size"], values["D"], values["id"] = record.itemsize - 3, ord("D"), number
        values["t_us"] = 1_000_000 + np.arange(count) * (1_000_000 // rate_hz)
        values["value"] = np.cumsum(rng.normal(size=(count, floats)), axis=0)
        rows.append((values, rate_hz))
    for second in range(DURATION_S * 10):
        content += [v[second * hz // 10 : (second + 1) * hz // 10].tobytes() for v, hz in rows]
    path.write_bytes(b"".join(content))


class _Memory(threading.Thread):
    """The largest memory of any process that this one has started [MB]."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.most_mb, self.done = 0.0, threading.Event()

    def run(self) -> None:
        while not self.done.wait(0.05):
            for pid in process_tree(os.getpid())[1:]:
                try:
                    self.most_mb = max(self.most_mb, resident_mb(pid))
                except (OSError, StopIteration):
                    continue  # it has ended


async def _measure(path: Path, folder: Path) -> Iterator[str]:
    work, late_s = LogWork(), [0.0]

    async def watch() -> None:
        while True:
            began_s = time.monotonic()
            await asyncio.sleep(0.005)
            late_s[0] = max(late_s[0], time.monotonic() - began_s - 0.005)

    memory, rows = _Memory(), list[str]()
    watcher = asyncio.ensure_future(watch())
    try:
        memory.start()
        began_s = time.monotonic()
        await work.read(path, folder)
        read_s = time.monotonic() - began_s
        await work.plot(folder, FIELDS, None, None, POINTS)
        rows.append(f"| read; until the first plot | {read_s:.1f}; {time.monotonic() - began_s:.1f} s |")
        for name, (from_s, to_s) in WINDOWS.items():
            steps: list[float] = []
            for step in range(STEPS):
                moved = None if from_s is None or to_s is None else (from_s + step, to_s + step)
                began_s = time.monotonic()
                await work.plot(folder, FIELDS, *(moved or (None, None)), POINTS)
                steps.append(time.monotonic() - began_s)
            p50_ms, max_ms = statistics.median(steps) * 1e3, max(steps) * 1e3
            rows.append(f"| two fields, {name}: p50 / max | {p50_ms:.0f} / {max_ms:.0f} ms |")
        rows.append(f"| most memory of one of its processes | {memory.most_mb:.0f} MB |")
        rows.append(f"| the event loop was late by at most | {late_s[0] * 1e3:.0f} ms |")
    finally:
        memory.done.set()
        watcher.cancel()
        work.close()
    return iter(rows)


def table() -> Iterator[str]:
    """Rows of the table."""
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "hour.ulg"
        write_log(path)
        yield f"{path.stat().st_size / 1e6:.0f} MB, load average {load_average()}\n"
        yield "| what | measured |"
        yield "|---|---|"
        alone = subprocess.run(
            [sys.executable, "-c", PYULOG, str(path)], check=True, capture_output=True, text=True
        )
        yield f"| pyulog alone | {float(alone.stdout):.1f} s |"
        yield from asyncio.run(_measure(path, Path(name) / "columns"))
