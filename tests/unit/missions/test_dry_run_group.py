"""Dry runs of a mission for several vehicles, with the same runners as for real vehicles."""

from __future__ import annotations

import json
from dataclasses import asdict, replace

import pytest

from missions.dry_run.group import GroupDryRun, GroupMonteCarlo, dry_run_group, monte_carlo_group
from missions.dry_run.setup import Aircraft, Conditions
from missions.dry_run.spread import Spread
from missions.dry_run.task import findings_of, run
from missions.errors import PlanError
from missions.offboard.division import divide, planned_starts
from missions.offboard.reader import read
from missions.values import Altitude, HomePosition
from missions.vehicle import VehicleModel
from tests.support.dry_runs import AIRCRAFT, FAST_PARAMETERS, HOME, ORIGIN
from tests.support.surveys import HOME as SURVEY_HOME
from tests.support.surveys import survey, survey_plan

pytestmark = pytest.mark.flight

START_DISTANCE_M = 12.0
CROSSING = """
name: Crossing
minimum_separation_m: {minimum_m}
roles:
  lead:
    steps:
      - {{step: take_off, height_m: 3}}
      - {{step: meet, meeting: up}}
      - {{step: fly, points: [{{offset_ned_m: [0, 12, -3]}}]}}
      - {{step: land}}
  left:
    steps:
      - {{step: take_off, height_m: {height_m}}}
      - {{step: meet, meeting: up}}
      - {{step: fly, points: [{{offset_ned_m: [0, -12, -{height_m}]}}]}}
      - {{step: land}}
"""


def role_aircraft() -> dict[str, Aircraft]:
    lat_deg, lon_deg, _ = ORIGIN.to_geodetic((0.0, START_DISTANCE_M, 0.0))
    left_home = HomePosition(lat_deg=lat_deg, lon_deg=lon_deg, alt_amsl_m=HOME.alt_amsl_m)
    return {"lead": AIRCRAFT, "left": replace(AIRCRAFT, home=left_home)}


def fly_crossing(height_m: float, minimum_m: float) -> GroupDryRun:
    return dry_run_group(read(CROSSING.format(height_m=height_m, minimum_m=minimum_m)), role_aircraft())


@pytest.fixture(scope="module")
def crossing_at_two_altitudes() -> GroupDryRun:
    return fly_crossing(9, 3)


def test_all_vehicles_fly_from_their_positions_and_wait_for_each_other(crossing_at_two_altitudes):
    lead, left = (crossing_at_two_altitudes.roles[role] for role in ("lead", "left"))
    assert (lead.finished, left.finished, lead.landed, left.landed) == (True,) * 4
    assert lead.track is not None
    assert left.track is not None
    assert left.track.position_ned_m[0] == pytest.approx((0.0, START_DISTANCE_M, 0.0), abs=0.1)
    assert left.track.position_ned_m[-1] == pytest.approx((0.0, 0.0, 0.0), abs=2.0)
    fly_steps = [next(step for step in run.steps if step.place.endswith("step 3")) for run in (lead, left)]
    assert fly_steps[0].start_s == pytest.approx(fly_steps[1].start_s, abs=1.0), (
        "the lower vehicle did not wait in the air"
    )
    assert left.track.q_ned_frd is not None, "the second vehicle has no track of its own"


def test_the_smallest_distance_is_reported_and_causes_no_finding_above_the_minimum(crossing_at_two_altitudes):
    (closest,) = crossing_at_two_altitudes.closest
    assert closest.roles == ("lead", "left")
    assert 3.0 < closest.distance_m < 8.0
    assert crossing_at_two_altitudes.findings == ()


def test_two_vehicles_that_cross_at_the_same_altitude_cause_a_finding_with_position_and_time():
    role_requests = {
        role: {"aircraft": asdict(each), "origin": None} for role, each in role_aircraft().items()
    }
    for each in role_requests.values():
        each["aircraft"]["home"] = each["aircraft"]["home"].model_dump()
    text = CROSSING.format(height_m=4, minimum_m=3)
    request = {
        "kind": "offboard_mission", "plan": text, "roles": role_requests, "conditions": asdict(Conditions()),
        "obstacles": [], "seed": 0, "flights": None,
    }  # fmt: skip
    reports: list[str] = []
    result = json.loads(json.dumps(run(request, lambda text, share: reports.append(text))))
    finding = result["nominal"]["findings"][0]
    assert (finding["code"], finding["severity"], finding["step"]) == ("separation", "error", "lead, step 3")
    assert "lead (lead, step 3) and left (left, step 3)" in finding["text"]
    assert 0.0 < finding["position_ned_m"][1] < START_DISTANCE_M
    assert result["nominal"]["finished"] is True
    assert result["monte_carlo"] is None
    assert list(result["group"]["roles"]) == ["lead", "left"]
    assert result["group"]["closest"][0]["distance_m"] < 3.0
    assert reports[0] == "1 s are simulated; 0 of 2 vehicles have ended."


def test_a_finding_of_several_roles_is_reported_once_with_the_names_of_the_roles():
    battery_finding = {"code": "battery_unknown", "step": None, "text": "The drain is not known."}
    fence_finding = {"code": "fence_touched", "step": "left, step 2", "text": "It leaves the fence."}
    roles = {"lead": {"findings": [battery_finding]}, "left": {"findings": [fence_finding, battery_finding]}}
    assert [each["text"] for each in findings_of(roles)] == [
        "lead and left: The drain is not known.",
        "It leaves the fence.",
    ]
    assert battery_finding["text"] == "The drain is not known."


@pytest.fixture(scope="module")
def batch() -> GroupMonteCarlo:
    """Four flights in which the vehicles cross 4 m above each other; the minimum separation is 3 m."""
    mission = read(CROSSING.format(height_m=7, minimum_m=3))
    return monte_carlo_group(mission, role_aircraft(), Conditions((0.0, 2.0, 0.0)), flights=4, seed=5)


@pytest.mark.story
def test_each_role_of_a_monte_carlo_run_has_its_own_corridor(batch):
    for role, east_m in (("lead", 0.0), ("left", START_DISTANCE_M)):
        role_flights = batch.roles[role]
        assert len(role_flights.flights) == 4
        assert all(each.finished for each in role_flights.flights)
        assert role_flights.corridor is not None
        assert role_flights.corridor.position_ned_m[0] == pytest.approx((0.0, east_m, 0.0), abs=0.1)
        assert 0.1 < role_flights.corridor.width_m < 5.0


def test_the_vehicles_of_a_flight_have_the_same_wind_and_different_masses(batch):
    lead, left = (batch.roles[role].flights for role in ("lead", "left"))
    assert [each.wind_ned_m_s for each in lead] == [each.wind_ned_m_s for each in left]
    assert all(a.mass_scale != b.mass_scale for a, b in zip(lead, left, strict=True))
    assert asdict(lead[0]).items() >= asdict(Spread().draw(Conditions((0.0, 2.0, 0.0)), 5, 1)).items()


def test_distances_and_chances_cover_all_flights(batch):
    (pair,) = batch.closest
    assert pair.roles == ("lead", "left")
    assert pair.distance_m.least <= pair.distance_m.p50 <= pair.distance_m.greatest
    too_near = pair.distance_m.least < 3.0  # minimum_separation_m
    assert (pair.nearer_than_minimum.count > 0) == too_near
    assert batch.chances["nearer_than_minimum"].count == pair.nearer_than_minimum.count
    assert batch.chances["not_finished"].count == 0
    assert batch.chances["separation"].count >= batch.chances["nearer_than_minimum"].count


@pytest.mark.story
def test_a_flight_with_the_same_number_is_the_same_in_a_batch_of_any_size(batch):
    mission = read(CROSSING.format(height_m=7, minimum_m=3))
    single_flight = monte_carlo_group(
        mission, role_aircraft(), Conditions((0.0, 2.0, 0.0)), flights=1, seed=5
    )
    assert single_flight.roles["left"].flights[0] == batch.roles["left"].flights[0]


@pytest.mark.story
def test_vehicles_that_cross_at_the_same_altitude_come_too_near_in_every_flight():
    mission = read(CROSSING.format(height_m=3, minimum_m=3))
    result = monte_carlo_group(mission, role_aircraft(), flights=2)
    assert (result.chances["separation"].count, result.chances["nearer_than_minimum"].count) == (2, 2)
    assert result.closest[0].distance_m.greatest < 3.0
    document = json.loads(json.dumps(result.document()))
    assert document["closest"][0]["nearer_than_minimum"]["share"] == 1.0
    assert set(document["roles"]["lead"]) >= {"corridor", "duration_s", "flights", "chances"}


def test_too_many_flights_of_all_vehicles_are_refused():
    mission = read(CROSSING.format(height_m=4, minimum_m=3))
    with pytest.raises(PlanError, match="201 flights of 2 vehicles, but 1 to 200 are allowed"):
        monte_carlo_group(mission, role_aircraft(), flights=201)


def test_each_role_needs_a_vehicle():
    with pytest.raises(PlanError, match="role 'left' has no vehicle"):
        dry_run_group(read(CROSSING.format(height_m=4, minimum_m=3)), {"lead": AIRCRAFT})


def test_three_vehicles_share_a_survey_in_a_dry_run_and_stay_apart():
    pattern = survey(
        [(15, -25), (15, 25), (51, 25), (51, -25)], altitude=Altitude(value_m=8.0, reference="home")
    )
    starts = planned_starts(SURVEY_HOME, 3, 5.0)
    vehicle = VehicleModel.from_parameters(FAST_PARAMETERS)
    division = divide(survey_plan(pattern), None, starts, "Field", minimum_m=5.0, vehicle=vehicle)
    aircraft = {each.role: replace(AIRCRAFT, home=starts[each.vehicle]) for each in division.parts}
    flown = dry_run_group(division.mission, aircraft)
    assert all(each.finished and each.landed for each in flown.roles.values())
    assert flown.findings == ()
    assert min(each.distance_m for each in flown.closest) >= 5.0
    for part in division.parts:
        track = flown.roles[part.role].track
        assert track is not None
        assert track.position_ned_m[-1, :2] == pytest.approx(track.position_ned_m[0, :2], abs=1.0)
