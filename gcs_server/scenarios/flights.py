"""Flies programs: a Python function on simulated time, another program on paced time."""

from __future__ import annotations

import asyncio
import inspect
import signal
from collections.abc import Awaitable, Callable, Generator
from contextlib import contextmanager, redirect_stdout
from functools import partial
from io import StringIO

from gcs_server.scenarios.checks import function_of
from gcs_server.scenarios.flown import FlightRecorder, Flown
from gcs_server.scenarios.paced_time import PacedTimeLoop
from gcs_server.scenarios.results import FlownCell
from gcs_server.scenarios.scenario import Cell, PythonProgram, RunProgram, Scenario
from gcs_server.scenarios.setup import aircraft_of, fence_of, fleet_of, obstacles_of
from gcs_server.scenarios.simulated_time import SimulatedTimeLoop
from gcs_server.scenarios.station import Station
from gcs_server.scenarios.subprograms import ProgramEnded, run_program
from missions.dry_run.fleet import Fleet
from missions.dry_run.track import SAMPLE_EVERY_TICKS

TIME_LIMIT_S = 300.0
"""Limit of a program's flight, unless the scenario says otherwise [s]."""
AFTER_END_S = 40.0
"""The flight goes on for so long after its program, unless the vehicle lands: what it does then counts."""
REAL_MARGIN_S = 60.0
"""A function that never waits stops the time of the flight. It is interrupted after its time limit and this,
in real time."""
CHECK_PERIOD_S = 0.1


class Stuck(BaseException):
    """A function did not let the time go on. No Exception, so that the function does not catch it."""


def fly(scenario: Scenario, cell: Cell) -> FlownCell:
    """Flies a scenario with a program once."""
    program = scenario.program
    if isinstance(program, RunProgram):
        loop: Callable[[], asyncio.AbstractEventLoop] = partial(PacedTimeLoop, program.speed)
        with asyncio.Runner(loop_factory=loop) as runner:
            return runner.run(_fly(scenario, cell))
    with asyncio.Runner(loop_factory=SimulatedTimeLoop) as runner, _interrupted_if_stuck(_limit_s(scenario)):
        return runner.run(_fly(scenario, cell))


def _limit_s(scenario: Scenario) -> float:
    return scenario.document.time_limit_s or TIME_LIMIT_S


@contextmanager
def _interrupted_if_stuck(limit_s: float) -> Generator[None]:
    def interrupt(_number: int, _frame: object) -> None:
        raise Stuck

    before = signal.signal(signal.SIGALRM, interrupt)
    timer = signal.setitimer(signal.ITIMER_REAL, limit_s + REAL_MARGIN_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
        signal.setitimer(signal.ITIMER_REAL, *timer)  # of a test that has a timeout of its own


async def _fly(scenario: Scenario, cell: Cell) -> FlownCell:
    flight = ProgramFlight(scenario, cell)
    program = scenario.program
    silent = isinstance(program, RunProgram) and not program.uses_server
    async with Station(flight.fleet.sim, flight.after_tick, silent=silent) as station:
        await flight.fly(station)
    return FlownCell(cell, flight.flown(), station.recording())


class ProgramFlight:
    """One flight, from boot until some time after the end of its program."""

    def __init__(self, scenario: Scenario, cell: Cell) -> None:
        self._scenario, self._cell = scenario, cell
        self.fleet: Fleet = fleet_of(scenario, [cell])
        self._recorder = FlightRecorder(self.fleet.sim)
        self._ticks = 0
        self._problem = ""

    def after_tick(self) -> None:
        """Records; called after each tick."""
        self._ticks += 1
        self._recorder.tick(self._ticks % SAMPLE_EVERY_TICKS == 0)

    async def fly(self, station: Station) -> None:
        """Runs the program, and waits for the landing."""
        limit_s = _limit_s(self._scenario)
        try:
            async with asyncio.timeout(limit_s):
                await self._run(station)
        except TimeoutError:
            self._problem = f"The program did not end within {limit_s:g} s."
        except ProgramEnded as error:
            self._problem = str(error)
        except Stuck:
            self._problem = "The program did not let the time go on: it waits without `await`."
        except Exception as error:
            self._problem = f"The program failed: {type(error).__name__}: {error}"
        end_s = station.clock.monotonic_s() + AFTER_END_S
        while self._is_flying() and station.clock.monotonic_s() < end_s and station.fault is None:
            await station.clock.sleep(CHECK_PERIOD_S)
        if station.fault is not None:
            raise station.fault

    async def _run(self, station: Station) -> None:
        program = self._scenario.program
        if isinstance(program, RunProgram):
            await run_program(program, self._cell.px4, station)
            return
        assert isinstance(program, PythonProgram)
        function = function_of(program.file, program.function)
        values = await fixtures(function, station)
        with redirect_stdout(StringIO()):  # what many flights print at once helps nobody
            await function(**values)

    def _is_flying(self) -> bool:
        return any(vehicle.armed for vehicle in self.fleet.vehicles)

    def flown(self) -> Flown:
        """The flight, for judgements."""
        names = self._scenario.vehicle_names
        vehicles = self._recorder.flights(dict(enumerate(names)))
        faults = [self._problem] if self._problem else []
        for row, vehicle in enumerate(self.fleet.vehicles):
            if self.fleet.collided(row):
                faults.append(f"{names[row]}: {vehicle.last_warning}.")
            elif not vehicles[row].armed:
                faults.append(f"{names[row]} was never armed: {vehicle.last_warning}.")
        return Flown(
            vehicles,
            finished=not self._problem,
            end_reason=self._problem,
            faults=tuple(faults),
            fence=fence_of(self._scenario, aircraft_of(self._scenario, self._cell.px4)[0]),
            obstacles=obstacles_of(self._scenario),
        )


async def fixtures(function: Callable[..., Awaitable[object]], station: Station) -> dict[str, object]:
    """What a function asks for by the names of its parameters.

    Raises:
        TypeError: there is nothing of such a name.
    """
    available: dict[str, Callable[[], Awaitable[object]]] = {
        "vehicle": station.vehicle,
        "vehicles": station.vehicles,
    }
    ready: dict[str, object] = {"station": station, "gcs": station.gcs, "clock": station.clock}
    found: dict[str, object] = {}
    for name in inspect.signature(function).parameters:
        if name in available:
            found[name] = await available[name]()
        elif name in ready:
            found[name] = ready[name]
        else:
            names = ", ".join([*available, *ready])
            raise TypeError(f"the parameter {name} is not one of {names}")
    return found
