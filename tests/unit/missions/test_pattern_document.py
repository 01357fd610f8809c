"""Patterns as JSON: each kind of pattern becomes items; the error for an invalid value names its field."""

import json

import pytest

from missions.errors import PlanError
from missions.patterns import document
from tests.support.survey_camera import CAMERA

CORNERS = [
    {"lat_deg": lat, "lon_deg": lon}
    for lat, lon in ((47.4, 8.5), (47.401, 8.5), (47.401, 8.502), (47.4, 8.502))
]
COVERAGE = {"camera": CAMERA, "distance_m": 40}
ALTITUDE = {"value_m": 40, "reference": "home"}
PATTERNS = {
    "survey": {"outer": CORNERS, "coverage": COVERAGE, "altitude": ALTITUDE, "crosshatch": True},
    "corridor": {"points": CORNERS[:2], "width_m": 60, "coverage": COVERAGE, "altitude": ALTITUDE},
    "perimeter": {"outer": CORNERS, "offset_m": 5, "altitude": ALTITUDE, "rounds": 2},
    "orbit": {"center": CORNERS[0], "radius_m": 25, "altitude": ALTITUDE, "look_at": ALTITUDE},
    "structure": {"outline": CORNERS, "coverage": COVERAGE, "base": ALTITUDE, "height_m": 30},
}


def pattern_json(kind, **changes):
    return json.dumps({"kind": kind, **PATTERNS[kind], **changes})


@pytest.mark.parametrize("kind", PATTERNS)
def test_each_kind_of_pattern_gives_waypoints(kind):
    pattern = document.make(document.read(pattern_json(kind)))
    assert sum(item.kind == "waypoint" for item in pattern.items) >= 4
    assert pattern.lines_length_m > 50


@pytest.mark.parametrize(
    ("kind", "changes", "field"),
    [
        ("survey", {"outer": CORNERS[:2]}, "outer"),
        ("survey", {"holes": [CORNERS[:2]]}, "holes"),
        ("survey", {"holes": [CORNERS]}, "holes"),
        ("survey", {"coverage": {**COVERAGE, "side_overlap": 0.99}}, "coverage.side_overlap"),
        ("survey", {"coverage": {**COVERAGE, "distance_m": 0.1}}, "coverage"),
        ("orbit", {"radius_m": 0}, "radius_m"),
        ("orbit", {"speed": 3}, "speed"),
        ("corridor", {"width_m": "60"}, "width_m"),
        ("perimeter", {"rounds": 0}, "rounds"),
        ("perimeter", {"offset_m": -100}, "offset_m"),
        ("structure", {"height_m": 0}, "height_m"),
        ("structure", {"outline": CORNERS[:2]}, "outline"),
        (
            "structure",
            {"coverage": {**COVERAGE, "side_overlap": 0.95, "distance_m": 0.5}},
            "coverage.side_overlap",
        ),
    ],
)
def test_the_error_for_an_invalid_value_names_its_field_and_a_fix(kind, changes, field):
    with pytest.raises(PlanError) as raised:
        document.make(document.read(pattern_json(kind, **changes)))
    assert raised.value.field == field
    assert raised.value.fix.endswith(".")


def test_the_error_for_an_unknown_kind_lists_the_kinds():
    with pytest.raises(PlanError, match="'structure'") as raised:
        document.read('{"kind": "spiral"}')
    assert raised.value.place == "the pattern"
