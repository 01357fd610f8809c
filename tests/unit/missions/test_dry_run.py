"""Dry runs of waypoint plans: a single simulated flight, and many in one batch."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from missions.dry_run.document import CODES, MonteCarloResult, plain
from missions.dry_run.flight import Flight
from missions.dry_run.monte_carlo import MAX_FLIGHTS, MonteCarlo, monte_carlo
from missions.dry_run.pilot import Step
from missions.dry_run.result import DryRun, dry_run, evaluate
from missions.dry_run.setup import Conditions, Obstacle, Site
from missions.dry_run.track import Track
from missions.errors import PlanError
from missions.items import Takeoff
from missions.plan import Plan
from missions.values import Altitude
from tests.support.dry_runs import AIRCRAFT, HOME, flyable_plan, item_at, short_plan

pytestmark = pytest.mark.flight

WINDY_CONDITIONS = Conditions(wind_ned_m_s=(0.0, 3.0, 0.0), gusts_m_s=0.5)
POST = Obstacle("post", 8.0, 6.0, 1.0, 1.0, 10.0)


@pytest.fixture(scope="module")
def single_run() -> DryRun:
    return dry_run(
        flyable_plan(short_plan(fence_radius_m=30.0)), AIRCRAFT, WINDY_CONDITIONS, seed=4, site=Site([POST])
    )


@pytest.fixture(scope="module")
def batch() -> MonteCarlo:
    return monte_carlo(
        flyable_plan(short_plan(fence_radius_m=30.0)),
        AIRCRAFT,
        WINDY_CONDITIONS,
        flights=3,
        seed=4,
        site=Site([POST]),
    )


def test_a_plan_is_flown_to_its_end_and_each_step_has_its_time(single_run):
    assert (single_run.finished, single_run.landed, single_run.findings) == (True, True, ())
    assert [step.place for step in single_run.steps] == ["item 1", "item 2", "item 3"]
    assert [step.row for step in single_run.steps] == [0, 1, 2]
    assert all(a.end_s == b.start_s for a, b in zip(single_run.steps, single_run.steps[1:], strict=False))
    assert 12.0 < single_run.duration_s < 30.0
    assert single_run.track is not None
    assert np.diff(single_run.track.t_s) == pytest.approx(0.1, abs=0.021)
    assert single_run.track.position_ned_m[-1] == pytest.approx((15.0, 0.0, 0.0), abs=1.5)
    assert -5.0 < single_run.track.position_ned_m[:, 2].min() < -3.5
    assert single_run.length_m == pytest.approx(23.0, abs=3.0)


def test_battery_and_distances_of_a_result_match_its_flight(single_run):
    assert single_run.battery_end_share == pytest.approx(1.0 - single_run.duration_s / 300.0, abs=0.015)
    assert single_run.fence_distance_m == pytest.approx(15.0, abs=1.5)
    assert single_run.obstacle_distance_m == pytest.approx(5.5, abs=1.0)


def test_the_result_can_be_written_as_json(single_run):
    document = json.loads(json.dumps(single_run.document()))
    assert document["origin"] == HOME.model_dump()
    path = document["path"]
    assert (
        len({len(path[name]) for name in ("t_s", "position_ned_m", "q_ned_frd", "gimbal_rad", "step")}) == 1
    )
    assert path["step_places"] == ["item 1", "item 2", "item 3"]


def test_a_vehicle_with_v1_16_flies_as_v1_16_and_the_result_names_it(single_run):
    assert single_run.document()["px4"] == "1.17"
    older = dry_run(flyable_plan(short_plan()), replace(AIRCRAFT, px4="1.16"), seed=4)
    assert older.finished
    assert older.document()["px4"] == "1.16"
    assert not older.findings


def test_the_nominal_flight_of_a_batch_equals_the_single_flight_bit_for_bit(single_run, batch):
    assert single_run.track is not None
    assert batch.nominal.track is not None
    assert np.array_equal(single_run.track.position_ned_m, batch.nominal.track.position_ned_m)


def test_each_flight_of_a_batch_has_its_own_conditions(batch):
    assert len(batch.flights) == 3
    assert len({(each.wind_ned_m_s, each.mass_scale) for each in batch.flights}) == 3
    assert len({each.duration_s for each in batch.flights} | {batch.nominal.duration_s}) > 1
    assert batch.duration_s is not None
    assert batch.duration_s.least <= batch.duration_s.p50 <= batch.duration_s.greatest
    assert batch.chances["fence_touched"].count == 0
    assert batch.chances["fence_touched"].upper > 0.3, "the upper limit is too low for three flights"
    assert batch.corridor is not None
    assert 0.05 < batch.corridor.width_m < 5.0  # the vehicle drifts with the wind
    json.dumps(plain(batch, MonteCarloResult), allow_nan=False)


def test_the_progress_callback_can_end_a_dry_run():
    class Cancelled(Exception):
        pass

    def cancel(now_s: float, ended_count: int) -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        dry_run(flyable_plan(short_plan()), AIRCRAFT, report=cancel)


def test_a_mission_that_px4_refuses_is_refused_with_its_reason():
    run = dry_run(flyable_plan(short_plan(fence_radius_m=10.0)), AIRCRAFT)
    assert not run.finished
    assert [finding.code for finding in run.findings] == ["start_refused"]
    assert "an item lies outside the geofence" in run.findings[0].text
    assert run.document()["path"] is None


def test_the_error_names_the_item_that_px4_does_not_accept():
    terrain_takeoff = item_at(Takeoff, 0.0, 0.0, 5.0).model_copy(
        update={"altitude": Altitude(value_m=5.0, reference="terrain")}
    )
    with pytest.raises(PlanError, match="item 1: PX4 does not accept command 22 in frame 11"):
        flyable_plan(Plan(planned_home=HOME, items=(terrain_takeoff,)))
    with pytest.raises(PlanError, match="nothing to fly"):
        flyable_plan(Plan(planned_home=HOME))


def test_too_many_flights_are_refused():
    with pytest.raises(PlanError, match=f"1 to {MAX_FLIGHTS}"):
        monte_carlo(flyable_plan(short_plan()), AIRCRAFT, flights=MAX_FLIGHTS + 1)


# --- findings about a flight ------------------------------------------------------------------------


def evaluate_flight(*, fence_radius_m: float | None = None, battery_end: float = 0.9, obstacles=()) -> DryRun:
    """The result of a flight 40 m to the north in 10 s, without a simulation."""
    t_s = np.arange(0.0, 10.05, 0.1)
    positions = np.stack([4.0 * t_s, 0.0 * t_s, np.full_like(t_s, -5.0)], axis=1)
    battery = np.linspace(1.0, battery_end, len(t_s))
    step = (t_s > 5.0).astype(int)
    steps = (Step("item 1", "Takeoff", 0), Step("item 2", "Waypoint", 1))
    track = Track(t_s, positions, battery, step, steps)
    flight = Flight(Conditions(), track, finished=True, collided=False, landed=True, findings=())
    plan = flyable_plan(short_plan(5.0, fence_radius_m=fence_radius_m))
    return evaluate(flight, plan, AIRCRAFT, Site(obstacles), computing_s=1.0)


def test_a_flight_outside_the_fence_causes_a_finding_with_step_position_and_distance():
    (finding,) = evaluate_flight(fence_radius_m=30.0).findings
    assert (finding.code, finding.severity, finding.step) == ("fence_touched", "error", "item 2")
    assert "by up to 10.0 m" in finding.text
    assert finding.position_ned_m == pytest.approx((40.0, 0.0, -5.0))


@pytest.mark.parametrize(
    ("battery_end", "code"), [(0.15, "battery_reserve"), (0.0, "battery_empty"), (0.25, None)]
)
def test_a_battery_below_its_reserve_causes_a_finding(battery_end, code):
    assert [finding.code for finding in evaluate_flight(battery_end=battery_end).findings] == (
        [code] if code else []
    )


def test_the_battery_consumption_is_known_from_an_endurance_or_from_sim_bat_drain():
    unknown_endurance = replace(AIRCRAFT, endurance_s=None)
    assert not unknown_endurance.battery_is_known
    assert replace(unknown_endurance, parameters={"SIM_BAT_DRAIN": 60.0}).battery_is_known


def test_a_flight_near_an_obstacle_causes_a_finding_with_its_name():
    (finding,) = evaluate_flight(obstacles=[replace(POST, east_m=2.0)]).findings
    assert finding.code == "obstacle_near"
    assert "within 1.5 m of post" in finding.text
    assert finding.t_s == pytest.approx(2.0, abs=0.2)


def test_each_finding_code_is_explained_in_the_documentation():
    text = (Path(__file__).parents[3] / "docs" / "missions.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| (.+) \| (error|warning) \|$", text, re.MULTILINE)
    assert {code: (severity, meaning) for code, meaning, severity in rows} == CODES
