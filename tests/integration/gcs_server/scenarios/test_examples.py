"""The example scenarios, as users fly them."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs_server.scenarios.report import failures
from gcs_server.scenarios.run import Selected, fly
from gcs_server.scenarios.scenario import find, load
from missions.plan import Plan

FOLDER = Path(__file__).parents[4] / "missions" / "examples" / "scenarios"
SCENARIOS = find([FOLDER])


def test_there_are_ten_in_three_winds_with_two_faults_on_two_versions() -> None:
    assert [len(load(path).cells) for path in SCENARIOS] == [12] * 10
    assert any(isinstance(load(path).program, Plan) for path in SCENARIOS)


@pytest.mark.story
@pytest.mark.timeout(900)
@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_all_flights_of_an_example_pass(path: Path) -> None:
    scenario = load(path)
    failed = {
        each.name: failures(each)
        for each in fly(Selected(scenario, tuple(scenario.cells)))
        if not each.passed
    }
    assert not failed
