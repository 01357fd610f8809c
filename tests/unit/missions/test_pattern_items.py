"""Patterns as objects of a plan: their items follow their values, everywhere a plan is read."""

from __future__ import annotations

import json
from typing import Any

import pytest

from missions import plan as plan_document
from missions.checks import check
from missions.errors import PlanError
from missions.formats import any_format, mavlink_items
from missions.items import Jump, Waypoint
from missions.offboard.from_plan import from_plan
from missions.plan import PatternItem, Plan
from missions.route import route_of
from missions.terrain.follow import follow_ground
from tests.support.survey_camera import CAMERA

CORNERS = [
    {"lat_deg": lat, "lon_deg": lon}
    for lat, lon in ((47.4, 8.5), (47.401, 8.5), (47.401, 8.502), (47.4, 8.502))
]
SURVEY: dict[str, Any] = {
    "kind": "survey",
    "outer": CORNERS,
    "coverage": {"camera": CAMERA, "distance_m": 40},
    "altitude": {"value_m": 40, "reference": "home"},
    "heading_deg": 0,
}
TAKEOFF = {"kind": "takeoff", **CORNERS[0], "altitude": SURVEY["altitude"]}
LAND = {"kind": "land", **CORNERS[0], "altitude": {"value_m": 0, "reference": "home"}}


def plan_with(pattern: dict[str, Any], *more: dict[str, Any], **fields: Any) -> Plan:
    items = [TAKEOFF, {"kind": "pattern", "pattern": pattern, **fields}, *more, LAND]
    home = {"planned_home": {**CORNERS[0], "alt_amsl_m": 400}}
    return plan_document.read(json.dumps({**home, "items": items}))


def pattern_in(plan: Plan) -> PatternItem:
    (item,) = [item for item in plan.items if isinstance(item, PatternItem)]
    return item


def headings(item: PatternItem) -> set[int]:
    from missions.geodesy import LocalOrigin

    origin = LocalOrigin(47.4, 8.5, 0.0)
    points = [origin.to_ned(i.lat_deg, i.lon_deg, 0.0) for i in item.items if isinstance(i, Waypoint)]
    pairs = list(zip(points[::2], points[1::2], strict=True))
    return {0 if abs(b[0] - a[0]) > abs(b[1] - a[1]) else 90 for a, b in pairs}


def test_a_pattern_without_items_gets_them_when_it_is_read() -> None:
    plan = plan_with(SURVEY)
    assert pattern_in(plan).is_current
    assert headings(pattern_in(plan)) == {0}
    assert len(mavlink_items.mission_items(plan)) == len(pattern_in(plan).items) + 2
    assert plan_document.read(plan_document.write(plan)) == plan


def test_a_changed_value_makes_new_lines_wherever_the_plan_is_read() -> None:
    text = json.loads(plan_document.write(plan_with(SURVEY)))
    old_items = text["items"][1]["items"]
    text["items"][1]["pattern"]["heading_deg"] = 90.0
    changed = pattern_in(plan_document.read(json.dumps(text)))
    assert headings(changed) == {90}
    assert [item.model_dump(mode="json") for item in changed.items] != old_items


def test_items_that_belong_to_the_pattern_are_kept() -> None:
    """For example those of a file of another program, or with altitudes from elevation data."""
    text = json.loads(plan_document.write(plan_with(SURVEY)))
    text["items"][1]["items"][0]["lat_deg"] = 47.4005
    kept = pattern_in(plan_document.read(json.dumps(text))).items[0]
    assert isinstance(kept, Waypoint)
    assert kept.lat_deg == 47.4005


def test_a_jump_keeps_its_target_when_the_number_of_lines_changes() -> None:
    text = json.loads(plan_document.write(plan_with(SURVEY)))
    count = len(text["items"][1]["items"])
    text["items"].append({"kind": "jump", "target_index": 1 + count, "repeat": 1})
    text["items"][1]["pattern"]["coverage"]["side_overlap"] = 0.8
    plan = plan_document.read(json.dumps(text))
    jump = plan.items[-1]
    assert isinstance(jump, Jump)
    assert len(pattern_in(plan).items) > count
    assert [item.kind for _, item in plan.simple_items()][jump.target_index] == "land"


@pytest.mark.parametrize(
    ("changes", "place", "field"),
    [
        ({"outer": CORNERS[:2]}, "item 2 (survey), the area: ", "items[1].pattern"),
        ({"outer": [CORNERS[0], CORNERS[2], CORNERS[1], CORNERS[3]]}, "item 2 (survey)", "items[1].pattern"),
        ({"coverage": {"distance_m": 40}}, "item 2 (pattern), field pattern.survey.coverage: ", None),
        ({"coverage": {"distance_m": 40, "camera": CAMERA, "spacing_m": 3}}, "item 2 (pattern)", None),
        ({"heading_deg": "north"}, "item 2 (pattern), field pattern.survey.heading_deg: ", None),
    ],
)
def test_a_pattern_that_cannot_be_flown_names_item_and_field(
    changes: dict[str, Any], place: str, field: str | None
) -> None:
    with pytest.raises(PlanError) as raised:
        plan_with({**SURVEY, **changes})
    assert str(raised.value).startswith(place)
    assert raised.value.fix
    assert raised.value.field == field


def test_findings_and_route_name_the_row_of_the_pattern_once() -> None:
    plan = plan_with({**SURVEY, "altitude": {"value_m": 200, "reference": "home"}})
    high = [finding for finding in check(plan) if finding.code == "altitude_too_high"]
    assert [finding.row for finding in high] == [1]
    assert "times in this pattern" in high[0].message
    assert {step.row for step in route_of(plan).steps} == {0, 1, 2}
    loose = plan.model_copy(update={"items": (plan.items[0], *pattern_in(plan).items, plan.items[2])})
    assert len([each for each in check(loose) if each.code == "altitude_too_high"]) > 5
    assert any_format.write("waypoints", plan).data == any_format.write("waypoints", loose).data
    assert from_plan(plan, "a").mission == from_plan(loose, "a").mission


def test_distances_by_hand_replace_a_camera() -> None:
    by_hand = {"distance_m": 40, "spacing_m": 25, "trigger_m": 0}
    item = pattern_in(plan_with({**SURVEY, "coverage": by_hand}))
    assert {inner.kind for inner in item.items} == {"waypoint"}
    with_photos = pattern_in(plan_with({**SURVEY, "coverage": {**by_hand, "trigger_m": 10}}))
    assert len(with_photos.items) == 2 * len(item.items)


def test_waypoints_that_follow_the_ground_are_inside_the_pattern() -> None:
    class Slope:
        spacing_m = 10.0

        def altitude_amsl_m(self, lat_deg: float, lon_deg: float) -> float:
            return 400.0 + 1e5 * abs(lat_deg - 47.4005)

        def altitudes_amsl_m(self, lat: Any, lon: Any) -> Any:
            import numpy as np

            return 400.0 + 1e5 * np.abs(lat - 47.4005) + 0.0 * lon

    plan = plan_with({**SURVEY, "altitude": {"value_m": 40, "reference": "terrain"}})
    followed = follow_ground(plan, Slope(), 5.0)  # type: ignore[arg-type]
    assert followed.added > 0
    assert [item.kind for item in followed.plan.items] == ["takeoff", "pattern", "land"]
    assert len(pattern_in(followed.plan).items) > len(pattern_in(plan).items)
    assert plan_document.read(plan_document.write(followed.plan)) == followed.plan
