"""Dry runs in worker processes: progress, results, refusals and cancellation."""

import asyncio
import json

import pytest

from gcs_server.api.dry_run_models import DryRunView
from gcs_server.errors import ClientHasTooMany, Refused, UnknownDryRun
from gcs_server.plans import dry_runs
from gcs_server.plans.dry_runs import MAX_RESULTS, MAX_RUNNING, DryRuns
from missions import plan as plan_document
from tests.support.dry_runs import FAST_PARAMETERS, HOME, short_plan
from tests.support.elevation_files import LAT_DEG, LON_DEG, hill_elevation, write_elevation_file

pytestmark = pytest.mark.flight

PLAN = plan_document.write(short_plan())

RUN_INFO = {
    "kind": "waypoint_plan",
    "name": None,
    "plan_id": None,
    "version": None,
    "vehicle": None,
    "vehicles": None,
    "assumed": [],
}


def request_for(**changes):
    return {
        "kind": "waypoint_plan",
        "origin": None,
        "aircraft": {"home": HOME.model_dump(), "parameters": FAST_PARAMETERS, "endurance_s": 300.0},
        "conditions": {"wind_ned_m_s": [0.0, 2.0, 0.0]},
        "obstacles": [],
        "seed": 1,
        "flights": None,
        "spread": None,
        "elevation": [],
        **changes,
    }


def test_a_plan_is_flown_in_the_worker_process_and_the_result_matches_the_api_description():
    reports = []

    async def scenario():
        runs = DryRuns()
        run_request = request_for(flights=1, spread={})
        summary = await runs.run(
            "1",
            plan_document.write(short_plan(6.0)),
            run_request,
            RUN_INFO,
            lambda text, progress: reports.append((text, progress)),
            "key",
        )
        compared = await runs.result("1")
        assert compared["nominal"]["finished"]
        assert len(compared["nominal"]["steps"]) == 3
        return summary, runs.body("1")

    summary, result = asyncio.run(scenario())
    assert summary["dry_run"] == "1"
    assert summary["finished"]
    assert summary["errors"] == 0
    view = DryRunView.model_validate_json(result)
    assert view.monte_carlo is not None
    assert len(view.monte_carlo.flights) == 1
    assert view.nominal.path is not None
    assert view.nominal.path.step_places == ["item 1", "item 2", "item 3"]
    assert reports[0][0].startswith("1 s are simulated; 0 of 2 flights")
    assert [progress for _, progress in reports] == sorted(progress for _, progress in reports)


@pytest.mark.story
def test_a_dry_run_flies_over_the_ground_of_elevation_files(tmp_path):
    """The plan flies 8 m above home into a hill north of home."""
    south = {"lat_deg": LAT_DEG - 0.006, "lon_deg": LON_DEG}
    north = {"lat_deg": LAT_DEG, "lon_deg": LON_DEG}
    at_8_m = {"altitude": {"value_m": 8, "reference": "home"}}
    items = [{"kind": "takeoff", **south, **at_8_m}, {"kind": "waypoint", **north, **at_8_m}]
    plan = plan_document.read(json.dumps({"items": items}))
    run_request = request_for(
        elevation=[str(write_elevation_file(tmp_path / "hill.tif", hill_elevation(500.0, 80.0)))]
    )
    run_request["aircraft"]["home"] = {**south, "alt_amsl_m": 500.0}

    async def scenario():
        runs = DryRuns()
        info = {**RUN_INFO, "assumed": ["No wind."]}
        await runs.run("1", plan_document.write(plan), run_request, info, lambda *_: None, "key")
        return json.loads(runs.body("1"))

    result = asyncio.run(scenario())
    assert result["assumed"][0] == "No wind."
    assert result["assumed"][1].startswith(
        "The dry run flies over the ground of the elevation files, on a grid"
    )
    (finding,) = [each for each in result["nominal"]["findings"] if each["code"] == "ground_touched"]
    assert finding["text"] == "The flight touches the ground at item 2."
    assert 100.0 < finding["position_ned_m"][0] < 667.0  # between home and item 2


MISSION_FOR_TWO = """
name: Two hops
roles:
  lead: {steps: [{step: take_off, height_m: 3}, {step: meet, meeting: up}, {step: land}]}
  left: {steps: [{step: take_off, height_m: 3}, {step: meet, meeting: up}, {step: land}]}
"""


@pytest.mark.story
def test_the_monte_carlo_result_of_a_mission_with_roles_matches_the_api_description():
    lead_aircraft = request_for()["aircraft"]
    left_aircraft = {
        **lead_aircraft,
        "home": {**lead_aircraft["home"], "lat_deg": lead_aircraft["home"]["lat_deg"] + 3e-4},
    }
    roles = {
        "lead": {"aircraft": lead_aircraft, "origin": None},
        "left": {"aircraft": left_aircraft, "origin": None},
    }
    run_request = {
        **request_for(),
        "kind": "offboard_mission",
        "roles": roles,
    }
    run_request |= {"flights": 1, "spread": {}}
    run_info = {**RUN_INFO, "kind": "offboard_mission"}
    reports = []

    async def scenario():
        runs = DryRuns()
        plan = MISSION_FOR_TWO.encode()
        await runs.run("1", plan, run_request, run_info, lambda text, _: reports.append(text), "key")
        return runs.body("1")

    view = DryRunView.model_validate_json(asyncio.run(scenario()))
    assert view.monte_carlo is not None
    assert view.monte_carlo.chances["nearer_than_minimum"].count == 0
    assert view.group is not None
    monte_carlo = view.group.monte_carlo
    assert monte_carlo is not None
    assert list(monte_carlo.roles) == ["lead", "left"]
    assert monte_carlo.roles["left"].corridor is not None
    # The homes are 3e-4 degrees of latitude apart: 33.4 m.
    assert monte_carlo.roles["left"].corridor.position_ned_m[0][0] == pytest.approx(33.4, abs=0.5)
    assert monte_carlo.closest[0].distance_m.least == pytest.approx(33.4, abs=3.0)
    assert reports[0] == "1 s are simulated; 0 of 4 vehicles have ended."


@pytest.mark.story
def test_an_empty_plan_is_refused():
    async def scenario():
        plan = short_plan().model_copy(update={"items": ()})
        await DryRuns().run("1", plan_document.write(plan), request_for(), RUN_INFO, lambda *_: None, "key")

    with pytest.raises(Refused, match="nothing to fly"):
        asyncio.run(scenario())


def test_running_dry_runs_are_limited_and_cancelled_dry_runs_do_not_count(monkeypatch):
    monkeypatch.setattr(dry_runs, "COMMAND", ("sleep", "600"))

    async def scenario():
        runs = DryRuns()
        tasks = [
            asyncio.ensure_future(
                runs.run(str(n), PLAN, request_for(), RUN_INFO, lambda *_: None, f"key {n}")
            )
            for n in range(MAX_RUNNING)
        ]
        await asyncio.sleep(0)
        with pytest.raises(Refused, match="already running"):
            runs.next_id("another key")
        with pytest.raises(Refused):
            await runs.run("more", PLAN, request_for(), RUN_INFO, lambda *_: None, "another key")
        for task in tasks:
            task.cancel()
        results = await asyncio.gather(*tasks, return_exceptions=True)
        assert all(isinstance(each, asyncio.CancelledError) for each in results)
        return runs.next_id("key 0")

    assert asyncio.run(scenario()) == "1"


def test_one_client_cannot_take_both_processes(monkeypatch):
    monkeypatch.setattr(dry_runs, "COMMAND", ("sleep", "600"))

    async def scenario():
        runs = DryRuns()
        work = runs.run("1", PLAN, request_for(), RUN_INFO, lambda *_: None, "anna")
        task = asyncio.ensure_future(work)
        await asyncio.sleep(0)
        with pytest.raises(ClientHasTooMany):
            runs.next_id("anna")
        with pytest.raises(ClientHasTooMany):
            await runs.run("2", PLAN, request_for(), RUN_INFO, lambda *_: None, "anna")
        assert runs.next_id("bob") == "1"
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    asyncio.run(scenario())


def test_the_newest_results_are_kept_and_the_oldest_is_removed(monkeypatch):
    monkeypatch.setattr(dry_runs, "COMMAND", ("printf", '{"result": {"errors": 0}, "body_bytes": 2}\\n{}'))

    async def scenario():
        runs = DryRuns()
        for n in range(MAX_RESULTS + 1):
            await runs.run(str(n), PLAN, request_for(), RUN_INFO, lambda *_: None, "key")
        return runs

    runs = asyncio.run(scenario())
    assert runs.body(str(MAX_RESULTS)) == b"{}"
    with pytest.raises(UnknownDryRun, match="There is no result of a dry run '0'"):
        runs.body("0")


def test_large_results_are_kept_up_to_a_total_size_and_the_newest_always(monkeypatch):
    monkeypatch.setattr(dry_runs, "MAX_TOTAL_BYTES", 25)
    runs = DryRuns()
    for n, size in enumerate((10, 10, 10, 100)):
        runs._store(str(n), b" " * size, b"")
        assert runs.body(str(n)) == b" " * size
    with pytest.raises(UnknownDryRun):
        runs.body("2")
