"""QGroundControl's .plan files: reading and writing keeps everything that the user did not change."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions import plan as plan_document
from missions.errors import PlanError
from missions.formats import mavlink_items, qgc_plan
from missions.items import CommandItem, Jump, Waypoint
from missions.plan import PatternItem, Plan, without_originals
from missions.values import Altitude
from tests.support.plan_files import FOLDER, plan_file, plan_file_with, same_json
from tests.support.plan_strategies import HOMES, RESOLVED_ALTITUDES, plans

FILES = sorted(FOLDER.glob("*.plan"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_qgroundcontrol_file_is_written_unchanged(path: Path) -> None:
    imported = qgc_plan.read(path.read_bytes())
    assert same_json(qgc_plan.write(imported.plan).data, path.read_bytes())
    from_own_format = plan_document.read(plan_document.write(imported.plan))
    assert from_own_format == imported.plan
    assert same_json(qgc_plan.write(from_own_format).data, path.read_bytes())


def test_altitudes_are_read_with_their_references() -> None:
    plan = qgc_plan.read(plan_file("simple")).plan
    assert [item.altitude for item in plan.items[:5] if hasattr(item, "altitude")] == [
        Altitude(value_m=15.0, reference="home"),
        Altitude(value_m=15.0, reference="home"),
        Altitude(value_m=505.25, reference="amsl"),
        Altitude(value_m=30.0, reference="terrain", resolved_amsl_m=521.73),
        Altitude(value_m=25.0, reference="terrain"),
    ]
    assert (plan.hover_speed_m_s, plan.cruise_speed_m_s) == (5.0, 15.0)


def test_a_jump_targets_its_item_by_the_number_in_the_file() -> None:
    plan = qgc_plan.read(plan_file("survey")).plan
    jump = plan.items[2]
    assert isinstance(jump, Jump)
    simple_items = [item for _, item in plan.simple_items()]
    assert isinstance(simple_items[jump.target_index], Waypoint)
    assert jump.target_index == 1
    shifted_plan = plan.model_copy(update={"items": (plan.items[0], *plan.items)})
    shifted_plan = shifted_plan.model_copy(
        update={"items": (*shifted_plan.items[:3], jump.model_copy(update={"target_index": 2}))}
    )
    read_back = qgc_plan.read(qgc_plan.write(shifted_plan).data).plan.items[3]
    assert isinstance(read_back, Jump)
    assert read_back.target_index == 2


def test_a_survey_is_flown_as_the_items_inside_it() -> None:
    plan = qgc_plan.read(plan_file("survey")).plan
    assert isinstance(plan.items[1], PatternItem)
    assert len(plan.items[1].items) == 8
    assert [item.command for item in mavlink_items.mission_items(plan)] == [22, *[16, 206] * 4, 177, 21]


def test_a_pattern_without_items_is_kept_and_reported() -> None:
    path = ["mission", "items", 1, "complexItemType"]
    imported = qgc_plan.read(plan_file_with("structure", path, "vtolLandingPattern"))
    note = "Item 2 (vtolLandingPattern) contains no mission items: it is kept, but cannot be flown."
    assert imported.notes == (note,)


def test_a_changed_item_keeps_unknown_fields() -> None:
    plan = qgc_plan.read(plan_file("fence_rally_unknown")).plan
    takeoff = plan.items[0].model_copy(update={"altitude": Altitude(value_m=33.0, reference="home")})
    changed = plan.model_copy(update={"items": (takeoff, *plan.items[1:]), "hover_speed_m_s": 4.0})
    before, after = json.loads(plan_file("fence_rally_unknown")), json.loads(qgc_plan.write(changed).data)
    before["mission"]["items"][0] |= {"Altitude": 33}
    before["mission"]["items"][0]["params"][6] = 33
    before["mission"]["hoverSpeed"] = 4.0
    assert json.dumps(after) == json.dumps(before)


def test_changing_a_fence_zone_or_rally_point_changes_nothing_else_in_the_file() -> None:
    plan = qgc_plan.read(plan_file("fence_rally_unknown")).plan
    circle = next(zone for zone in plan.fence if zone.shape == "circle")
    zones = tuple(
        zone.model_copy(update={"radius_m": 99.0}) if zone is circle else zone for zone in plan.fence
    )
    rally = plan.rally_points[1].model_copy(update={"lat_deg": 47.0})
    changed = plan.model_copy(update={"fence": zones, "rally_points": (plan.rally_points[0], rally)})
    before, after = json.loads(plan_file("fence_rally_unknown")), json.loads(qgc_plan.write(changed).data)
    before["geoFence"]["circles"][0]["circle"]["radius"] = 99.0
    before["rallyPoints"]["points"][1] = [47.0, 8.54559, 12.5]
    assert json.dumps(after) == json.dumps(before)


@settings(deadline=None, max_examples=30)
@given(plan=plans(altitudes=RESOLVED_ALTITUDES, homes=HOMES))
def test_any_plan_is_unchanged_after_writing_and_reading_a_plan_file(plan: Plan) -> None:
    rally = tuple(
        point.model_copy(update={"altitude": Altitude(value_m=point.altitude.value_m, reference="home")})
        for point in plan.rally_points
    )
    count = len(plan.items)
    items = tuple(
        item.model_copy(update={"target_index": item.target_index % count})
        if isinstance(item, Jump)
        else item
        for item in plan.items
    )
    plan = plan.model_copy(update={"rally_points": rally, "items": items})
    assert without_originals(qgc_plan.read(qgc_plan.write(plan).data).plan) == plan


any_json = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**60), 2**60) | st.floats(-1e9, 1e9) | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=6,
)


def with_unknown_keys(value: Any, draw: Any) -> Any:
    """The same JSON with unknown keys in any of its objects."""
    if isinstance(value, list):
        return [with_unknown_keys(each, draw) for each in value]
    if not isinstance(value, dict):
        return value
    pairs = [(key, with_unknown_keys(each, draw)) for key, each in value.items()]
    if draw(st.booleans()):
        pairs.insert(draw(st.integers(0, len(pairs))), ("x-" + draw(st.text(max_size=4)), draw(any_json)))
    return dict(pairs)


@settings(deadline=None, max_examples=30)
@given(plan=plans(homes=HOMES), data=st.data())
def test_unknown_keys_are_written_back_in_their_order(plan: Plan, data: st.DataObject) -> None:
    plan = plan.model_copy(update={"rally_points": (), "obstacles": ()})
    document = with_unknown_keys(json.loads(qgc_plan.write(plan).data), data.draw)
    content = json.dumps(document).encode()
    assert same_json(qgc_plan.write(qgc_plan.read(content).plan).data, content)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (["fileType"], "Mission", r'field fileType: it is not "Plan"\. Choose a \.plan file\.'),
        (["mission"], None, "field mission: it is missing or not an object"),
        (["mission", "version"], 1, r"field mission\.version: version 1 is not supported"),
        (["mission", "items", 0], 7, "item 1: it is missing or not an object"),
        (
            ["mission", "items", 1, "params", 4],
            "47",
            r"item 2, field params\[4\]: it is missing",
        ),
        (["mission", "items", 1, "params", 4], 95.0, "item 2, field lat_deg: .*less than or equal to 90"),
        (["mission", "items", 1, "params", 0], 1e308, r"item 2, field params\[0\]: it is out of range"),
        (["mission", "items", 1, "params"], [1, 2], "item 2, field params: it has 2 values, not 7"),
        (["mission", "items", 1, "command"], 16.5, "item 2, field command: it is not a whole number"),
        (["mission", "items", 1, "command"], True, "item 2, field command: it is missing or not a number"),
        (["mission", "items", 1, "autoContinue"], 1, "item 2, field autoContinue: it is neither"),
        (["mission", "plannedHomePosition"], [1, 2], "plannedHomePosition: it has 2 numbers, not 3"),
        (["mission", "hoverSpeed"], "fast", r"field mission\.hoverSpeed: it is missing or not a number"),
        (["geoFence", "polygons"], {}, r"field geoFence\.polygons: it is missing or not a list"),
        (
            ["geoFence", "polygons"],
            [{"inclusion": True, "polygon": [[1, 2]]}],
            "polygon 1, field polygon",
        ),
        (
            ["geoFence", "circles"],
            [{"inclusion": True, "circle": {"center": [1, 2], "radius": -1}}],
            "circle 1",
        ),
        (["rallyPoints", "points"], [[47, 8]], "rally point 1: it has no altitude"),
    ],
)
def test_the_error_for_an_invalid_value_names_item_field_and_fix(
    path: list[str | int], value: Any, message: str
) -> None:
    with pytest.raises(PlanError, match=message):
        qgc_plan.read(plan_file_with("simple", path, value))


def test_a_jump_to_a_missing_item_is_kept_unchanged() -> None:
    content = plan_file_with("simple", ["mission", "items", 9, "params", 0], 77)
    plan = qgc_plan.read(content).plan
    assert isinstance(plan.items[9], CommandItem)
    assert same_json(qgc_plan.write(plan).data, content)


def test_a_home_without_altitude_counts_as_not_set_and_is_kept_in_the_file() -> None:
    content = plan_file_with("simple", ["mission", "plannedHomePosition"], [47.4, 8.5, None])
    imported = qgc_plan.read(content)
    assert imported.plan.planned_home is None
    assert imported.notes == ("The planned home has no altitude, so it counts as not set.",)
    assert same_json(qgc_plan.write(imported.plan).data, content)


def test_a_rally_altitude_that_the_file_cannot_store_is_refused() -> None:
    plan = Plan.model_validate_json(
        '{"rally_points": [{"lat_deg": 1, "lon_deg": 8, "altitude": {"value_m": 5, "reference": "terrain"}}]}'
    )
    with pytest.raises(PlanError, match="rally point 1, field altitude"):
        qgc_plan.write(plan)
