"""Flies scenarios on several processes, which end with this one."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing.connection import wait
from pathlib import Path

from gcs_server.errors import GcsError
from gcs_server.scenarios import batch, flights
from gcs_server.scenarios.results import FlightResult, judge
from gcs_server.scenarios.scenario import Cell, Scenario, load
from gcs_server.scenarios.subprograms import kill_all
from missions.errors import PlanError
from missions.offboard.document import OffboardMission
from missions.plan import Plan

CELLS_PER_TASK = 12
"""Flights in one simulation: their common steps then cost little for each, and a core gets work often."""


END_S = 2.0
"""Time for a process to kill its programs [s]."""


@dataclass(frozen=True, slots=True)
class Selected:
    """A scenario, and the conditions in which it is flown."""

    scenario: Scenario
    cells: tuple[Cell, ...]


def select(scenarios: Sequence[Scenario], words: Sequence[str]) -> list[Selected]:
    """The flights whose names contain all words; scenarios without such flights are left out."""
    selected: list[Selected] = []
    for scenario in scenarios:
        name = scenario.document.name
        cells = tuple(c for c in scenario.cells if all(word in f"{name} [{c.text}]" for word in words))
        if cells:
            selected.append(Selected(scenario, cells))
    return selected


def fly(selected: Selected) -> list[FlightResult]:
    """Flies a scenario, judges it, and flies what failed again with a recording."""
    scenario = selected.scenario
    if not isinstance(scenario.program, Plan | OffboardMission):
        return [_fly_program(scenario, cell) for cell in selected.cells]
    results = [judge(scenario, each.cell, each.flown) for each in batch.fly(scenario, selected.cells)]
    failed = [each.cell for each in results if not each.passed]
    if failed:
        recordings = {each.cell: each.recording for each in batch.fly(scenario, failed, record=True)}
        results = [each.with_recording(recordings.get(each.cell)) for each in results]
    return results


def _fly_program(scenario: Scenario, cell: Cell) -> FlightResult:
    flown = flights.fly(scenario, cell)
    result = judge(scenario, cell, flown.flown)
    return result if result.passed else result.with_recording(flown.recording)


def fly_all(
    selected: Sequence[Selected], jobs: int, report: Callable[[Sequence[FlightResult]], None]
) -> list[FlightResult]:
    """Flies all; the results are in the order of the scenarios, whatever ended first.

    Args:
        selected: the scenarios.
        jobs: number of processes.
        report: called with the flights of each scenario as it ends.

    Raises:
        GcsError: a scenario cannot be flown, or a process ended without a result.
    """
    count = sum(len(_portions(each)) for each in selected)
    results: list[FlightResult] = []
    with _processes(min(jobs, count)) as pool:
        futures: list[list[Future[list[FlightResult] | str]]] = [
            [pool.submit(_fly_task, each.scenario.path, cells) for cells in _portions(each)]
            for each in selected
        ]
        try:
            for of_scenario in futures:
                flown: list[FlightResult] = []
                for future in of_scenario:
                    flown += _results_of(future.result())
                report(flown)
                results += flown
        except BrokenProcessPool:
            raise GcsError(
                "A process that flies scenarios was ended.", remedy="Give fewer --jobs if memory is short."
            ) from None
    return results


def _portions(selected: Selected) -> list[tuple[Cell, ...]]:
    """The conditions that one process flies at a time."""
    in_one_simulation = isinstance(selected.scenario.program, Plan | OffboardMission)
    count = CELLS_PER_TASK if in_one_simulation else 1
    return [selected.cells[first : first + count] for first in range(0, len(selected.cells), count)]


def _fly_task(path: Path, cells: tuple[Cell, ...]) -> list[FlightResult] | str:
    """The results, or why there are none: not all errors pass between processes."""
    try:
        # Read again here, because a scenario has functions, which do not pass either.
        return fly(Selected(load(path), cells))
    except Exception as error:
        text = str(error) if isinstance(error, PlanError) else f"{type(error).__name__}: {error}"
        return f"{path} cannot be flown. {text}"


def _results_of(answer: list[FlightResult] | str) -> list[FlightResult]:
    if isinstance(answer, str):
        raise GcsError(answer)
    return answer


@contextlib.contextmanager
def _processes(count: int) -> Generator[ProcessPoolExecutor]:
    """Processes that end with the block, at once if it is left by an exception."""
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(max(1, count), mp_context=context, initializer=_end_with_parent)
    try:
        yield pool
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        processes = multiprocessing.active_children()
        for process in processes:
            process.terminate()  # it then kills its programs
        for process in processes:
            process.join(END_S)
            process.kill()
        raise
    pool.shutdown()


def _end_with_parent() -> None:
    """Ends this process when its parent dies, also if that is killed; Ctrl+C is the parent's to handle."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda _number, _frame: _end())
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_exit_after, args=(parent.sentinel,), daemon=True).start()


def _exit_after(sentinel: int) -> None:
    wait([sentinel])
    _end()


def _end() -> None:
    """Ends this process at once, and its programs with all that they have started."""
    kill_all()
    os._exit(1)
