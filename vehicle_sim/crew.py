"""Runs many vehicles in several processes, because one Python process uses one core.

The first process simulates no vehicle: it starts the others, forwards signals to end, and ends all when one
of them fails. The others also end when the first process ends for any reason (`SimServer.end_with`).
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
"""This many vehicles in flight, with the ground station's streams, use half a core
(tests/bench/simulator.py)."""


@dataclass(frozen=True, slots=True)
class Share:
    """The vehicles of one process: rows of the whole fleet, from 0."""

    first: int
    count: int


def shares(vehicles: int, processes: int) -> list[Share]:
    """Splits the fleet into equal shares, larger ones first; none is empty."""
    processes = max(1, min(vehicles, processes))
    cuts = [math.ceil(vehicles * k / processes) for k in range(processes + 1)]
    return [Share(first, end - first) for first, end in itertools.pairwise(cuts)]


def processes_for(vehicles: int) -> int:
    """Number of processes for this many vehicles on this machine."""
    return max(1, min(math.ceil(vehicles / VEHICLES_PER_PROCESS), len(os.sched_getaffinity(0))))


def fly_together(
    target: Callable[[Sequence[str], Share], int], argv: Sequence[str], parts: Sequence[Share]
) -> int:
    """Runs `target(argv, share)` in a process for each share, until all have ended or one has failed.

    Args:
        target: function to run in each process; returns its exit code.
        argv: command line arguments, passed to `target`.
        parts: at least two shares.

    Returns:
        The exit code: 0, or that of the first that failed.
    """
    context = multiprocessing.get_context("spawn")
    workers = [context.Process(target=_end_with, args=(target, argv, part)) for part in parts]
    told = False

    def tell(*_: object) -> None:
        nonlocal told
        told = True
        for worker in workers:
            if worker.is_alive():
                worker.terminate()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, tell)
    for worker in workers:
        worker.start()
        if told:
            worker.terminate()
    running = {worker.sentinel: (worker, part) for worker, part in zip(workers, parts, strict=True)}
    failed = 0
    while running:
        for sentinel in wait(list(running)):
            worker, part = running.pop(int(sentinel))  # pyright: ignore[reportArgumentType]
            worker.join()
            code = worker.exitcode or 0
            if code and not told:
                failed = code if code > 0 else 1
                last = part.first + part.count
                print(
                    f"the process of vehicles {part.first + 1} to {last} has ended ({_how(code)}); "
                    "the others are ended too",
                    file=sys.stderr, flush=True,
                )  # fmt: skip
                tell()
    return failed


def _end_with(target: Callable[[Sequence[str], Share], int], argv: Sequence[str], part: Share) -> None:
    sys.exit(target(argv, part))


def _how(code: int) -> str:
    return f"exit code {code}" if code > 0 else signal.Signals(-code).name
