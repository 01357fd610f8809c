"""Dry runs of a mission whose path passes through a box: with and without obstacle avoidance."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from missions.dry_run.plans import FlyableMission
from missions.dry_run.result import DryRun, dry_run
from missions.dry_run.setup import Site, prisms_of
from missions.dry_run.task import NOTHING_TO_AVOID, SIMULATED_SENSORS, run
from missions.offboard.document import OffboardMission
from missions.values import FencePolygon
from tests.support.dry_runs import AIRCRAFT, FAST_PARAMETERS, HOME, ORIGIN
from tests.support.obstacles import box_obstacle
from tests.support.offboard_missions import mission

pytestmark = pytest.mark.flight

BOX = box_obstacle(ORIGIN, (12.0, 14.0), (-3.0, 3.0), 6.0, name="the box")


def mission_through_the_box(avoidance: str, obstacle=BOX) -> OffboardMission:
    steps = f"""
- {{step: take_off, height_m: 4}}
- {{step: fly, points: [{{offset_ned_m: [28, 0, -4]}}], speed_m_s: 3, avoidance: {avoidance}}}
- {{step: land}}
"""
    return mission(steps, home=HOME, obstacles=(obstacle,))


def dry_run_among_obstacles(document: OffboardMission, max_duration_s: float = 60.0) -> DryRun:
    site = Site(prisms_of(document.obstacles, AIRCRAFT.home))
    flyable = replace(FlyableMission.from_mission(document, AIRCRAFT), max_duration_s=max_duration_s)
    return dry_run(flyable, AIRCRAFT, site=site)


def test_without_avoidance_the_flight_ends_at_the_box() -> None:
    result = dry_run_among_obstacles(mission_through_the_box("false"))
    assert not result.finished
    (collision,) = [each for each in result.findings if each.code == "obstacle_hit"]
    assert (collision.severity, collision.step) == ("error", "step 2")
    assert "Collision with the box" in collision.text
    assert collision.position_ned_m is not None
    assert collision.position_ned_m[0] == pytest.approx(11.7, abs=0.5)


def test_with_avoidance_the_vehicle_climbs_over_the_box_and_descends_behind_it() -> None:
    result = dry_run_among_obstacles(mission_through_the_box("over"))
    assert (result.finished, result.landed) == (True, True)
    assert [(each.code, each.severity, each.step) for each in result.findings] == [
        ("obstacle_avoided", "warning", "step 2"),
        ("obstacle_near", "warning", "step 2"),
    ]
    assert result.track is not None
    north, _, down = result.track.position_ned_m.T
    above_box = (north > 11.0) & (north < 15.0)
    assert (-down[above_box]).min() > 6.4, "the vehicle flew too low over the box"
    at_goal = north > 27.0
    assert np.flatnonzero(at_goal)[0] > np.flatnonzero(above_box)[-1]
    assert -down[at_goal][0] < 5.5, "the vehicle did not return to its path"
    assert result.obstacle_distance_m is not None
    assert 0.4 < result.obstacle_distance_m < 2.0


@pytest.mark.story
def test_if_avoidance_finds_no_path_the_vehicle_stops_in_front_of_the_obstacle() -> None:
    corridor = box_obstacle(ORIGIN, (-10.0, 40.0), (-1.5, 1.5), 0.0).polygon
    wall = box_obstacle(ORIGIN, (12.0, 14.0), (-20.0, 20.0), 40.0, name="the wall")
    fence = (FencePolygon(inclusion=True, polygon=corridor),)
    document = mission_through_the_box("around", wall).model_copy(update={"fence": fence})
    result = dry_run_among_obstacles(document, max_duration_s=25.0)
    codes = {each.code for each in result.findings}
    assert {"avoidance_stopped", "not_finished"} <= codes
    assert "obstacle_hit" not in codes


def run_task(document: OffboardMission) -> dict:
    request = {
        "kind": "offboard_mission", "plan": document.model_dump_json(), "origin": None,
        "aircraft": {"home": HOME.model_dump(), "parameters": FAST_PARAMETERS},
        "conditions": {"wind_ned_m_s": [0, 0, 0]}, "obstacles": [], "seed": 0, "flights": None,
        "spread": None,
    }  # fmt: skip
    return run(request, lambda text, share: None)


def test_a_dry_run_task_flies_with_the_obstacles_of_the_document() -> None:
    result = json.loads(json.dumps(run_task(mission_through_the_box("false"))))
    assert result["assumed"] == []
    assert "obstacle_hit" in {each["code"] for each in result["nominal"]["findings"]}


@pytest.mark.parametrize(("obstacles", "sentence"), [((BOX,), SIMULATED_SENSORS), ((), NOTHING_TO_AVOID)])
def test_a_dry_run_states_which_sensors_its_avoidance_has(obstacles, sentence) -> None:
    steps = "- {step: take_off, height_m: 2.5}\n- {step: hold, duration_s: 1}\n- {step: land}\n"
    document = mission(steps, home=HOME, obstacles=obstacles, avoidance="over")
    assert run_task(document)["assumed"] == [sentence]
