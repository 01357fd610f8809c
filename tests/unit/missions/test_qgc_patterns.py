"""QGroundControl's survey, corridor and structure scan: read as patterns, written back as its own."""

from __future__ import annotations

import json
import math
from itertools import groupby
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions import plan as plan_document
from missions.errors import PlanError
from missions.formats import qgc_plan
from missions.items import ChangeSpeed, Waypoint
from missions.pattern_settings import StructurePattern, SurveyPattern
from missions.plan import ComplexItem, PatternItem, Plan
from missions.values import Altitude, Point
from tests.support.plan_files import plan_file, plan_file_with, same_json

TRANSECTS = "TransectStyleComplexItem"
GIMBAL_SURVEY_ROW = 4
DERIVED = {"Items", "VisualTransectPoints", "CameraShots"}
"""Keys that contain the lines, which follow from all others."""


def complex_item(content: bytes, row: int = 1) -> dict[str, Any]:
    return json.loads(content)["mission"]["items"][row]


def changed_keys(before: Any, after: Any, path: str = "") -> set[str]:
    """Paths of the keys whose values differ, without the lines."""
    if isinstance(before, dict) and isinstance(after, dict):
        found: set[str] = set()
        for key in before.keys() | after.keys():
            if key not in DERIVED:
                found |= changed_keys(before.get(key), after.get(key), f"{path}{key}.")
        return found
    return set() if json.dumps(before) == json.dumps(after) else {path.rstrip(".")}


def with_pattern(content: bytes, changes: dict[str, Any], row: int = 1) -> Plan:
    """The plan of a file with other values of its pattern, as a client changes them."""
    text = json.loads(plan_document.write(qgc_plan.read(content).plan))
    text["items"][row]["pattern"] |= changes
    return plan_document.read(json.dumps(text))


def pattern_at(plan: Plan, row: int = 1) -> PatternItem:
    item = plan.items[row]
    assert isinstance(item, PatternItem)
    return item


def test_a_survey_opens_as_a_pattern_with_the_items_of_the_file() -> None:
    item = pattern_at(qgc_plan.read(plan_file("survey_gimbal_fence")).plan, GIMBAL_SURVEY_ROW)
    pattern = item.pattern
    assert isinstance(pattern, SurveyPattern)
    assert pattern.altitude == Altitude(value_m=8.0, reference="home")
    assert (pattern.heading_deg, pattern.coverage.front_overlap) == (0.0, 0.7)
    assert pattern.coverage.camera is not None
    assert pattern.coverage.camera.image_width_px == 5456
    assert len(item.items) == 8
    assert isinstance(item.items[0], Waypoint)
    assert item.items[0].lon_deg == 8.54564715  # the file's own lines


def test_a_structure_scan_gets_the_rounds_that_qgroundcontrol_flies() -> None:
    """Layers of the height of the frontal footprint (25 m) from the bottom of the scan (5 m) up, between
    two passages at the entrance altitude."""
    item = pattern_at(qgc_plan.read(plan_file("structure")).plan)
    assert isinstance(item.pattern, StructurePattern)
    heights_m = [each.altitude.value_m for each in item.items if isinstance(each, Waypoint)]
    assert [height for height, _ in groupby(heights_m)] == [50.0, 17.5, 42.5, 50.0]


CHANGES: dict[str, tuple[str, int, dict[str, Any], set[str]]] = {
    "angle": ("survey", 1, {"heading_deg": 100.0}, {"angle"}),
    "turnaround": ("survey", 1, {"turnaround_m": 5.0}, {f"{TRANSECTS}.TurnAroundDistance"}),
    "crosshatch": ("survey", 1, {"crosshatch": True}, {f"{TRANSECTS}.Refly90Degrees"}),
    "width": ("corridor", 1, {"width_m": 60.0}, {"CorridorWidth"}),
    "from_top": ("structure", 1, {"from_top": True, "layers": 1}, {"StartFromTop", "Layers"}),
    "pitch": ("structure", 1, {"gimbal_pitch_deg": -10.0}, {"GimbalPitch"}),
    "overlap": (
        "survey_gimbal_fence",
        GIMBAL_SURVEY_ROW,
        {"altitude": {"value_m": 8.0, "reference": "amsl"}},
        {f"{TRANSECTS}.CameraCalc.DistanceMode"},
    ),
}


@pytest.mark.parametrize("name", CHANGES)
def test_only_the_keys_of_the_changed_value_change(name: str) -> None:
    file, row, changes, keys = CHANGES[name]
    plan = with_pattern(plan_file(file), changes, row)
    written = qgc_plan.write(plan).data
    assert changed_keys(complex_item(plan_file(file), row), complex_item(written, row)) == keys
    again = pattern_at(qgc_plan.read(written).plan, row)
    assert again.pattern == pattern_at(plan, row).pattern
    others = [json.loads(each)["mission"]["items"] for each in (plan_file(file), written)]
    assert json.dumps([i for n, i in enumerate(others[0]) if n < row]) == json.dumps(others[1][:row])


def test_a_changed_overlap_changes_the_lines_and_their_keys() -> None:
    content = plan_file("survey_gimbal_fence")
    text = json.loads(plan_document.write(qgc_plan.read(content).plan))
    text["items"][GIMBAL_SURVEY_ROW]["pattern"]["coverage"]["side_overlap"] = 0.8
    plan = plan_document.read(json.dumps(text))
    assert len(pattern_at(plan, GIMBAL_SURVEY_ROW).items) > 8
    written = qgc_plan.write(plan).data
    camera = f"{TRANSECTS}.CameraCalc."
    assert changed_keys(
        complex_item(content, GIMBAL_SURVEY_ROW), complex_item(written, GIMBAL_SURVEY_ROW)
    ) == {f"{camera}SideOverlap", f"{camera}AdjustedFootprintSide"}
    lines = complex_item(written, GIMBAL_SURVEY_ROW)[TRANSECTS]["Items"]
    assert len(lines) == len(pattern_at(plan, GIMBAL_SURVEY_ROW).items)


def test_another_camera_has_no_known_name() -> None:
    content = plan_file("survey_gimbal_fence")
    text = json.loads(plan_document.write(qgc_plan.read(content).plan))
    text["items"][GIMBAL_SURVEY_ROW]["pattern"]["coverage"]["camera"]["focal_length_mm"] = 20.0
    written = qgc_plan.write(plan_document.read(json.dumps(text))).data
    camera = complex_item(written, GIMBAL_SURVEY_ROW)[TRANSECTS]["CameraCalc"]
    assert (camera["CameraName"], camera["FocalLength"]) == ("Custom Camera", 20)


def points(n: int) -> st.SearchStrategy[list[list[float]]]:
    """Corners around a place, in order of their bearing, so that the sides do not cross."""

    def corners(radii: list[float]) -> list[list[float]]:
        step = math.tau / len(radii)
        return [[47.4 + r * math.cos(k * step), 8.5 + r * math.sin(k * step)] for k, r in enumerate(radii)]

    return st.lists(st.floats(0.0005, 0.002), min_size=n, max_size=8).map(corners)


EDITS = st.fixed_dictionaries(
    {},
    optional={
        "heading_deg": st.floats(-90.0, 180.0),
        "turnaround_m": st.floats(0.0, 50.0),
        "crosshatch": st.booleans(),
        "outer": points(3).map(lambda corners: [{"lat_deg": lat, "lon_deg": lon} for lat, lon in corners]),
    },
)
KEYS = {
    "heading_deg": "angle",
    "turnaround_m": f"{TRANSECTS}.TurnAroundDistance",
    "crosshatch": f"{TRANSECTS}.Refly90Degrees",
    "outer": "polygon",
}


@settings(deadline=None, max_examples=25)
@given(
    polygon=points(3),
    distance_m=st.floats(20.0, 80.0),
    angle=st.floats(-90.0, 90.0),
    unknown=st.dictionaries(
        st.text(max_size=4).map("x-{}".format), st.integers() | st.text(max_size=4), max_size=3
    ),
    edits=EDITS,
)
def test_a_survey_keeps_all_keys_that_were_not_changed(
    polygon: list[list[float]],
    distance_m: float,
    angle: float,
    unknown: dict[str, Any],
    edits: dict[str, Any],
) -> None:
    content = json.loads(plan_file("survey"))
    part = content["mission"]["items"][1]
    part |= {"polygon": polygon, "angle": angle, **unknown}
    part[TRANSECTS] |= unknown
    part[TRANSECTS]["CameraCalc"] |= {"DistanceToSurface": distance_m, **unknown}
    file = json.dumps(content).encode()
    assert same_json(qgc_plan.write(qgc_plan.read(file).plan).data, file)
    plan = with_pattern(file, edits)
    written = qgc_plan.write(plan).data
    allowed = {KEYS[name] for name in edits}
    assert changed_keys(complex_item(file), complex_item(written)) <= allowed
    assert pattern_at(qgc_plan.read(written).plan).pattern == pattern_at(plan).pattern


CAMERA = {
    "sensor_width_mm": 13.2,
    "sensor_height_mm": 8.8,
    "focal_length_mm": 8.8,
    "image_width_px": 5472,
    "image_height_px": 3648,
}
CORNERS = [Point(lat_deg=lat, lon_deg=lon) for lat, lon in ((47.4, 8.5), (47.402, 8.5), (47.402, 8.502))]
COVERAGE = {"camera": CAMERA, "distance_m": 40.0}
AT_40_M = {"value_m": 40.0, "reference": "home"}


def own_plan(pattern: dict[str, Any]) -> Plan:
    corners = [corner.model_dump() for corner in CORNERS]
    for key in ("outer", "points", "outline"):
        if key in pattern:
            pattern = {**pattern, key: corners}
    return plan_document.read(json.dumps({"items": [{"kind": "pattern", "pattern": pattern}]}))


@pytest.mark.parametrize(
    "pattern",
    [
        {"kind": "survey", "outer": 0, "coverage": COVERAGE, "altitude": AT_40_M, "heading_deg": 30.0},
        {"kind": "survey", "outer": 0, "coverage": {**COVERAGE, "distance_m": 30.0}, "altitude": AT_40_M},
        {"kind": "corridor", "points": 0, "coverage": COVERAGE, "altitude": AT_40_M, "width_m": 50.0},
        {
            "kind": "structure",
            "outline": 0,
            "coverage": {**COVERAGE, "distance_m": 10.0},
            "base": {"value_m": 0.0, "reference": "home"},
            "height_m": 30.0,
            "lowest_m": 8.0,
            "layers": 2,
            "entrance": AT_40_M,
        },
    ],
)
def test_an_own_pattern_is_written_as_qgroundcontrols(pattern: dict[str, Any]) -> None:
    plan = own_plan(pattern)
    written = qgc_plan.write(plan)
    read = pattern_at(qgc_plan.read(written.data).plan, 0)
    assert [item.model_dump(exclude={"original"}) for item in read.items] == [
        item.model_dump(exclude={"original"}) for item in pattern_at(plan, 0).items
    ]
    stale = read.model_copy(update={"items_key": ""})
    remade = plan_document.read(plan_document.write(Plan(items=(stale,))))
    assert len(pattern_at(remade, 0).items) == len(read.items)
    if "heading_deg" in pattern:
        assert read.pattern == pattern_at(plan, 0).pattern


@pytest.mark.parametrize(
    ("pattern", "reason"),
    [
        ({"kind": "perimeter", "outer": 0, "altitude": AT_40_M}, "no such pattern"),
        (
            {
                "kind": "structure",
                "outline": 0,
                "coverage": {**COVERAGE, "distance_m": 10.0},
                "base": {"value_m": 400.0, "reference": "amsl"},
                "height_m": 30.0,
            },
            "above home only",
        ),
    ],
)
def test_a_pattern_that_qgroundcontrol_does_not_have_is_written_as_its_items(
    pattern: dict[str, Any], reason: str
) -> None:
    plan = own_plan(pattern)
    written = qgc_plan.write(plan)
    assert reason in written.notes[0]
    assert written.notes[0].startswith(f"Item 1 ({pattern['kind']})")
    assert len(json.loads(written.data)["mission"]["items"]) == len(pattern_at(plan, 0).items)


def test_the_speed_of_a_survey_is_an_item_before_it() -> None:
    plan = own_plan(
        {"kind": "survey", "outer": 0, "coverage": COVERAGE, "altitude": AT_40_M, "speed_m_s": 4.0}
    )
    read = qgc_plan.read(qgc_plan.write(plan).data).plan
    assert isinstance(read.items[0], ChangeSpeed)
    assert len(pattern_at(read, 1).items) == len(pattern_at(plan, 0).items) - 1


@pytest.mark.parametrize(
    ("file", "row", "path", "value", "message"),
    [
        ("survey", 1, ["polygon"], None, r"item 2 \(survey\), field polygon: it is missing or not a list"),
        ("survey", 1, ["polygon"], [[1, 2]], "field polygon: it has 1 points, but 3 to 2000"),
        ("survey", 1, ["polygon", 1], [95, 8], r"field polygon\[1\]: 95, 8 is not on the earth"),
        ("survey", 1, ["angle"], "north", "field angle: it is missing or not a number"),
        ("survey", 1, ["angle"], 1e300, "field angle: it is out of range"),
        ("survey", 1, ["version"], None, "field version: it is missing"),
        ("survey", 1, [TRANSECTS], 7, "field TransectStyleComplexItem: it is missing or not an object"),
        ("survey", 1, [TRANSECTS, "TurnAroundDistance"], -1, r"TurnAroundDistance: -1 is not between 0 and"),
        ("survey", 1, [TRANSECTS, "CameraCalc", "DistanceMode"], 9, r"CameraCalc\.DistanceMode: it is not 1"),
        (
            "survey",
            1,
            [TRANSECTS, "CameraCalc", "DistanceToSurface"],
            0,
            "Surface: 0 is not above 0",
        ),
        ("survey", 1, [TRANSECTS, "CameraCalc", "CameraName"], 5, "CameraName: it is missing or not a text"),
        ("survey", 1, [TRANSECTS, "Refly90Degrees"], 1, "Refly90Degrees: it is neither true nor false"),
        ("corridor", 1, ["polyline"], [[1, 2]], "field polyline: it has 1 points, but 2 to 2000"),
        ("corridor", 1, ["CorridorWidth"], -4, "field CorridorWidth: -4 is not between 0 and"),
        ("structure", 1, ["Layers"], 1e9, "field Layers: 1e.09 is not between 1 and 100"),
        ("structure", 1, ["Layers"], 1.5, "field Layers: it is not a whole number"),
        ("structure", 1, ["StructureHeight"], True, "field StructureHeight: it is missing or not a number"),
        ("structure", 1, ["EntranceAltitude"], None, "field EntranceAltitude: it is missing"),
        ("survey_gimbal_fence", 4, [TRANSECTS, "CameraCalc", "SideOverlap"], 100, "SideOverlap: 100 is not"),
        (
            "survey_gimbal_fence",
            4,
            [TRANSECTS, "CameraCalc", "FocalLength"],
            0,
            "FocalLength: 0 is not",
        ),
    ],
)
def test_a_missing_or_hostile_value_is_named(
    file: str, row: int, path: list[str | int], value: Any, message: str
) -> None:
    with pytest.raises(PlanError, match=message):
        qgc_plan.read(plan_file_with(file, ["mission", "items", row, *path], value))


@pytest.mark.parametrize(
    ("file", "path", "value", "note"),
    [
        ("survey", ["version"], 3, "version 3 of this pattern is not known"),
        ("survey", [TRANSECTS, "HoverAndCapture"], True, "stops for each photo"),
        ("structure", ["Layers"], 100, ""),
        ("structure", ["StructureHeight"], 0, "height_m"),
        ("structure", ["complexItemType"], "fwLandingPattern", "contains no mission items"),
    ],
)
def test_a_pattern_that_cannot_be_made_here_is_kept_as_it_is(
    file: str, path: list[str | int], value: Any, note: str
) -> None:
    content = plan_file_with(file, ["mission", "items", 1, *path], value)
    imported = qgc_plan.read(content)
    assert same_json(qgc_plan.write(imported.plan).data, content)
    if note == "":
        assert isinstance(imported.plan.items[1], PatternItem)
        return
    assert isinstance(imported.plan.items[1], ComplexItem)
    assert note in imported.notes[0]


def test_the_file_of_an_unchanged_pattern_keeps_its_lines() -> None:
    content = Path(__file__).parents[2].joinpath("data", "plans", "survey.plan").read_bytes()
    plan = qgc_plan.read(content).plan
    assert same_json(qgc_plan.write(plan_document.read(plan_document.write(plan))).data, content)
