"""CPU time (user and system) of the import of the server, and of a start of `gcs` with all its processes."""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from tests.station import free_port, is_up

RUNS = 5
SETTLED_S = 5.0
"""Time after the first response [s] until all processes of the server have started, too."""
IMPORTS = {
    "numpy, for comparison": "import numpy",
    "gcs_server.app, as gcs imports it": "import gc; gc.disable(); import gcs_server.app",
    "gcs_server.app": "import gcs_server.app",
}
ENVIRONMENT = {**os.environ, "PYTHONDONTWRITEBYTECODE": ""}
"""The modules are compiled before the measurement, as those of an installation."""
TICKS_PER_S = os.sysconf("SC_CLK_TCK")


def _import_cpu_s(statement: str) -> float:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", statement], check=True, env=ENVIRONMENT)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def _tree_cpu_s(root: int) -> dict[str, float]:
    """CPU time [s] of a process and its descendants, by the name of the module that each runs."""
    stats: dict[int, tuple[int, float]] = {}
    for entry in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = entry.read_text().rpartition(")")[2].split()
        except OSError:
            continue  # ended meanwhile
        stats[int(entry.parent.name)] = (int(fields[1]), sum(map(int, fields[11:15])) / TICKS_PER_S)
    tree = {root}
    while more := {pid for pid, (parent, _) in stats.items() if parent in tree} - tree:
        tree |= more
    times: dict[str, float] = {}
    for pid in tree & stats.keys():
        command = Path(f"/proc/{pid}/cmdline").read_bytes().decode().split("\0")
        name = next((part for part in command if part.startswith(("gcs_server", "vehicle_sim"))), "other")
        times[name] = times.get(name, 0.0) + stats[pid][1]
    return times


def _start_cpu_s(*flags: str) -> dict[str, float]:
    port = free_port()
    with tempfile.TemporaryDirectory() as data:
        command = [sys.executable, "-m", "gcs_server", "serve", "--port", str(port), "--data", data, *flags]
        process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=ENVIRONMENT
        )
        try:
            while not is_up(f"http://127.0.0.1:{port}"):
                time.sleep(0.05)
            time.sleep(SETTLED_S)
            return _tree_cpu_s(process.pid)
        finally:
            process.terminate()
            process.wait()


def _median(measure: Callable[[], float]) -> float:
    return statistics.median(measure() for _ in range(RUNS))


def table() -> Iterator[str]:
    """Rows of Markdown."""
    yield "| what | CPU [s], median of 5 |"
    yield "|---|---|"
    for name, statement in IMPORTS.items():
        _import_cpu_s(statement)  # compiles
        yield f"| import of {name} | {_median(lambda statement=statement: _import_cpu_s(statement)):.2f} |"
    for name, flags in (("without a simulated vehicle", ("--no-sim",)), ("with one", ())):
        runs = [_start_cpu_s(*flags) for _ in range(RUNS)]
        total_s = statistics.median(sum(run.values()) for run in runs)
        parts = ", ".join(f"{part} {cpu_s:.2f}" for part, cpu_s in sorted(runs[-1].items()))
        yield f"| `gcs serve`, all processes ready, {name} | {total_s:.2f} ({parts}) |"
