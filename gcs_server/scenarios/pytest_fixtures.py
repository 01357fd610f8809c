"""Fixtures for tests that fly: `vehicle`, `fleet`, `station`, `guard`, `clock`, `flight`."""

from __future__ import annotations

import asyncio
import inspect
from collections.abc import Awaitable, Callable, Generator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from pydantic import TypeAdapter

from gcs_server.client import Gcs, Vehicle
from gcs_server.clock import LoopClock
from gcs_server.scenarios.checks import AnyCheck
from gcs_server.scenarios.flights import ProgramFlight
from gcs_server.scenarios.flown import Flown
from gcs_server.scenarios.paced_time import PacedTimeLoop
from gcs_server.scenarios.report import broken_text
from gcs_server.scenarios.scenario import FORMAT, Scenario, from_value
from gcs_server.scenarios.simulated_time import SimulatedTimeLoop
from gcs_server.scenarios.station import Station
from gcs_server.scenarios.subprograms import open_guard
from vehicle_sim.yaml_fields import FileProblem

WIND = frozenset({"wind_ned_m_s", "gusts_m_s"})
CONDITIONS = WIND | {"vehicles", "px4", "seed", "faults", "parameters", "world", "speed", "battery"}
"""What a mark may say."""
_check = TypeAdapter[AnyCheck](AnyCheck)


class TestFlight:
    """The flight of one test: a station, and what was flown so far.

    Args:
        scenario: the conditions.
        speed: simulated seconds in a real second; None: simulated time.
    """

    __test__ = False

    def __init__(self, scenario: Scenario, speed: float | None) -> None:
        loop = SimulatedTimeLoop if speed is None else partial(PacedTimeLoop, speed)
        self.runner = asyncio.Runner(loop_factory=loop)
        self._scenario = scenario
        self._flight: ProgramFlight | None = None
        self._station: Station | None = None

    async def station(self, vehicles: int | None = None) -> Station:
        """The running station, which the first call starts.

        Args:
            vehicles: number of vehicles; None: as the mark says.

        Raises:
            RuntimeError: it runs already, with fewer vehicles.
        """
        if self._station is None:
            scenario = self._scenario if vehicles is None else self._scenario.with_vehicles(vehicles)
            self._flight = ProgramFlight(scenario, scenario.cells[0])
            station = Station(self._flight.fleet.sim, self._flight.after_tick)
            self._station = await station.__aenter__()
        elif vehicles is not None and vehicles > len(self._station.sim.nodes):
            raise RuntimeError(
                f"{vehicles} vehicles, but the station of this test has {len(self._station.sim.nodes)}: "
                f"write @pytest.mark.gcs(vehicles={vehicles})"
            )
        return self._station

    def flown(self) -> Flown:
        """What was flown so far.

        Raises:
            RuntimeError: the test has no vehicle.
        """
        if self._flight is None:
            raise RuntimeError("this test has no vehicle yet; ask for `vehicle`, `station` or `fleet`")
        return self._flight.flown()

    def must_hold(self, check: str, **fields: Any) -> None:
        """Judges what was flown so far, by a check of scenarios and its fields.

        Raises:
            AssertionError: it does not hold; the text says why, where and when.
        """
        __tracebackhide__ = True
        judged = _check.validate_python({"check": check, **fields}, strict=False)
        flown = self.flown()
        broken = [broken_text(each, len(flown.vehicles) > 1) for each in judged.judge(flown)]
        assert not broken, f"{judged.title()}: {'; '.join(broken)}"

    def close(self) -> None:
        """Stops the station."""
        try:
            if self._station is not None:
                self.runner.run(self._station.__aexit__())
        finally:
            self.runner.close()


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Runs a coroutine that uses these fixtures in the event loop of its station."""
    flight = pyfuncitem.funcargs.get("flight")
    if not isinstance(flight, TestFlight):
        return None
    names = inspect.signature(pyfuncitem.obj).parameters
    flight.runner.run(pyfuncitem.obj(**{name: pyfuncitem.funcargs[name] for name in names}))
    return True


@pytest.fixture
def flight(request: pytest.FixtureRequest) -> Generator[TestFlight]:
    """The flight of the test, and judgements of it."""
    if not inspect.iscoroutinefunction(request.function):
        pytest.fail(f"{request.node.name} flies: write it as `async def`", pytrace=False)
    mark = request.node.get_closest_marker("gcs")
    conditions: dict[str, Any] = {} if mark is None else dict(mark.kwargs)
    unknown = sorted(conditions.keys() - CONDITIONS)
    if unknown:
        pytest.fail(f"gcs mark: {unknown[0]} is not one of {', '.join(sorted(CONDITIONS))}", pytrace=False)
    speed = conditions.pop("speed", 1.0 if "guard" in request.fixturenames else None)
    try:
        scenario = _scenario(request.node.name, request.path.parent, conditions)
    except FileProblem as problem:
        pytest.fail(str(problem), pytrace=False)
    test_flight = TestFlight(scenario, speed)
    try:
        yield test_flight
    finally:
        test_flight.close()


def _scenario(name: str, folder: Path, conditions: dict[str, Any]) -> Scenario:
    """The conditions of a mark as a scenario; its program is the test."""
    wind = {key: conditions.pop(key) for key in WIND & conditions.keys()}
    matrix = {
        "winds": {"test": wind},
        "faults": {"test": conditions.pop("faults", [])},
        "px4": [conditions.pop("px4", "1.17")],
        "seeds": [conditions.pop("seed", 1)],
    }
    value = {"format": FORMAT, "version": 1, "name": name[:80], "run": ["pytest"], "matrix": matrix}
    value |= {**conditions, "must_hold": [{"check": "no_failsafe"}]}
    return from_value(value, folder / f"mark of {name}")


@pytest.fixture
def station(flight: TestFlight) -> Station:
    """The ground station of the test, with its simulated vehicles."""
    return flight.runner.run(flight.station())


@pytest.fixture
def gcs(station: Station) -> Gcs:
    """A client of the station."""
    return station.gcs


@pytest.fixture
def clock(station: Station) -> LoopClock:
    """The time of the flight."""
    return station.clock


@pytest.fixture
def vehicle(flight: TestFlight, station: Station) -> Vehicle:
    """The first vehicle, which can be armed."""
    return flight.runner.run(station.vehicle())


@pytest.fixture
def fleet(flight: TestFlight) -> Callable[[int], Awaitable[list[Vehicle]]]:
    """`await fleet(3)`: three vehicles that can be armed."""

    async def get(count: int) -> list[Vehicle]:
        station = await flight.station(count)
        return (await station.vehicles())[:count]

    return get


@pytest.fixture
def guard(flight: TestFlight, vehicle: Vehicle, station: Station) -> str:
    """Address (`udpout://…`) of a guarded link of the first vehicle, for a program; the time of the flight is
    then real time (or a multiple, `speed`)."""
    return f"udpout://{flight.runner.run(open_guard(station))}"
