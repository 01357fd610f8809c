"""Reading of scenarios: what is accepted, and errors that name the line and the fix."""

import json
from pathlib import Path

import pytest

from gcs_server.scenarios.scenario import Cell, find, for_rows, load, schema
from tests.support.scenario_files import HEAD, scenario_file
from vehicle_sim.yaml_fields import FileProblem

HOLDS = "must_hold: [{check: no_failsafe}]\n"


def test_a_scenario_gives_a_flight_for_each_combination(tmp_path: Path) -> None:
    matrix = """
matrix:
  winds: {calm: {}, west: {wind_ned_m_s: [0, 6, 0]}}
  faults:
    none: []
    lost: [{when: airborne, after_s: 3, gps: lost}, {at_s: 9, vehicles: [1], gps: ok}]
  px4: [1.16, 1.17]
  seeds: [1, 2]
"""
    scenario = load(scenario_file(tmp_path, HOLDS + matrix))
    assert len(scenario.cells) == 16
    assert scenario.cells[0] == Cell("calm", "none", "1.16", 1)
    assert scenario.cells[-1].text == "wind=west, faults=lost, px4=1.17, seed=2"
    assert [event.vehicles for event in for_rows(scenario.events["lost"], 4, 2)] == [(5, 6), (5,)]


def test_a_matrix_may_be_a_file_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "matrix.yaml").write_text("faults: {cut: [{at_s: 3, link: {name: gcs, up: false}}]}\n")
    scenario = load(scenario_file(tmp_path, HOLDS + "matrix: matrix.yaml\n"))
    assert [cell.faults for cell in scenario.cells] == ["cut"]
    assert len(scenario.events["cut"]) == 1


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("must_hold: []\n", "line 6: must_hold Tuple should have at least 1 item"),
        ("must_hold: [{check: reach}]\n", "line 6: must_hold[0]"),
        ("must_hold: [{check: reaches}]\n", "must_hold[0].position_ned_m Field required; add it"),
        (HOLDS + "wether: 3\n", "line 7: wether Extra inputs are not permitted"),
        (HOLDS + "worl: yard\n", "line 7: worl Extra inputs are not permitted; did you mean world?"),
        (HOLDS + "plan: p.json\n", "needs one of plan, mission, python, run; it has plan and mission"),
        (HOLDS + "time_limit_s: .nan\n", "line 7: time_limit_s"),
        (HOLDS + "parameters: {MPC_XY_CRUSE: 3}\n", "line 7: parameters.MPC_XY_CRUSE cannot be set"),
        (HOLDS + "matrix: {px4: [1.15]}\n", "line 7: matrix.px4[0]"),
        (HOLDS + "matrix:\n  faults: {a: [{at_s: 1}]}\n", "line 8: matrix.faults.a[0] does nothing"),
        (HOLDS + "matrix: gone.yaml\n", "gone.yaml: No such file"),
        (HOLDS + "world: nowhere\n", "nowhere: no such file or built-in world"),
        (HOLDS + "starts_ne_m: {second: [0, 3]}\n", "names 'second'; the vehicles are vehicle"),
        (
            "must_hold: [{check: no_failsafe, in_faults: [lost]}]\n",
            "line 6: must_hold[0].in_faults names 'lost'",
        ),
        ("must_hold: [{check: energy, left_percent: 30}]\n", "battery: {endurance_s: …}"),
        ("must_hold: [{check: python, function: 'gone.py:f'}]\n", "cannot be used: there is no file"),
        ("must_hold: [{check: stays_within}]\n", "no bound; give one of fence, radius_m"),
    ],
)
def test_an_error_names_line_field_and_fix(text: str, problem: str, tmp_path: Path) -> None:
    with pytest.raises(FileProblem) as error:
        load(scenario_file(tmp_path, text))
    assert problem in str(error.value), str(error.value)


def test_a_missing_or_wrong_program_is_named(tmp_path: Path) -> None:
    path = scenario_file(tmp_path, HOLDS)
    path.write_text((HEAD + HOLDS).replace("mission:", "plan:"))
    with pytest.raises(FileProblem, match=r"line 5: plan names mission\.yaml, which is a mission"):
        load(path)
    (tmp_path / "mission.yaml").unlink()
    with pytest.raises(FileProblem, match=r"plan names mission\.yaml: No such file"):
        load(path)


def test_a_folder_is_searched_for_scenarios_only(tmp_path: Path) -> None:
    path = scenario_file(tmp_path, HOLDS)
    assert find([tmp_path]) == [path]
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileProblem, match="no scenario here"):
        find([tmp_path / "empty"])


def test_the_schema_names_each_check_and_describes_each_field() -> None:
    text = json.dumps(schema())
    for check in ("reaches", "stays_within", "never_closer_than", "lands_within", "setpoint_gap", "energy"):
        assert f'"const": "{check}"' in text
    fields = schema()["properties"].items()
    assert {name for name, field in fields if not {"description", "$ref"} & field.keys()} == {
        "format",
        "version",
    }


def test_the_examples_are_scenarios() -> None:
    root = Path(__file__).parents[4]
    assert all(load(path) for path in find([root / "missions" / "examples"]))
