"""Samples of a mission's path for drawing: connected legs, and times with the correct sum."""

from __future__ import annotations

import itertools
import math

import pytest

from missions.offboard import samples
from missions.offboard.compiler import compile_mission
from missions.offboard.positions import Start
from missions.offboard.reader import read
from tests.support.offboard_missions import LAND, TAKE_OFF, flight_steps, mission, timeline

START = (0.0, 0.0, 0.0)
ORBIT = "step: orbit, center: {offset_ned_m: [20, 0, -10]}, radius_m: 10, turns: 3"


def test_legs_are_connected_and_the_times_of_steps_sum_to_the_flight() -> None:
    compiled = timeline(
        flight_steps("step: fly, points: [{offset_ned_m: [30, 0, -10]}]", ORBIT, "step: photo, count: 3")
    )
    legs = samples.legs(compiled, START)
    assert (legs[0].points[0], legs[0].title) == ((0.0, 0.0, 0.0, 0.0), "Take off")
    for before, after in itertools.pairwise(legs):
        assert before.points[-1][1:] == pytest.approx(after.points[0][1:], abs=2e-3)
        assert before.start_s + before.duration_s == pytest.approx(after.start_s)
    steps = samples.step_times(compiled)
    assert [step.place for step in steps] == [f"step {k}" for k in range(1, 6)]
    assert sum(step.duration_s for step in steps) == pytest.approx(compiled.duration_s)
    assert sum(step.length_m for step in steps) == pytest.approx(compiled.length_m)
    assert [step.photos for step in steps] == [0, 0, 0, 3, 0]


def test_a_repeated_step_is_one_entry_with_the_time_of_all_rounds() -> None:
    compiled = timeline(
        TAKE_OFF + "- {step: repeat, times: 3, steps: [{step: hold, duration_s: 5}]}\n" + LAND
    )
    step = samples.step_times(compiled)[1]
    assert (step.place, step.duration_s) == ("step 2.1", 15.0)


def test_after_a_branch_both_paths_are_drawn_and_the_longer_path_is_timed() -> None:
    branch = (
        "- {step: branch, condition: {value: battery_share, above: 0.5}, then: [], "
        "otherwise: [{step: fly, points: [{offset_ned_m: [0, 50, -10]}]}]}\n"
    )
    compiled = timeline(TAKE_OFF + branch + LAND)
    legs = samples.legs(compiled, START)
    assert [(leg.place, leg.main) for leg in legs] == [
        ("step 1", True),
        ("step 3", False),
        ("step 2 otherwise 1", True),
        ("step 3", True),
    ]
    assert legs[1].points[0][1:] == legs[2].points[0][1:] == (0.0, 0.0, -10.0)  # both begin at the branch
    assert [step.place for step in samples.step_times(compiled)] == ["step 1", "step 2 otherwise 1", "step 3"]


def test_a_long_mission_has_a_limited_number_of_points() -> None:
    compiled = compile_mission(mission(flight_steps(*([ORBIT.replace("turns: 3", "turns: 100")] * 3))))
    point_count = sum(len(leg.points) for leg in samples.legs(compiled, START))
    assert point_count <= samples.MAX_POINTS
    assert compiled.duration_s / samples.SPACING_S > samples.MAX_POINTS
    assert all(
        math.isfinite(value) for leg in samples.legs(compiled, START) for row in leg.points for value in row
    )


def test_the_path_to_a_landing_after_a_branch_begins_at_the_end_of_the_branch() -> None:
    """The straight line from start to landing passes an exclusion fence; the path does not."""
    point_template = "{{offset_ned_m: [{}, {}, -10]}}"
    points = ", ".join(point_template.format(*offset) for offset in ((30, 0), (30, 45), (0, 45)))
    branch_steps = f"[{{step: fly, points: [{points}]}}]"
    condition = "{value: wind_speed_m_s, below: 9}"
    text = (
        "name: a\nhome: {lat_deg: 47.0, lon_deg: 8.0, alt_amsl_m: 480}\n"
        "fence: [{shape: circle, inclusion: false, center: {lat_deg: 47.0, lon_deg: 8.0003}, radius_m: 3}]\n"
        f"steps:\n{TAKE_OFF}"
        f"- {{step: branch, condition: {condition}, then: {branch_steps}, otherwise: {branch_steps}}}\n"
        f"{LAND}"
    )
    assert compile_mission(read(text)).findings == ()


def test_the_setpoint_time_excludes_take_off_landing_and_time_on_the_ground() -> None:
    photos, hold = "- {step: photo, count: 3, interval_s: 5}\n", "- {step: hold, duration_s: 30}\n"
    assert samples.setpoint_time_s(timeline(photos + TAKE_OFF + hold + LAND + photos)) == 30.0
    assert samples.setpoint_time_s(timeline(hold, Start((0.0, 0.0, -10.0), in_air=True))) == 30.0
