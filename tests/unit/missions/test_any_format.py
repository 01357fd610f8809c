"""The format of a file is detected by its content, not by its name."""

import json
from pathlib import Path

import pytest

from missions.errors import PlanError
from missions.formats import any_format
from missions.formats.results import ImportOptions
from missions.offboard.reader import read
from missions.plan import Plan
from missions.values import Altitude, HomePosition

TOWER_MISSION_FILE = Path(__file__).parents[3] / "missions" / "examples" / "tower_inspection.yaml"
AT_20_M = {"value_m": 20.0, "reference": "home"}
PLAN = Plan.model_validate_json(
    json.dumps(
        {
            "planned_home": {"lat_deg": 47.4, "lon_deg": 8.5, "alt_amsl_m": 488.0},
            "items": [
                {"kind": "takeoff", "lat_deg": 47.4, "lon_deg": 8.5, "altitude": AT_20_M},
                {"kind": "waypoint", "lat_deg": 47.401, "lon_deg": 8.5, "altitude": AT_20_M},
                {"kind": "return_home"},
            ],
        }
    )
)


@pytest.mark.parametrize("name", [name for name in any_format.FORMATS if name != "yaml"])
def test_each_format_is_detected_by_its_content_and_returns_the_items(name):
    data = any_format.write(name, PLAN).data
    filename = "plan.csv" if name == "csv" else "renamed.bin"
    assert any_format.recognise(data, filename) == name
    plan = any_format.read(name, data, ImportOptions()).plan
    assert [item.kind for item in plan.items] == ["takeoff", "waypoint", "return_home"]
    assert plan.items[1].lat_deg == pytest.approx(47.401, abs=1e-7)


@pytest.mark.parametrize("name", any_format.MISSION_FORMATS)
def test_a_mission_is_detected_by_its_content_and_returned_unchanged(name):
    mission = read(TOWER_MISSION_FILE.read_bytes())
    data = any_format.write(name, mission).data
    assert any_format.recognise(data, "renamed.bin") == name
    assert any_format.read(name, data).plan == mission


def test_the_refusal_of_a_format_names_the_formats_that_can_store_the_plan():
    with pytest.raises(PlanError, match="Write it as yaml or json"):
        any_format.write("kml", read(TOWER_MISSION_FILE.read_bytes()))
    with pytest.raises(PlanError, match="convert it to an offboard mission first"):
        any_format.write("yaml", PLAN)


def test_the_loss_of_the_comments_of_a_yaml_file_is_reported():
    assert "comments" in any_format.read("yaml", TOWER_MISSION_FILE.read_bytes()).notes[0]


def test_a_plan_document_is_returned_unchanged():
    assert any_format.read("json", any_format.write("json", PLAN).data).plan == PLAN


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"\x00\x01", "format is not supported"),
        (b"", "format is not supported"),
        (b'{"fileType": "Parameters"}', "neither a plan"),
        (b'{"a": ', "not valid JSON"),
        (b"kind,lat_deg\n", "format is not supported"),
    ],
)
def test_a_file_of_an_unknown_format_is_refused_with_a_reason(data, reason):
    with pytest.raises(PlanError, match=reason):
        any_format.recognise(data, "flight.bin")


def test_points_without_altitude_are_refused_unless_the_import_gives_an_altitude():
    line = b'{"type": "LineString", "coordinates": [[8.5, 47.4], [8.5, 47.401]]}'
    with pytest.raises(PlanError):
        any_format.read("geojson", line)
    options = ImportOptions(Altitude(value_m=30.0, reference="amsl"))
    imported_plan = any_format.read("geojson", line, options).plan
    assert {item.altitude.value_m for item in imported_plan.items} == {30.0}
    assert imported_plan.planned_home is None or isinstance(imported_plan.planned_home, HomePosition)
