"""One survey divided over several vehicles: each line flown once, in equal times, and all stay apart."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.errors import PlanError
from missions.offboard.division import LAYER_GAP_M, MIN_HEIGHT_M, Division, divide, planned_starts
from missions.offboard.roles import compile_roles
from missions.offboard.roles import planned_starts as starts_of
from missions.offboard.state import MissionVehicle
from missions.offboard.steps import Fly, Land, Meet, TakeOff
from missions.patterns.current import pattern_item
from missions.patterns.document import make
from missions.plan import Plan
from missions.separation import planned_margin_m
from missions.values import Altitude, HomePosition
from tests.support.surveys import FIELD, HOME, ORIGIN, survey, survey_plan


def divided(plan: Plan, count: int, minimum_m: float = 5.0) -> Division:
    starts = planned_starts(HOME, count, minimum_m)
    return divide(plan, None, starts, "Field", minimum_m=minimum_m)


def local(point) -> tuple[float, float]:
    north_m, east_m, _ = ORIGIN.to_ned(point.lat_deg, point.lon_deg, 0.0)
    return north_m, east_m


def length_m(line) -> float:
    return math.dist(*map(local, line))


def distance_to_line_m(point, line) -> float:
    (n, e), (n1, e1), (n2, e2) = local(point), *map(local, line)
    squared = (n2 - n1) ** 2 + (e2 - e1) ** 2
    share = min(1.0, max(0.0, ((n - n1) * (n2 - n1) + (e - e1) * (e2 - e1)) / squared))
    return math.dist((n, e), (n1 + share * (n2 - n1), e1 + share * (e2 - e1)))


corner = st.tuples(st.floats(-150.0, 150.0), st.floats(-150.0, 150.0))


@settings(max_examples=40, deadline=None)
@given(
    angles=st.lists(st.floats(0.0, math.tau), min_size=3, max_size=7, unique=True),
    radius_m=st.floats(90.0, 250.0),
    hole=st.booleans(),
    count=st.integers(2, 5),
)
def test_the_parts_are_the_lines_of_the_survey_each_flown_once(angles, radius_m, hole, count):
    corners = [(radius_m * math.cos(a), radius_m * math.sin(a)) for a in sorted(angles)]
    holes = [[(-5, -5), (-5, 5), (5, 5), (5, -5)]] if hole else []
    try:
        pattern = survey(corners, holes=holes)
        plan = survey_plan(pattern)
    except PlanError:
        return  # the drawn area cannot be surveyed
    whole = _lines(plan)
    try:
        parts = divided(plan, count).parts
    except PlanError:
        assert len(whole) < 2 * count  # too small for so many vehicles
        return
    pieces = [line for part in parts for line in part.lines]
    assert sum(map(length_m, pieces)) == pytest.approx(sum(map(length_m, whole)), abs=0.05)
    for line in whole:
        own = [each for each in pieces if all(distance_to_line_m(end, line) < 0.05 for end in each)]
        assert sum(map(length_m, own)) == pytest.approx(length_m(line), abs=0.05)
        assert len(own) <= count
    assert len(pieces) <= len(whole) + count - 1


def _lines(plan: Plan):
    (item,) = plan.items
    return make(item.pattern).lines


def compiled(division: Division):
    mission = division.mission
    return compile_roles(mission, dict.fromkeys(mission.roles, MissionVehicle()), starts_of(mission))


@pytest.mark.parametrize(
    ("corners", "count"),
    [
        (FIELD, 2),
        (FIELD, 3),
        ([(40, -100), (40, 100), (200, 0)], 3),
        ([(-150, -150), (-150, 150), (150, 150), (150, -150)], 5),
    ],
)
def test_all_vehicles_need_the_same_time_and_stay_apart(corners, count):
    flown = compiled(divided(survey_plan(survey(corners)), count))
    times_s = [each.duration_s for each in flown.timelines.values()]
    assert max(times_s) < 1.1 * min(times_s)
    assert [each.code for each in flown.findings if each.is_error] == []
    assert min(each.distance_m for each in flown.closest) >= 5.0 + planned_margin_m() - 0.01


def test_vehicles_that_take_off_side_by_side_have_layers_and_far_ones_have_none():
    plan = survey_plan(survey(FIELD))
    near = divided(plan, 3)
    assert sorted(round(each.layer_m, 1) for each in near.parts) == [0.0, 8.9, 17.8]
    places = [(0.0, -300.0), (0.0, 0.0), (0.0, 300.0)]
    wide = [(40, -330), (40, 330), (160, 330), (160, -330)]
    starts = [_home(north_m, east_m) for north_m, east_m in places]
    far = divide(survey_plan(survey(wide, heading_deg=0.0)), 0, starts, "Field", minimum_m=5.0)
    assert [(each.vehicle, each.layer_m) for each in far.parts] in (
        [(0, 0.0), (1, 0.0), (2, 0.0)],
        [(2, 0.0), (1, 0.0), (0, 0.0)],
    )


def _home(north_m: float, east_m: float, up_m: float = 0.0) -> HomePosition:
    lat_deg, lon_deg, alt_amsl_m = ORIGIN.to_geodetic((north_m, east_m, -up_m))
    return HomePosition(lat_deg=lat_deg, lon_deg=lon_deg, alt_amsl_m=alt_amsl_m)


def test_each_vehicle_takes_off_waits_flies_its_lines_and_returns_to_where_it_took_off():
    division = divided(survey_plan(survey(FIELD)), 3)
    for part in division.parts:
        steps = division.mission.roles[part.role].steps
        assert (type(steps[0]), type(steps[-1])) == (TakeOff, Land)
        assert [each.meeting for each in steps if isinstance(each, Meet)] == [
            "all up", "at the lines", "lines done", "all back",
        ]  # fmt: skip
        assert steps[0].height_m == pytest.approx(30.0 + part.layer_m)
        back = steps[-3]
        assert isinstance(back, Fly)
        assert back.points[0].offset_ned_m == pytest.approx((0.0, 0.0, -30.0 - part.layer_m))


def test_take_offs_at_different_heights_widen_the_layers_of_altitudes_above_home():
    plan = survey_plan(survey(FIELD))
    starts = [_home(0.0, 0.0), _home(0.0, 12.0, 4.0)]
    margin_m = planned_margin_m() + LAYER_GAP_M
    above_home = divide(plan, None, starts, "Field", minimum_m=5.0)
    assert max(each.layer_m for each in above_home.parts) == pytest.approx(9.0 + margin_m, abs=0.01)
    amsl = pattern_item(survey(FIELD, altitude=Altitude(value_m=510.0, reference="amsl")))
    above_sea = divide(Plan(items=(amsl,)), None, starts, "Field", minimum_m=5.0)
    assert max(each.layer_m for each in above_sea.parts) == pytest.approx(5.0 + margin_m, abs=0.01)
    heights_m = [
        above_sea.mission.roles[each.role].steps[0].height_m - each.layer_m for each in above_sea.parts
    ]
    assert sorted(heights_m) == pytest.approx([26.0, 30.0], abs=0.01)


def test_what_cannot_be_divided_is_refused_with_field_and_fix():
    crosshatch = survey_plan(survey(FIELD, crosshatch=True))
    terrain = survey_plan(survey(FIELD, altitude=Altitude(value_m=30.0, reference="terrain")))
    low = survey_plan(survey(FIELD, altitude=Altitude(value_m=MIN_HEIGHT_M - 1.0, reference="home")))
    small = survey_plan(survey([(0, 0), (0, 15), (15, 15), (15, 0)]))
    two = Plan(items=(*low.items, *low.items))
    refusals = [
        (crosshatch, 3, "item", "crosshatch"),
        (terrain, 3, "item", "above the ground"),
        (low, 3, "item", "above a take-off position"),
        (small, 9, "vehicles", "too few"),
        (survey_plan(survey(FIELD)), 11, "vehicles", "2 to 10"),
        (two, 3, "item", "2 surveys"),
        (Plan(planned_home=HOME), 3, "item", "0 surveys"),
    ]
    for plan, count, field, reason in refusals:
        with pytest.raises(PlanError, match=reason) as refused:
            divided(plan, count)
        assert refused.value.field == field
        assert refused.value.fix
