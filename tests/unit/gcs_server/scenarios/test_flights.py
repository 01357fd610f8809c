"""Flights of scenarios: judged, the same in any company, and reported."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest

from gcs_server.logbook.tlog import read_tlog
from gcs_server.scenarios import batch, report, run
from gcs_server.scenarios.results import FlightResult
from gcs_server.scenarios.run import Selected, fly, select
from gcs_server.scenarios.scenario import Scenario, load
from missions.errors import PlanError
from tests.support.scenario_files import scenario_file

SCENARIO = """
time_limit_s: 50
matrix:
  winds: {calm: {}, west: {wind_ned_m_s: [0, 5, 0], gusts_m_s: 1}}
  faults:
    none: []
    motor: [{when: offboard, after_s: 1, motor: {number: 1, works: false}}]
must_hold:
  - {check: reaches, position_ned_m: [10, 0, -5], within_m: 1.5, in_faults: [none]}
  - {check: finishes, in_faults: [none]}
  - {check: setpoint_gap, max_s: 0.1}
  - {check: lands_within, radius_m: 3}
"""


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> Scenario:
    return load(scenario_file(tmp_path_factory.mktemp("scenario"), SCENARIO))


@pytest.fixture(scope="module")
def results(scenario: Scenario) -> list[FlightResult]:
    return fly(Selected(scenario, tuple(scenario.cells)))


def test_a_flight_without_faults_passes_and_a_lost_motor_fails(results: list[FlightResult]) -> None:
    assert {each.cell.faults for each in results if each.passed} == {"none"}
    lost = next(each for each in results if not each.passed)
    assert any(line.startswith("lands within 3 m of (0, 0, any): ") for line in report.failures(lost))


def test_a_flight_is_the_same_alone_recorded_and_in_any_company(
    scenario: Scenario, results: list[FlightResult], tmp_path: Path
) -> None:
    last = scenario.cells[-2]
    (alone,) = fly(Selected(scenario, (last,)))
    assert alone.track_sha256 == next(each.track_sha256 for each in results if each.cell == last)
    (recorded,) = batch.fly(scenario, [last], record=True)
    assert recorded.flown.vehicles[0].position_ned_m.tobytes() == alone.vehicles[0].position_ned_m.tobytes()
    assert recorded.recording is not None
    (tmp_path / "flight.tlog").write_bytes(recorded.recording)
    log = read_tlog(tmp_path / "flight.tlog")
    assert log.duration_s > 20
    assert not log.problems


def test_another_seed_is_another_flight(scenario: Scenario) -> None:
    first, second = batch.fly(scenario, [scenario.cells[0], replace(scenario.cells[0], seed=2)])
    assert first.flown.vehicles[0].position_ned_m.tolist() != second.flown.vehicles[0].position_ned_m.tolist()


def test_the_report_says_what_failed_where_and_why(results: list[FlightResult], tmp_path: Path) -> None:
    report.write(results, tmp_path / "a")
    report.write(results, tmp_path / "b")
    names = {each.name for each in (tmp_path / "a").iterdir()}
    assert len([name for name in names if name.endswith(".tlog")]) == 2
    for name in names:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    suite = ElementTree.parse(tmp_path / "a" / "junit.xml").getroot()[0]
    assert (suite.get("tests"), suite.get("failures")) == ("4", "2")
    failure = suite.findall("testcase/failure")[0]
    assert "lands within 3 m" in str(failure.text)
    flights = json.loads((tmp_path / "a" / "results.json").read_text())["flights"]
    assert [each["passed"] for each in flights] == [True, False, True, False]
    page = (tmp_path / "a" / "report.html").read_text()
    assert "2 of 4 flights failed" in page
    assert page.count("Flown path from above") == 2
    for number in (1, 3):
        assert page.count(f'href="#flight-{number}"') == page.count(f'id="flight-{number}"') == 1


def test_hostile_names_stay_text_in_the_reports(results: list[FlightResult]) -> None:
    hostile = replace(results[1], scenario="<script>alert(1)</script>")
    broken = replace(hostile.checks[-1].broken[0], why="\x00\ud800<b>&")
    hostile = replace(hostile, checks=(replace(hostile.checks[-1], broken=(broken,)),))
    assert "<script>" not in report.page([hostile], report.files)
    ElementTree.fromstring(report.junit([hostile]))


def test_flights_are_selected_by_words_of_their_names(scenario: Scenario) -> None:
    (selected,) = select([scenario], ["wind=west", "faults=none"])
    assert [each.text for each in selected.cells] == ["wind=west, faults=none, px4=1.17, seed=1"]
    assert select([scenario], ["px4=1.16"]) == []


def test_roles_fly_together(tmp_path: Path) -> None:
    path = scenario_file(
        tmp_path,
        "must_hold:\n- {check: never_closer_than, to: vehicles, distance_m: 4}\n"
        "- {check: finishes}\n"
        "- {check: lands_within, radius_m: 2, position_ned_m: [0, 6, null], vehicle: b}\n",
    )
    steps = "steps: [{step: take_off, height_m: 4}, {step: meet, meeting: up}, {step: land}]"
    (tmp_path / "mission.yaml").write_text(
        f"format: offboard-gcs-mission\nversion: 1\nname: Two\nroles:\n  a: {{{steps}}}\n"
        f"  b: {{start_ned_m: [0, 6, 0], {steps}}}\n"
    )
    scenario = load(path)
    (result,) = fly(Selected(scenario, tuple(scenario.cells)))
    assert result.passed, report.failures(result)
    assert [each.name for each in result.vehicles] == ["a", "b"]


def test_a_vehicle_that_cannot_arm_fails_every_scenario(tmp_path: Path) -> None:
    text = "must_hold: [{check: setpoint_gap, max_s: 1}]\nmatrix: {faults: {g: [{at_s: 0, gps: lost}]}}\n"
    scenario = load(scenario_file(tmp_path, text))
    (result,) = fly(Selected(scenario, tuple(scenario.cells)))
    assert report.failures(result)[0].startswith("the vehicle flies to an end: ")


def test_a_plan_that_cannot_be_flown_is_an_answer_in_words(
    scenario: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_: Selected) -> list[FlightResult]:
        raise PlanError("item 2", "PX4 refuses it", "Remove it.")

    monkeypatch.setattr(run, "fly", refuse)
    answer = run._fly_task(scenario.path, tuple(scenario.cells))
    assert answer == f"{scenario.path} cannot be flown. item 2: PX4 refuses it. Remove it."
