"""Conversion of a waypoint plan to an offboard mission with the same positions."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import given, settings

from missions.camera_items import TriggerDistance
from missions.errors import PlanError
from missions.items import Delay, Jump, Land, LoiterUnlimited, ReturnHome, Takeoff, Waypoint
from missions.offboard.compiler import compile_mission
from missions.offboard.from_plan import from_plan
from missions.offboard.reader import read
from missions.offboard.segments import WaitSegment
from missions.offboard.steps import Fly
from missions.plan import Plan
from missions.values import Altitude
from tests.support.offboard_missions import HOME, finding_codes, segment_titles
from tests.support.plan_strategies import RESOLVED_ALTITUDES, plans

DEG_PER_M = 1.0 / 111_194.9


def alt(value_m: float) -> Altitude:
    return Altitude(value_m=value_m, reference="home")


def test_a_waypoint_plan_becomes_a_mission() -> None:
    plan = Plan(
        planned_home=HOME,
        items=(
            Takeoff(lat_deg=47.0, lon_deg=8.0, altitude=alt(20.0)),
            Waypoint(lat_deg=47.0 + 50 * DEG_PER_M, lon_deg=8.0, altitude=alt(20.0)),
            Waypoint(lat_deg=47.0 + 100 * DEG_PER_M, lon_deg=8.0, altitude=alt(30.0), hold_s=5.0),
            Jump(target_index=1, repeat=1),
            Delay(delay_s=3.0),
            LoiterUnlimited(lat_deg=47.0, lon_deg=8.0, altitude=alt(20.0)),
        ),
    )
    converted = from_plan(plan, "From a plan")
    compiled = compile_mission(converted.mission)
    assert segment_titles(compiled)[:5] == ["Take off", "Fly", "Hold", "Fly", "Hold"]
    assert finding_codes(compiled) <= {"landing_missing"}
    assert [segment.kind for segment in compiled.segments if isinstance(segment, WaitSegment)] == [
        "take_off",
        "person",
    ]
    assert read(converted.mission.model_dump_json(exclude_none=True)) == converted.mission


def test_a_return_and_a_landing_end_at_home() -> None:
    items = (
        Takeoff(lat_deg=47.0, lon_deg=8.0, altitude=alt(20.0)),
        Waypoint(lat_deg=47.0005, lon_deg=8.0, altitude=alt(20.0)),
    )
    for last_item in (ReturnHome(), Land(lat_deg=47.0, lon_deg=8.0, altitude=alt(0.0))):
        compiled = compile_mission(from_plan(Plan(planned_home=HOME, items=(*items, last_item)), "x").mission)
        assert compiled.findings == ()
        assert compiled.segments[-1].end_ned_m == pytest.approx((0, 0, 0), abs=1e-3)


@settings(deadline=None, max_examples=30)
@given(plan=plans(altitudes=RESOLVED_ALTITUDES))
def test_any_plan_gives_a_mission_or_a_plan_error(plan: Plan) -> None:
    with contextlib.suppress(PlanError):
        mission = from_plan(plan, "Any plan").mission
        assert read(mission.model_dump_json(exclude_none=True)) == mission


@pytest.mark.parametrize("distance_m", [-1.0, 0.0, None])
def test_a_trigger_distance_that_is_not_above_zero_ends_the_photos(distance_m: float | None) -> None:
    def waypoint(number: int) -> Waypoint:
        return Waypoint(lat_deg=47.0 + number * 10 * DEG_PER_M, lon_deg=8.0, altitude=alt(20.0))

    items = (
        Takeoff(lat_deg=47.0, lon_deg=8.0, altitude=alt(20.0)),
        TriggerDistance(distance_m=5.0), waypoint(1), waypoint(2),
        TriggerDistance(distance_m=distance_m), waypoint(3), waypoint(4),
    )  # fmt: skip
    mission = from_plan(Plan(planned_home=HOME, items=items), "x").mission
    assert [step.photo_every_m for step in mission.steps if isinstance(step, Fly)][-2:] == [5.0, None]
