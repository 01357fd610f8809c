"""Runs many vehicles in several worker processes, because one Python process uses one core.

The parent process simulates no vehicle: it starts the workers, forwards termination signals, and terminates
all workers when one fails. The workers also end when the parent process ends for any reason
(`SimServer.stop_when_readable`).
"""

from __future__ import annotations

import itertools
import math
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing.connection import wait

VEHICLES_PER_PROCESS = 40
"""Number of vehicles that use half a core while they fly and send the streams of a ground station
(tests/bench/simulator.py)."""


@dataclass(frozen=True, slots=True)
class Shard:
    """The vehicles of one process, as rows of the whole fleet, from 0."""

    first: int
    count: int


def split_fleet(vehicles: int, processes: int) -> list[Shard]:
    """Splits the fleet into shards that differ by at most one vehicle; no shard is empty."""
    processes = max(1, min(vehicles, processes))
    limits = [math.ceil(vehicles * k / processes) for k in range(processes + 1)]
    return [Shard(first, end - first) for first, end in itertools.pairwise(limits)]


def process_count(vehicles: int) -> int:
    """Number of processes for this many vehicles on this machine."""
    return max(1, min(math.ceil(vehicles / VEHICLES_PER_PROCESS), len(os.sched_getaffinity(0))))


def run_workers(
    target: Callable[[Sequence[str], Shard], int], argv: Sequence[str], shards: Sequence[Shard]
) -> int:
    """Runs `target(argv, shard)` in a process for each shard, until all have ended.

    When one process fails, the other processes are terminated.

    Args:
        target: function to run in each process; returns its exit code.
        argv: command line arguments, passed to `target`.
        shards: at least two shards.

    Returns:
        0, or the exit code of a worker that failed.
    """
    context = multiprocessing.get_context("spawn")
    workers = [context.Process(target=_exit_with, args=(target, argv, shard)) for shard in shards]
    terminating = False

    def terminate_all(*_: object) -> None:
        nonlocal terminating
        terminating = True
        for worker in workers:
            if worker.is_alive():
                worker.terminate()

    for stop_signal in (signal.SIGINT, signal.SIGTERM):
        signal.signal(stop_signal, terminate_all)
    for worker in workers:
        worker.start()
        if terminating:
            worker.terminate()
    running = {worker.sentinel: (worker, shard) for worker, shard in zip(workers, shards, strict=True)}
    exit_code = 0
    while running:
        for sentinel in wait(list(running)):
            worker, shard = running.pop(int(sentinel))  # pyright: ignore[reportArgumentType]
            worker.join()
            worker_code = worker.exitcode or 0
            if worker_code and not terminating:
                exit_code = worker_code if worker_code > 0 else 1
                last = shard.first + shard.count
                reason = _reason(worker_code)
                print(
                    f"the process of vehicles {shard.first + 1} to {last} has ended ({reason}); "
                    "the other processes are terminated",
                    file=sys.stderr, flush=True,
                )  # fmt: skip
                terminate_all()
    return exit_code


def _exit_with(target: Callable[[Sequence[str], Shard], int], argv: Sequence[str], shard: Shard) -> None:
    sys.exit(target(argv, shard))


def _reason(code: int) -> str:
    return f"exit code {code}" if code > 0 else signal.Signals(-code).name
