"""Patterns as steps of an offboard mission: the same path and pictures as the items of a waypoint plan."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest

from missions.errors import PlanError
from missions.estimates import estimate
from missions.offboard.compiler import compile_mission
from missions.offboard.document import OffboardMission
from missions.offboard.from_pattern import steps_from_pattern
from missions.offboard.segments import CurveSegment
from missions.offboard.steps import Fly, Gimbal, MissionStep, Orbit, TakeOff
from missions.offboard.timeline import Timeline
from missions.patterns import document
from missions.plan import Plan
from missions.setpoints import Trajectory
from missions.vehicle import VehicleModel
from tests.support.offboard_missions import HOME, finding_codes
from tests.support.survey_camera import CAMERA

NORTH_DEG_PER_M = 1.0 / 111_194.9
EAST_DEG_PER_M = NORTH_DEG_PER_M / math.cos(math.radians(47.0))
CORNERS = [
    {"lat_deg": 47.0 + n * NORTH_DEG_PER_M, "lon_deg": 8.0 + e * EAST_DEG_PER_M}
    for n, e in ((20, 0), (20, 80), (70, 80), (70, 0))
]
COVERAGE = {"camera": CAMERA, "distance_m": 30}
ALTITUDE = {"value_m": 30, "reference": "home"}
PATTERNS: dict[str, dict[str, Any]] = {
    "survey": {
        "outer": CORNERS,
        "coverage": COVERAGE,
        "altitude": ALTITUDE,
        "speed_m_s": 4,
        "turnaround_m": 5,
    },
    "corridor": {"points": CORNERS[:3], "width_m": 40, "coverage": COVERAGE, "altitude": ALTITUDE},
    "perimeter": {"outer": CORNERS, "offset_m": 5, "altitude": ALTITUDE, "rounds": 2},
    "orbit": {
        "center": CORNERS[0],
        "radius_m": 25,
        "altitude": ALTITUDE,
        "look_at": {**ALTITUDE, "value_m": 5},
        "rounds": 2,
    },
    "structure": {
        "outline": CORNERS,
        "coverage": COVERAGE,
        "base": {**ALTITUDE, "value_m": 10},
        "height_m": 30,
    },
}


def make_pattern(kind: str, **changes: Any) -> tuple[document.PatternDocument, Plan, tuple[MissionStep, ...]]:
    """A pattern, a plan with its items, and its steps for an offboard mission."""
    pattern = document.read(json.dumps({"kind": kind, **PATTERNS[kind], **changes}))
    plan = Plan(items=document.make(pattern).items)
    items = [item for _, item in plan.simple_items()]
    return pattern, plan, steps_from_pattern(pattern, items)


def compile_steps(steps: tuple[MissionStep, ...]) -> Timeline:
    return compile_mission(OffboardMission(name="Pattern", home=HOME, steps=(TakeOff(height_m=30.0), *steps)))


@pytest.mark.parametrize("kind", PATTERNS)
def test_a_pattern_is_flown_without_errors_along_the_length_of_its_items(kind: str) -> None:
    _, plan, steps = make_pattern(kind)
    compiled = compile_steps(steps)
    assert finding_codes(compiled) == {"landing_missing"}
    approach_m = next(each for each in compiled.segments if isinstance(each, CurveSegment)).length_m
    path_m = sum(each.length_m for each in compiled.segments if isinstance(each, CurveSegment)) - approach_m
    assert path_m == pytest.approx(estimate(plan, VehicleModel()).length_m, rel=0.05)


@pytest.mark.parametrize("kind", ["survey", "corridor", "structure"])
def test_the_mission_takes_the_pictures_of_the_pattern(kind: str) -> None:
    pattern, _, steps = make_pattern(kind)
    line_steps = [step for step in steps if isinstance(step, Fly) and step.photo_every_m is not None]
    assert compile_steps(steps).photos == pytest.approx(document.make(pattern).photos, abs=len(line_steps))
    title = {"survey": "Survey line", "corridor": "Corridor line", "structure": "Structure scan, round"}[kind]
    assert [step.name for step in line_steps] == [
        f"{title} {number + 1}" for number in range(len(line_steps))
    ]


def test_the_nose_points_along_the_lines_of_a_survey() -> None:
    """The pattern assumes that the longer side of each picture is across the line."""
    pattern, _, steps = make_pattern("survey")
    heading_deg = document.make(pattern).heading_deg
    assert heading_deg is not None
    photo_segments = [
        each for each in compile_steps(steps).segments if any(e.kind == "photo" for e in each.events)
    ]
    assert len(photo_segments) > 2
    for segment in photo_segments:
        setpoint = segment.at(segment.events[0].t_s)
        assert isinstance(setpoint, Trajectory)
        difference_deg = math.degrees(setpoint.yaw_ned_rad or 0.0) - heading_deg
        assert abs(math.remainder(difference_deg, 180.0)) < 1.0


def test_an_orbit_becomes_one_orbit_step_between_two_gimbal_steps() -> None:
    _, _, steps = make_pattern("orbit", clockwise=False, start_deg=90)
    gimbal_step, orbit_step, release_step = steps
    assert isinstance(orbit_step, Orbit)
    assert isinstance(gimbal_step, Gimbal)
    assert isinstance(release_step, Gimbal)
    assert (orbit_step.radius_m, orbit_step.turns, orbit_step.clockwise) == (25.0, 2.0, False)
    assert orbit_step.start_angle_ned_rad == pytest.approx(math.pi / 2)
    assert orbit_step.look_at == gimbal_step.place
    assert (gimbal_step.track, release_step.track) == ("look_at", "release")
    _, _, without_look_at = make_pattern("orbit", look_at=None)
    assert [step.step for step in without_look_at] == ["orbit"]


@pytest.mark.parametrize(
    ("kind", "field"), [("survey", "altitude"), ("structure", "base"), ("orbit", "altitude")]
)
def test_an_altitude_above_unknown_ground_is_refused(kind: str, field: str) -> None:
    with pytest.raises(PlanError, match="elevation files") as raised:
        make_pattern(kind, **{field: {"value_m": 30, "reference": "terrain"}})
    assert raised.value.field == field


def test_a_pattern_with_too_many_steps_is_refused() -> None:
    with pytest.raises(PlanError, match="the maximum is 1000"):
        make_pattern(
            "survey", coverage={**COVERAGE, "distance_m": 0.2, "front_overlap": 0.1}, crosshatch=True
        )
