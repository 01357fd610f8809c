"""Conflicts between the predicted paths of vehicles: position, time and distance."""

import json
import math

import numpy as np
import pytest

from missions import plan as plan_document
from missions.geodesy import LocalOrigin
from missions.offboard.compiler import compile_mission
from missions.offboard.positions import Start
from missions.offboard.reader import read
from missions.runner.flight import Flight
from missions.separation import closest_m, planned_margin_m
from missions.traffic.conflict import conflicts, first_conflict
from missions.traffic.path import stationary_path
from missions.traffic.waypoints import ends_with_landing, predict_mission, predict_plan
from missions.trajectory.limits import MotionLimits
from missions.values import HomePosition
from missions.vehicle import VehicleModel
from missions.waypoints.planned import estimate_passes

ORIGIN = LocalOrigin(47.0, 8.0, 500.0)
REQUIRED_M = 5.0 + planned_margin_m()


def item_at(kind, north_m, east_m, alt_m, **fields):
    lat, lon, _ = ORIGIN.to_geodetic((north_m, east_m, 0.0))
    return {
        "kind": kind,
        "lat_deg": lat,
        "lon_deg": lon,
        "altitude": {"value_m": alt_m, "reference": "home"},
        **fields,
    }


def line_items(*, east_m=0.0, alt_m=20.0, hold_s=0.0, northward=False, land=True):
    """A straight path of 200 m: eastward from home, or with `northward` northward at `east_m`.

    The vehicle holds for `hold_s` above its take-off, which delays the flight.
    """
    begin, end = ((-100.0, east_m), (100.0, east_m)) if northward else ((0.0, 0.0), (0.0, 200.0))
    items = [item_at("takeoff", *begin, alt_m), item_at("waypoint", *begin, alt_m, hold_s=hold_s)]
    items.append(item_at("waypoint", *end, alt_m))
    return [*items, item_at("land", *end, 0)] if land else items


def predicted_path(items, vehicle="1", *, frame=ORIGIN, **options):
    plan = plan_document.read(json.dumps({"items": items}))
    first = items[0]
    home = HomePosition(lat_deg=first["lat_deg"], lon_deg=first["lon_deg"], alt_amsl_m=500.0)
    planned = estimate_passes(plan, VehicleModel(), home, frame)
    return predict_plan(vehicle, frame, planned, ends_in_air=not ends_with_landing(plan), **options)


def test_two_paths_that_cross_at_the_same_time_are_a_conflict_with_item_time_and_distance():
    conflict = first_conflict(
        predicted_path(line_items(), "2"), predicted_path(line_items(east_m=100.0, northward=True))
    )
    assert (conflict.vehicle, conflict.other) == ("2", "1")
    assert (conflict.place, conflict.other_place) == ("item 3", "item 3")
    assert conflict.along_m == pytest.approx(20 + 100, abs=25)
    assert conflict.after_s == pytest.approx(18 + 100 / 4.5, abs=6)  # start and climb, flight at up to 5 m/s
    assert conflict.distance_m < 1.0
    assert conflict.position_deg == pytest.approx(ORIGIN.to_geodetic((0, 100, 0))[:2], abs=3e-4)
    assert "vehicle 2 may come within" in conflict.text
    assert "of vehicle 1 (item 3)" in conflict.text
    assert "Required: 5 m plus 1.9 m of margin" in conflict.text


def test_paths_that_cross_at_clearly_different_times_are_no_conflict():
    other = predicted_path(line_items(east_m=100.0, northward=True))
    assert first_conflict(predicted_path(line_items(hold_s=20), "2"), other) is not None, (
        "20 s are within the uncertainty of the times"
    )
    assert first_conflict(predicted_path(line_items(hold_s=90), "2"), other) is None


def test_a_vehicle_may_follow_another_on_the_same_path_if_it_starts_late_enough():
    far_ahead = {"index": 2, "t_s": 20 / 1.5 + 42}
    assert (
        first_conflict(
            predicted_path(line_items(), "2"), predicted_path(line_items(), index=2, t_s=20 / 1.5 + 8)
        )
        is not None
    )
    assert (
        first_conflict(predicted_path(line_items(), "2"), predicted_path(line_items(), **far_ahead)) is None
    )
    assert first_conflict(predicted_path(line_items(), "2"), predicted_path(line_items())) is not None, (
        "both start at the same position"
    )


def test_two_crossing_paths_may_be_separated_by_altitude():
    other = predicted_path(line_items(east_m=100.0, northward=True))
    assert first_conflict(predicted_path(line_items(alt_m=20 + REQUIRED_M + 0.5), "2"), other) is None
    conflict = first_conflict(predicted_path(line_items(alt_m=20 + REQUIRED_M - 0.5), "2"), other)
    assert conflict.distance_m == pytest.approx(REQUIRED_M - 0.5, abs=0.1)


def test_a_vehicle_that_has_already_landed_causes_no_conflict():
    short_flight = [item_at("takeoff", 0, 100, 20), item_at("land", 0, 100, 0)]
    assert first_conflict(predicted_path(line_items(hold_s=90), "2"), predicted_path(short_flight)) is None
    assert (
        first_conflict(predicted_path(line_items(hold_s=90), "2"), predicted_path(short_flight[:1]))
        is not None
    ), "the other vehicle stays in the air"


def test_a_vehicle_that_hovers_on_the_path_is_a_conflict_at_any_time():
    conflict = first_conflict(
        predicted_path(line_items(hold_s=600), "2"), stationary_path("1", ORIGIN, (0, 100, -20), "Hold")
    )
    assert (conflict.other_place, conflict.time_uncertainty_s) == ("Hold", None)
    assert "at this position is not known" in conflict.text
    assert (
        first_conflict(predicted_path(line_items(), "2"), stationary_path("1", ORIGIN, (0, 100, -60), "Hold"))
        is None
    )


@pytest.mark.parametrize("seed", range(4))
def test_the_first_conflict_agrees_with_a_comparison_of_all_pairs_of_positions(seed):
    rng = np.random.default_rng(seed)

    def random_items():
        points = [(*rng.uniform(-60, 60, 2).tolist(), float(rng.uniform(10, 50))) for _ in range(4)]
        return [item_at("takeoff", *points[0]), *(item_at("waypoint", *each) for each in points[1:])]

    path, other = predicted_path(random_items(), "2"), predicted_path(random_items())
    first, second = np.nonzero(
        (path.earliest_s[:, None] <= other.latest_s) & (other.earliest_s <= path.latest_s[:, None])
    )
    distance_m = closest_m(
        path.position_ned_m[first], path.velocity_ned_m_s[first],
        other.position_ned_m[second], other.velocity_ned_m_s[second],
    )  # fmt: skip
    conflict = first_conflict(path, other)
    assert (conflict is not None) == bool(distance_m.min() < REQUIRED_M)
    if conflict is not None:
        near_rows = first[distance_m < REQUIRED_M]
        assert path.t_s[near_rows.min()] <= conflict.after_s
        assert conflict.distance_m >= distance_m.min() - 1e-6


def test_paths_in_different_local_frames_are_compared():
    frame = LocalOrigin(47.001, 8.002, 480.0)
    in_other_frame = first_conflict(
        predicted_path(line_items(), "2"),
        predicted_path(line_items(east_m=100.0, northward=True), frame=frame),
    )
    in_same_frame = first_conflict(
        predicted_path(line_items(), "2"), predicted_path(line_items(east_m=100.0, northward=True))
    )
    assert in_other_frame.distance_m == pytest.approx(in_same_frame.distance_m, abs=0.5)
    assert in_other_frame.after_s == pytest.approx(in_same_frame.after_s, abs=2.0)


def test_the_flown_part_of_a_path_is_not_compared():
    crossing = predicted_path(line_items(east_m=100.0, northward=True), index=3, t_s=60.0)
    assert first_conflict(predicted_path(line_items(), "2"), crossing) is None


def test_a_vehicle_off_its_path_is_expected_to_fly_straight_to_its_current_item():
    approach = {"index": 2, "t_s": 0.0, "current_position_ned_m": (0.0, 180.0, -20.0)}
    path = predicted_path(
        line_items(east_m=190.0, northward=True),
        "2",
        **{**approach, "current_position_ned_m": (-60.0, 190.0, -20.0)},
    )
    conflict = first_conflict(path, predicted_path(line_items(), **approach))
    assert conflict.place == "item 3"
    assert 30 < conflict.along_m < 75


def test_the_items_of_a_plan_that_repeats_without_end_may_be_flown_at_any_time():
    items = [
        *line_items(northward=True, east_m=100.0, land=False),
        {"kind": "jump", "target_index": 1, "repeat": -1},
    ]
    assert first_conflict(predicted_path(line_items(hold_s=900), "2"), predicted_path(items)) is not None


def test_conflicts_with_several_vehicles_are_sorted_by_time():
    far_path, near_path = (
        stationary_path("3", ORIGIN, (0, 150, -20), "Hold"),
        stationary_path("1", ORIGIN, (0, 50, -20), "Hold"),
    )
    all_conflicts = conflicts(predicted_path(line_items(), "2"), [far_path, near_path])
    assert [each.other for each in all_conflicts] == ["1", "3"]


def mission_flight(*steps):
    text = "name: Across\nsteps:\n" + "".join(f"- {each}\n" for each in steps)
    compiled = compile_mission(read(text), start=Start(origin=ORIGIN, home_alt_amsl_m=500.0))
    return Flight(compiled, "Across", MotionLimits())


TAKE_OFF, LAND = "{step: take_off, height_m: 20}", "{step: land}"
FLY_EAST = "{step: fly, points: [{position_ned_m: [0, 200, -20]}]}"
CROSSING = line_items(east_m=100.0, northward=True, hold_s=10)


def test_an_offboard_mission_is_compared_along_its_timeline():
    flight = mission_flight(TAKE_OFF, FLY_EAST, LAND)
    path = predicted_path(CROSSING, "2")
    conflict = first_conflict(path, predict_mission("1", ORIGIN, flight, (0.0, 0.0, 0.0))())
    assert (conflict.place, conflict.other_place) == ("item 3", "step 2")
    landing_index = next(index for index, each in enumerate(flight.course.segments) if each.place == "step 3")
    flight.move_to(landing_index)
    assert first_conflict(path, predict_mission("1", ORIGIN, flight, (0.0, 200.0, -20.0))()) is None


def test_a_mission_that_waits_for_a_person_is_expected_at_any_later_time():
    path = predicted_path(line_items(east_m=100.0, northward=True, hold_s=600), "2")
    waiting_steps = (TAKE_OFF, "{step: wait, until: person, timeout_s: 900}", FLY_EAST)
    for steps, expected in (((TAKE_OFF, FLY_EAST, LAND), False), (waiting_steps, True)):
        mission_path = predict_mission("1", ORIGIN, mission_flight(*steps), (0.0, 0.0, 0.0))()
        assert (first_conflict(path, mission_path) is not None) == expected
        assert math.isinf(mission_path.latest_s[-1]) == expected


def test_a_paused_mission_is_expected_at_any_later_time():
    flight = mission_flight(TAKE_OFF, FLY_EAST, LAND)
    flight.paused = True
    path = predicted_path(line_items(east_m=100.0, northward=True, hold_s=600), "2")
    assert first_conflict(path, predict_mission("1", ORIGIN, flight, (0.0, 0.0, 0.0))()) is not None
