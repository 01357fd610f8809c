"""CPU time, memory and dropped datagrams from the kernel, and quantiles for the tables."""

from __future__ import annotations

import itertools
import os
import time
from collections.abc import Sequence
from pathlib import Path

_TICKS_PER_S = os.sysconf("SC_CLK_TCK")


def cpu_s(pid: int) -> float:
    """CPU time that a process has used, user and system [s] (fields 14 and 15 of proc(5) stat)."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS_PER_S


def process_tree(pid: int) -> list[int]:
    """A process and all its descendants, including those started by its threads."""
    children = [c for task in Path(f"/proc/{pid}/task").glob("*/children") for c in task.read_text().split()]
    return [pid, *(each for child in children for each in process_tree(int(child)))]


def tree_cpu_s(pid: int) -> float:
    """CPU time of all living threads of a process and its descendants [s].

    proc(5): schedstat counts nanoseconds, stat only ticks.
    """
    tasks = (task for each in process_tree(pid) for task in Path(f"/proc/{each}/task").glob("*/schedstat"))
    return sum(int(task.read_text().split()[0]) for task in tasks) / 1e9


def cpu_share(pid: int, window_s: float, *, with_children: bool = False) -> float:
    """CPU share of a process (and those it started) over a window from now (1 = one core)."""
    pids = process_tree(pid) if with_children else [pid]
    before, began_s = sum(map(cpu_s, pids)), time.monotonic()
    time.sleep(window_s)
    return (sum(map(cpu_s, pids)) - before) / (time.monotonic() - began_s)


def resident_mb(pid: int) -> float:
    """Resident memory of a process (VmRSS of proc(5) status)."""
    rows = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(row.split()[1]) for row in rows if row.startswith("VmRSS")) / 1000


def load_average() -> str:
    """Load average of the last minute, for the tables: other programs affect the results."""
    return f"{os.getloadavg()[0]:.1f}"


def udp_drops(port: int) -> int:
    """Datagrams that the kernel dropped because the reader of `port` was too slow."""
    suffix = f":{port:04X}"
    rows = Path("/proc/net/udp").read_text().splitlines()[1:]
    return sum(int(row.split()[-1]) for row in rows if row.split()[1].endswith(suffix))


def quantiles_ms(samples_s: Sequence[float]) -> str:
    """p50 / p99 / max [ms] as text for the tables."""
    ordered = sorted(samples_s)
    if not ordered:
        return "nothing measured"
    p50 = ordered[len(ordered) // 2]
    p99 = ordered[min(len(ordered) - 1, int(len(ordered) * 0.99))]
    return f"{p50 * 1e3:.2f} / {p99 * 1e3:.2f} / {ordered[-1] * 1e3:.2f}"


def gaps_s(times_s: Sequence[float]) -> list[float]:
    """The times between events [s]."""
    return [b - a for a, b in itertools.pairwise(times_s)]


def row(what: str, durations_s: Sequence[float]) -> str:
    """A row of a table of times."""
    return f"| {what} | {load_average()} | {len(durations_s)} | {quantiles_ms(durations_s)} |"
