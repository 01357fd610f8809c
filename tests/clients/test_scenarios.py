"""The programs of the two documents as scenarios: each is a process that flies a simulated vehicle."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from gcs_server.scenarios.report import failures
from gcs_server.scenarios.results import FlightResult
from gcs_server.scenarios.run import Selected, fly
from gcs_server.scenarios.scenario import load
from tests.clients.seed_program import gimbal_program
from tests.support.scenario_files import program_scenario

FLOW = Path(__file__).with_name("ros2_flow.py")
PORT = 5760


def flown(folder: Path, text: str) -> FlightResult:
    """The only flight of a scenario."""
    scenario = load(program_scenario(folder, text))
    (result,) = fly(Selected(scenario, tuple(scenario.cells)))
    return result


def test_the_gimbal_program_is_a_scenario(reference_data: Path, tmp_path: Path) -> None:
    if gimbal_program(reference_data, tmp_path, PORT) is None:
        pytest.skip("the document with the gimbal program is not beside this checkout")
    text = f"""
run: [sh, -c, "sed s/{PORT}/{{tcp_port}}/ program.py > mine.py && exec {sys.executable} -W ignore mine.py"]
must_hold:
  - {{check: finishes, by_s: 60}}
  - {{check: stays_within, radius_m: 1, height_m: 1}}
  - {{check: no_failsafe}}
  - {{check: lands_within, radius_m: 1}}
"""
    result = flown(tmp_path, text)
    assert result.passed, failures(result)


def test_the_flow_of_the_matlab_example_is_a_scenario(tmp_path: Path) -> None:
    pytest.importorskip("cyclonedds")
    text = f"""
run: [{sys.executable}, {FLOW}, "{{ros2_domain}}"]
must_hold:
  - {{check: reaches, position_ned_m: [0, 0, -1], within_m: 0.5}}
  - {{check: mode_by, mode: offboard, by_s: 3}}
  - {{check: setpoint_gap, max_s: 0.5}}
  - {{check: lands_within, radius_m: 2}}
"""
    result = flown(tmp_path, text)
    assert result.passed, failures(result)
