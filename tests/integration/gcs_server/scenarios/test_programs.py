"""Programs in scenarios: the same flight each time, and wrong ones fail with the right reason."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from gcs_server.scenarios import flights
from gcs_server.scenarios.report import failures
from gcs_server.scenarios.results import FlightResult
from gcs_server.scenarios.run import Selected, fly
from gcs_server.scenarios.scenario import load
from tests.support.scenario_files import program_scenario

PROGRAM = """
import asyncio

async def out_and_land(vehicle, clock, north_m=12.0):
    await vehicle.takeoff(4)
    await vehicle.until(lambda v: v["status"]["mode"] == "hold", what="the end of the take-off")
    end_s = clock.monotonic_s() + 8.0
    async with vehicle.offboard(position_ned_m=(0, 0, -4), valid_for_s=0.5) as offboard:
        while clock.monotonic_s() < end_s:
            await offboard.position_ned(north_m, 0, -4)
            await asyncio.sleep(0.1)
    await vehicle.land()
    await vehicle.until_disarmed()

async def right(vehicle, clock):
    await out_and_land(vehicle, clock)

async def wrong_sign(vehicle, clock):
    await out_and_land(vehicle, clock, -12.0)

async def lands_where_gps_is_lost(vehicle, clock):
    await vehicle.takeoff(8)
    await vehicle.until(lambda v: v["status"]["mode"] == "hold", what="the end of the take-off")
    async with vehicle.offboard(position_ned_m=(0, 0, -8), valid_for_s=0.5) as offboard:
        while (await vehicle.topic("gps"))["fix_type"] >= 3:
            await offboard.position_ned(0, 12, -8)
            await asyncio.sleep(0.1)
        await vehicle.land_now()
        await vehicle.until_disarmed()

async def never_waits(vehicle):
    while True:
        pass

async def fails(vehicle):
    raise ValueError("no such survey")

async def waits_for_ever(vehicle, clock):
    await clock.sleep(1e9)
"""
CHECKS = """
must_hold:
  - {check: finishes}
  - {check: reaches, position_ned_m: [12, 0, -4], within_m: 1.5}
  - {check: setpoint_gap, max_s: 0.3}
  - {check: lands_within, position_ned_m: [12, 0, null], radius_m: 3}
"""


def flown(folder: Path, text: str) -> FlightResult:
    """The only flight of a scenario."""
    (folder / "program.py").write_text(PROGRAM)
    scenario = load(program_scenario(folder, text))
    (result,) = fly(Selected(scenario, tuple(scenario.cells)))
    return result


def test_a_python_program_flies_on_simulated_time_the_same_each_time(tmp_path: Path) -> None:
    first = flown(tmp_path, "python: program.py:right\n" + CHECKS)
    assert first.passed, failures(first)
    assert first.recording is None
    second = flown(tmp_path, "python: program.py:right\n" + CHECKS)
    assert second.track_sha256 == first.track_sha256


@pytest.mark.story
@pytest.mark.parametrize(
    ("function", "reason"),
    [
        ("wrong_sign", "reaches (12, 0, -4) within 1.5 m: comes no nearer than "),
        ("fails", "the vehicle flies to an end: The program failed: ValueError: no such survey"),
        ("waits_for_ever", "the vehicle flies to an end: The program did not end within 60 s."),
    ],
)
def test_a_wrong_python_program_fails_with_the_reason(function: str, reason: str, tmp_path: Path) -> None:
    result = flown(tmp_path, f"python: program.py:{function}\ntime_limit_s: 60\n{CHECKS}")
    assert any(line.startswith(reason) for line in failures(result)), failures(result)
    assert result.recording


@pytest.mark.story
def test_a_program_that_stops_the_time_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flights, "REAL_MARGIN_S", -25.0)
    result = flown(tmp_path, f"python: program.py:never_waits\ntime_limit_s: 40\n{CHECKS}")
    assert "did not let the time go on" in failures(result)[0]


@pytest.mark.story
def test_a_program_that_lands_without_gps_in_wind_leaves_the_fence(tmp_path: Path) -> None:
    text = """
python: program.py:lands_where_gps_is_lost
parameters: {GF_MAX_HOR_DIST: 16}
matrix:
  winds: {west: {wind_ned_m_s: [0, 7, 0], gusts_m_s: 1}}
  faults: {gps lost: [{when: offboard, after_s: 6, gps: lost}]}
must_hold: [{check: stays_within, fence: true}, {check: lands_within, radius_m: 16}]
"""
    result = flown(tmp_path, text)
    fence, landing = failures(result)
    assert fence.startswith("stays within the fence: leaves the fence here, later by up to ")
    assert landing.startswith("lands within 16 m of (0, 0, any): lands ")


MAVLINK = """
import sys, time
from pymavlink import mavutil

link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{sys.argv[1]}", source_system=245)
keeps_sending, speed = sys.argv[2] == "keeps", 4.0
link.wait_heartbeat(timeout=30)

def command(number, *values):
    link.mav.command_long_send(1, 1, number, 0, *values, *[0] * (7 - len(values)))

def send():
    link.mav.set_position_target_local_ned_send(0, 1, 1, 1, 0b110111000111, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0)

command(22, 0, 0, 0, *[float("nan")] * 4)
command(400, 1)
time.sleep(12 / speed)
for count in range(120):
    if count < 20 or keeps_sending:
        send()
    if count == 15:
        command(176, 1, 6)
    time.sleep(0.02)
command(21)
time.sleep(2)
"""


@pytest.mark.story
def test_a_mavlink_program_without_a_keep_alive_fails_with_the_gap(tmp_path: Path) -> None:
    (tmp_path / "mavlink.py").write_text(MAVLINK)
    text = """
run: [PYTHON, mavlink.py, "{port}", HOW]
speed: 4
must_hold: [{check: setpoint_gap, max_s: 0.6}, {check: no_failsafe}, {check: mode_by, mode: offboard}]
""".replace("PYTHON", sys.executable)
    result = flown(tmp_path, text.replace("HOW", "keeps"))
    assert result.passed, failures(result)
    gap, failsafe = failures(flown(tmp_path, text.replace("HOW", "stops")))
    assert gap.startswith("no setpoint gap above 0.6 s: no setpoint for ")
    assert failsafe.startswith("no failsafe: a failsafe switches to return: no setpoint for ")
    through_guard = flown(tmp_path, "guard: true\n" + text.replace("HOW", "stops"))
    assert through_guard.passed, failures(through_guard)
