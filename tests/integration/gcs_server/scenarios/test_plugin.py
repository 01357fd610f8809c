"""`pytest --gcs` in a process of its own, as users run it."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path

import pytest

from tests.support.scenario_files import scenario_file

IS_INSTALLED = any(each.name == "gcs" for each in entry_points(group="pytest11"))
PLUGIN = [] if IS_INSTALLED else ["-p", "gcs_server.scenarios.plugin"]
TESTS = """
import asyncio
import pytest

async def test_climbs(vehicle, flight, clock, gcs):
    began_s = clock.monotonic_s()
    await vehicle.takeoff(4)
    await vehicle.until(lambda v: v["status"]["mode"] == "hold")
    assert clock.monotonic_s() - began_s > 4
    flight.must_hold("reaches", position_ned_m=[0, 0, -4])

@pytest.mark.gcs(faults=[{"when": "airborne", "gps": "lost"}], px4="1.16")
async def test_loses_gps(vehicle, flight, clock):
    await vehicle.takeoff(4)
    await clock.sleep(15)
    flight.must_hold("no_failsafe")

async def test_flies_two(fleet, flight):
    first, second = await fleet(2)
    await asyncio.gather(first.takeoff(4), second.takeoff(6))
    assert [each.name for each in flight.flown().vehicles] == ["1", "2"]

@pytest.mark.gcs(speed=8)
async def test_has_a_guard(guard, station):
    assert guard.startswith("udpout://127.0.0.1:")
    assert await station.gcs.request("GET", "/guards")

def test_is_not_async(vehicle):
    pass

@pytest.mark.gcs(winds=3)
async def test_has_a_wrong_mark(vehicle):
    pass
"""


def run_pytest(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Runs pytest in a folder."""
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *PLUGIN, *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=200, check=False)


@pytest.mark.story
def test_tests_get_vehicles_and_scenario_files_are_tests(tmp_path: Path) -> None:
    (tmp_path / "test_flights.py").write_text(TESTS)
    text = "must_hold: [{check: reaches, position_ned_m: [-9, 0, null]}]\nmatrix: {seeds: [1, 2]}\n"
    scenario_file(tmp_path, text)
    scenario_file(tmp_path, "must_hold: [{check: reach}]\n", "broken.yaml")
    done = run_pytest(tmp_path, "--gcs", "--gcs-out", "report", "--continue-on-collection-errors")
    assert "3 failed, 3 passed, 3 errors" in done.stdout, done.stdout
    assert "no failsafe: a failsafe switches to descend: no valid position estimate" in done.stdout
    assert "reaches (-9, 0, any) within 2 m: comes no nearer than " in done.stdout
    assert "test_is_not_async flies: write it as `async def`" in done.stdout
    assert "gcs mark: winds is not one of " in done.stdout
    assert "broken.yaml line 6: must_hold[0]" in done.stdout
    assert (tmp_path / "report" / "report.html").is_file()


@pytest.mark.story
def test_without_the_option_there_are_no_fixtures_and_no_scenarios(tmp_path: Path) -> None:
    (tmp_path / "test_mine.py").write_text(
        "import pytest, sys\n"
        "@pytest.fixture\ndef clock():\n    return 3\n"
        "def test_mine(clock):\n    assert clock == 3 and 'vehicle_sim' not in sys.modules\n"
    )
    scenario_file(tmp_path, "must_hold: [{check: finishes}]\n")
    assert "1 passed" in run_pytest(tmp_path).stdout
