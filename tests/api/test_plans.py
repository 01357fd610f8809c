"""Plans over HTTP: stored, changed by two clients, checked, imported, exported, and made from patterns."""

import io
import json
import math

import numpy as np
import pytest

from tests.support.api_client import api_client
from tests.support.survey_camera import CAMERA

AT_20_M = {"value_m": 20, "reference": "home"}
PLAN = {
    "planned_home": {"lat_deg": 47.4, "lon_deg": 8.5, "alt_amsl_m": 488},
    "items": [
        {"kind": "takeoff", "lat_deg": 47.4, "lon_deg": 8.5, "altitude": AT_20_M},
        {"kind": "waypoint", "lat_deg": 47.401, "lon_deg": 8.5, "altitude": AT_20_M},
        {"kind": "return_home"},
    ],
}
SQUARE = [
    {"lat_deg": lat, "lon_deg": lon}
    for lat, lon in ((47.4, 8.5), (47.401, 8.5), (47.401, 8.502), (47.4, 8.502))
]
MISSION = {
    "format": "offboard-gcs-mission",
    "name": "Name in the file",
    "home": {"lat_deg": 47.4, "lon_deg": 8.5, "alt_amsl_m": 488},
    "steps": [
        {"step": "take_off", "height_m": 10},
        {"step": "fly", "points": [{"offset_ned_m": [30, 0, -10]}, {"offset_ned_m": [30, 40, -15]}]},
        {"step": "land"},
    ],
}
ANNA, BOB = {"X-Client": "anna"}, {"X-Client": "bob"}


@pytest.fixture
def client(tmp_path):
    with api_client(tmp_path, path="/api/v1/") as client:
        yield client


def store(client, name="Tower", plan=PLAN):
    response = client.post("plans", json={"name": name, "plan": plan}, headers=ANNA)
    assert response.status_code == 201, response.text
    return response.json()


def next_event(socket, kind):
    while True:
        frame = json.loads(socket.receive_text())
        if frame.get("type") == "event" and frame["event"]["kind"] == kind:
            return frame["event"]


def test_a_plan_is_stored_and_listed_with_its_last_author(client):
    assert client.get("plans").json() == {"plans": []}
    stored = store(client)
    assert (stored["version"], stored["changed_by"], stored["item_count"]) == (1, "anna", 3)
    assert stored["plan"]["items"][1]["lat_deg"] == 47.401
    listed = client.get("plans").json()["plans"]
    assert listed == [{key: value for key, value in stored.items() if key != "plan"}]
    assert client.get(f"plans/{stored['id']}").json() == stored
    assert client.get("plans/none").json()["code"] == "unknown_plan"


def test_a_conflicting_save_names_the_other_client(client):
    stored = store(client)
    change = {"name": "Tower", "plan": stored["plan"], "base_version": 1}
    saved = client.put(f"plans/{stored['id']}", json={**change, "name": "Old tower"}, headers=BOB)
    assert (saved.status_code, saved.json()["version"], saved.json()["name"]) == (200, 2, "Old tower")
    late = client.put(f"plans/{stored['id']}", json=change, headers=ANNA)
    problem = late.json()
    assert (late.status_code, problem["code"], problem["changed_by"]) == (409, "conflict", "bob")
    assert (problem["version"], problem["changed_unix_s"]) == (2, saved.json()["changed_unix_s"])
    assert client.delete(f"plans/{stored['id']}", params={"base_version": 1}).status_code == 409
    versions = client.get(f"plans/{stored['id']}/versions").json()["versions"]
    assert [(version["version"], version["name"]) for version in versions] == [(2, "Old tower"), (1, "Tower")]
    assert client.get(f"plans/{stored['id']}", params={"version": 1}).json() == stored
    assert client.delete(f"plans/{stored['id']}", params={"base_version": 2}).status_code == 204
    assert client.get("plans").json() == {"plans": []}
    journal_lines = [
        (line["client"], line["command"], line["result"]) for line in client.get("journal").json()["entries"]
    ]
    assert ("anna", "plans/save", "conflict") in journal_lines
    assert ("anna", "plans/create", "ok") in journal_lines


def test_every_change_of_a_plan_is_sent_to_telemetry_clients(client):
    with client.websocket_connect("ws://localhost/api/v1/telemetry") as socket:
        stored = store(client)
        change = next_event(socket, "plan_changed")
        assert (change["action"], change["client"], change["plan"]["id"]) == ("created", "anna", stored["id"])
        client.delete(f"plans/{stored['id']}", params={"base_version": 1}, headers=BOB)
        change = next_event(socket, "plan_changed")
        assert (change["action"], change["client"], change["text"]) == (
            "deleted",
            "bob",
            "bob deleted the plan 'Tower' (version 1).",
        )


@pytest.mark.parametrize(
    ("invalid", "text"),
    [
        (
            {"items": [{"kind": "waypoint", "lat_deg": 95, "lon_deg": 8, "altitude": AT_20_M}]},
            "item 1 (waypoint)",
        ),
        ({"items": [{"kind": "loop"}]}, "item 1"),
        ({"speed": 3}, "field speed"),
        ({"hover_speed_m_s": "5"}, "hover_speed_m_s"),
        ([], "plan"),
    ],
)
def test_an_invalid_plan_is_not_stored_and_the_error_names_the_item_or_field(client, invalid, text):
    refused = client.post("plans", json={"name": "x", "plan": invalid})
    assert refused.status_code == 422
    assert refused.json()["field"].startswith("plan")
    assert text in refused.json()["detail"]
    assert client.get("plans").json() == {"plans": []}
    assert client.post("plans/check", json={"plan": invalid}).status_code == 422


@pytest.mark.parametrize("name", ["", " ", "a\nb", "x" * 101])
def test_a_plan_name_that_is_empty_too_long_or_has_two_lines_is_refused(client, name):
    assert client.post("plans", json={"name": name, "plan": PLAN}).json()["field"] == "name"


def test_a_check_returns_findings_with_their_items_and_estimates(client):
    high_plan = json.loads(json.dumps(PLAN))
    high_plan["items"][1]["altitude"]["value_m"] = 300
    check = client.post("plans/check", json={"plan": high_plan}).json()
    finding = next(each for each in check["findings"] if each["code"] == "altitude_too_high")
    assert (finding["severity"], finding["place"]["row"]) == ("warning", 1)
    assert "300" in finding["text"]
    assert check["estimates"]["length_m"] > 300
    assert (check["vehicle"], check["not_known"]) == (None, [])
    unknown_vehicle = client.post("plans/check", json={"plan": PLAN, "vehicle": "7"})
    assert (unknown_vehicle.status_code, unknown_vehicle.json()["code"]) == (404, "unknown_vehicle")
    assert client.get("journal").json()["entries"] == [], "a check changes nothing and is not journaled"


WALL = {
    "name": "Wall",
    "top": {"value_m": 30, "reference": "home"},
    "polygon": [
        {"lat_deg": lat, "lon_deg": lon}
        for lat, lon in ((47.4002, 8.499), (47.4002, 8.501), (47.4001, 8.501), (47.4001, 8.499))
    ],
}


@pytest.mark.parametrize(("plan", "row", "step"), [(PLAN, 1, None), (MISSION, None, "step 2")])
def test_obstacles_are_stored_and_a_finding_names_the_item_or_step(client, plan, row, step):
    stored = store(client, plan={**plan, "obstacles": [WALL]})
    assert stored["plan"]["obstacles"][0]["polygon"] == WALL["polygon"]
    findings = client.post("plans/check", json={"plan": stored["plan"]}).json()["findings"]
    finding = next(each for each in findings if each["code"] == "obstacle_hit")
    assert "passes through Wall" in finding["text"]
    assert finding["place"] == {"row": row, "zone": None, "rally_point": None, "obstacle": 0, "step": step}
    terrain_obstacle = {**plan, "obstacles": [{**WALL, "top": {"value_m": 30, "reference": "terrain"}}]}
    refused = client.post("plans/check", json={"plan": terrain_obstacle})
    assert refused.status_code == 422
    assert "above home or AMSL" in refused.json()["detail"]


@pytest.mark.parametrize("format", ["json", "plan", "waypoints", "csv", "geojson", "kml", "kmz"])
def test_an_exported_file_can_be_imported_again(client, format):
    exported = client.post("plans/export", params={"format": format}, json={"plan": PLAN})
    assert exported.status_code == 200, exported.text
    assert f"plan.{format}" in exported.headers["content-disposition"]
    notes = json.loads(exported.headers["x-plan-notes"])
    assert all(note.endswith(".") for note in notes)
    imported = client.post("plans/import", params={"filename": f"a.{format}"}, content=exported.content)
    assert imported.status_code == 200, imported.text
    assert imported.json()["format"] == format
    kinds = [item["kind"] for item in imported.json()["plan"]["items"]]
    assert kinds == ["takeoff", "waypoint", "return_home"]
    assert client.get("plans").json() == {"plans": []}, "an import stores nothing"


def test_a_file_without_altitudes_needs_an_altitude_and_returns_its_areas(client):
    ring = [[corner["lon_deg"], corner["lat_deg"]] for corner in [*SQUARE, SQUARE[0]]]
    shapes = [
        {"type": "LineString", "coordinates": ring[:2]},
        {"type": "Polygon", "coordinates": [ring]},
    ]
    features = [{"type": "Feature", "properties": {}, "geometry": shape} for shape in shapes]
    file = json.dumps({"type": "FeatureCollection", "features": features}).encode()
    refused = client.post("plans/import", params={"filename": "a.geojson"}, content=file)
    assert (refused.status_code, refused.json()["field"]) == (422, "altitude_m")
    altitude = {"altitude_m": 30, "altitude_reference": "amsl"}
    imported = client.post("plans/import", params={"filename": "a.geojson", **altitude}, content=file).json()
    assert imported["plan"]["items"][0]["altitude"]["value_m"] == 30
    (area,) = imported["areas"]
    assert len(area["outer"]) == 4
    assert [use["use"] for use in area["uses"]] == ["stay_inside", "stay_outside", "survey"]
    plan_with_fence = {**imported["plan"], "fence": area["uses"][1]["fence"]}
    assert client.post("plans/check", json={"plan": plan_with_fence}).status_code == 200
    assert client.post("plans/import", content=b"").json()["field"] == "body"
    assert client.post("plans/import", content=b"\x00").status_code == 422


def test_patterns_become_a_path_or_mission_steps(client):
    survey = {
        "kind": "survey",
        "outer": SQUARE,
        "coverage": {"camera": CAMERA, "distance_m": 40},
        "altitude": {"value_m": 40, "reference": "home"},
    }
    response = client.post("plans/pattern", json=survey)
    assert response.status_code == 200, response.text
    figures = response.json()["figures"]
    assert figures["photos"] > 10
    assert figures["lines_length_m"] >= figures["lower_bound_m"] > 0
    assert len(response.json()["lines"]) >= 2
    assert {point["altitude"]["value_m"] for point in response.json()["path"]} == {40}
    orbit = {"kind": "orbit", "center": SQUARE[0], "radius_m": 20, "altitude": AT_20_M}
    circle = client.post("plans/pattern", json=orbit).json()
    assert circle["figures"]["lines_length_m"] == pytest.approx(2 * math.pi * 20, rel=0.02)
    tower = {
        "kind": "structure",
        "outline": SQUARE,
        "coverage": {"camera": CAMERA, "distance_m": 8},
        "base": {"value_m": 500, "reference": "amsl"},
        "height_m": 20,
    }
    path = client.post("plans/pattern", json=tower).json()["path"]
    assert {point["altitude"]["reference"] for point in path} == {"amsl"}
    alts_m = [point["altitude"]["value_m"] for point in path]
    assert (alts_m[0], alts_m == sorted(alts_m), len(set(alts_m)) > 1) == (503, True, True)
    refused = client.post("plans/pattern", json={**survey, "outer": SQUARE[:2]})
    assert refused.status_code == 422
    assert "fewer than 3 corners" in refused.json()["detail"]
    assert refused.json()["field"] == "outer"
    too_large = client.post("plans/pattern", json={**orbit, "radius_m": 20_000_000})
    assert (too_large.status_code, too_large.json()["field"]) == (422, "radius_m")
    hole_outside = client.post(
        "plans/pattern", json={**survey, "holes": [[{**SQUARE[0], "lat_deg": 47.41}] * 3]}
    )
    assert (hole_outside.status_code, hole_outside.json()["field"]) == (422, "holes")

    (row,) = response.json()["plan"]["items"]
    assert (row["kind"], row["pattern"]["outer"]) == ("pattern", SQUARE)
    row["pattern"]["coverage"]["side_overlap"] = 0.9
    stored = client.post("plans", json={"name": "Field", "plan": {"items": [row]}}).json()
    (kept,) = client.get(f"plans/{stored['id']}").json()["plan"]["items"]
    assert (kept["kind"], kept["pattern"]["coverage"]["side_overlap"]) == ("pattern", 0.9)
    assert len(kept["items"]) > 2 * len(row["items"])
    row["pattern"]["outer"] = SQUARE[:2]
    refused = client.post("plans/check", json={"plan": {"items": [row]}})
    assert (refused.status_code, refused.json()["field"]) == (422, "items[0].pattern")
    assert refused.json()["detail"].startswith("item 1 (survey)")

    steps = client.post("plans/pattern", json=survey, params={"document": "offboard_mission"})
    assert steps.status_code == 200, steps.text
    assert steps.json()["plan"]["steps"][1]["name"] == "Survey line 1"
    assert steps.json()["figures"] == response.json()["figures"]
    terrain_orbit = {**orbit, "altitude": {"value_m": 20, "reference": "terrain"}}
    refused = client.post("plans/pattern", json=terrain_orbit, params={"document": "offboard_mission"})
    assert (refused.status_code, refused.json()["field"]) == (422, "altitude")


def test_a_survey_is_divided_over_vehicles_and_its_check_has_times_and_distances(client):
    fields = {"kind": "survey", "outer": SQUARE, "coverage": {"camera": CAMERA, "distance_m": 40}}
    plan = client.post(
        "plans/pattern", json={**fields, "altitude": {"value_m": 40, "reference": "home"}}
    ).json()
    plan = {**plan["plan"], "planned_home": {"lat_deg": 47.39, "lon_deg": 8.54, "alt_amsl_m": 480}}
    divided = client.post("plans/divide", json={"plan": plan, "name": "Two parts", "count": 2})
    assert divided.status_code == 200, divided.text
    mission, parts = divided.json()["plan"], divided.json()["parts"]
    assert (mission["name"], mission["minimum_separation_m"]) == ("Two parts", 5)
    assert list(mission["roles"]) == [each["role"] for each in parts] == ["part 1", "part 2"]
    assert [each["vehicle"] for each in parts] == [None, None]
    flight = client.post("plans/check", json={"plan": mission}).json()["flight"]
    assert [each["role"] for each in flight["roles"]] == ["part 1", "part 2"]
    assert {each["role"] for each in flight["legs"]} == {"part 1", "part 2"}
    (closest,) = flight["closest"]
    assert closest["roles"] == ["part 1", "part 2"]
    assert closest["distance_m"] > 5
    for wrong, field in (
        ({"count": 11}, "count"),
        ({"count": 2, "vehicles": ["1", "2"]}, None),
        ({"vehicles": ["1", "1"]}, None),
        ({"count": 2, "item": 1}, "item"),
        ({"count": 2, "minimum_separation_m": 0.5}, "minimum_separation_m"),
        ({}, None),
    ):
        refused = client.post("plans/divide", json={"plan": plan, "name": "Parts", **wrong})
        assert refused.status_code == 422, wrong
        assert field in (None, refused.json()["field"])
    unknown = client.post("plans/divide", json={"plan": plan, "name": "Parts", "vehicles": ["1", "2"]})
    assert (unknown.status_code, unknown.json()["code"]) == (404, "unknown_vehicle")
    without_home = client.post(
        "plans/divide", json={"plan": {**plan, "planned_home": None}, "name": "P", "count": 2}
    )
    assert (without_home.status_code, "home" in without_home.json()["detail"]) == (422, True)


def test_an_offboard_mission_is_stored_in_the_same_list_as_plans(client):
    store(client)
    stored = store(client, "Mast", MISSION)
    assert (stored["kind"], stored["item_count"], stored["plan"]["name"]) == ("offboard_mission", 3, "Mast")
    listed = client.get("plans").json()["plans"]
    assert [(entry["name"], entry["kind"]) for entry in listed] == [
        ("Mast", "offboard_mission"),
        ("Tower", "waypoint_plan"),
    ]
    change = {"name": "Old mast", "plan": stored["plan"], "base_version": 1}
    saved = client.put(f"plans/{stored['id']}", json=change, headers=BOB).json()
    assert (saved["version"], saved["plan"]["name"]) == (2, "Old mast")
    assert client.put(f"plans/{stored['id']}", json=change).json()["code"] == "conflict"
    assert client.get(f"plans/{stored['id']}", params={"version": 1}).json() == stored


def test_an_error_about_an_invalid_mission_names_step_and_field(client):
    invalid = {**MISSION, "steps": [{"step": "hold", "duration_s": "5"}]}
    refused = client.post("plans", json={"name": "x", "plan": invalid})
    assert refused.status_code == 422
    assert "step 1, field duration_s" in refused.json()["detail"]
    assert client.get("plans").json() == {"plans": []}


def test_a_check_of_a_mission_returns_findings_step_times_and_the_path(client):
    invalid = {**MISSION, "steps": [*MISSION["steps"][:2], {"step": "take_off", "height_m": 5}]}
    power = {"hover_power_w": 180.0, "battery_wh": 5.0, "mass_kg": 2.0}
    check = client.post("plans/check", json={"plan": invalid, "power": power}).json()
    places = {
        finding["code"]: (finding["severity"], finding["place"]["step"]) for finding in check["findings"]
    }
    assert places["takeoff_in_air"] == ("error", "step 3")
    assert places["landing_missing"] == ("warning", "the end")
    assert "endurance_exceeded" not in places
    assert check["kind"] == "offboard_mission"
    assert 60 < check["estimates"]["length_m"] < 120
    assert 0.5 < check["estimates"]["energy_wh"] < 5.0
    flight = check["flight"]
    assert [step["place"] for step in flight["steps"]] == ["step 1", "step 2"]
    assert flight["origin"] == {"lat_deg": 47.4, "lon_deg": 8.5, "alt_amsl_m": 488}
    assert flight["legs"][-1]["points"][-1][1:] == [30, 40, -15]


def test_a_plan_is_converted_to_a_mission_with_notes(client):
    rally = {**PLAN, "rally_points": [{"lat_deg": 47.4, "lon_deg": 8.5, "altitude": AT_20_M}]}
    response = client.post("plans/convert", json={"plan": rally, "name": "Mast"}).json()
    assert [step["step"] for step in response["plan"]["steps"]] == ["take_off", "fly", "fly", "land"]
    assert response["plan"]["name"] == "Mast"
    assert "Rally points are omitted" in response["notes"][0]
    refused = client.post("plans/convert", json={"plan": {"items": []}, "name": "Mast"})
    assert (refused.status_code, refused.json()["field"]) == (422, "plan")


def test_a_stored_mission_is_inserted_into_another_mission(client):
    stored = store(client, "Tower", MISSION)
    body = {"plan": MISSION, "plan_id": stored["id"], "at": ["steps", 2], "in_air": True}
    insertion = client.post("plans/insert", json=body).json()
    assert [step["step"] for step in insertion["plan"]["steps"]] == ["take_off", "fly", "call", "land"]
    assert insertion["plan"]["steps"][2]["mission"] == insertion["called"] == "Tower"
    assert [step["step"] for step in insertion["plan"]["missions"]["Tower"]] == ["fly"]
    assert "left out" in insertion["notes"][0]
    saved = store(client, "Two towers", insertion["plan"])
    second_insertion = {**body, "plan": saved["plan"], "plan_id": saved["id"], "version": 1}
    assert client.post("plans/insert", json=second_insertion).json()["called"] == "Two towers"


def test_a_mission_in_a_field_for_missions_needs_no_format(client):
    mission = {name: value for name, value in MISSION.items() if name != "format"}
    body = {"plan": mission, "mission": mission, "at": ["steps", 2], "in_air": True}
    assert client.post("plans/insert", json=body).json()["plan"]["format"] == MISSION["format"]


def test_an_invalid_insertion_is_refused_and_the_error_names_the_field(client):
    mission_id, plan_id = store(client, "Tower", MISSION)["id"], store(client)["id"]
    other_home = {**MISSION, "home": {**MISSION["home"], "lat_deg": 47.41}}
    for changes, status, field, text in (
        ({"plan_id": plan_id}, 422, "plan_id", "POST /plans/convert"),
        ({"plan_id": "none"}, 404, None, "GET /plans"),
        ({"plan_id": None}, 422, "body", "exactly one of plan_id and mission"),
        ({"version": 3}, 404, None, "Its newest version is 1"),
        ({"at": ["steps", 9]}, 422, "at", "steps"),
        ({"at": ["steps", True]}, 422, "at.1", "whole numbers"),
        ({"at": ["steps"]}, 422, "at", "2 items"),
        ({"plan": other_home}, 422, "positions", "from_start"),
        ({"positions": "there"}, 422, "positions", "from_start"),
        ({"plan": PLAN}, 422, "plan", "waypoint plan"),
        (
            {"plan": {**MISSION, "steps": [{"step": "call", "mission": "x"}]}},
            422,
            "plan",
            "no list with this name",
        ),
    ):
        body = {"plan": MISSION, "plan_id": mission_id, "at": ["steps", 1], **changes}
        fields = {key: value for key, value in body.items() if value is not None}
        response = client.post("plans/insert", json=fields)
        problem = response.json()
        assert (response.status_code, problem.get("field")) == (status, field), (changes, problem)
        assert text in f"{problem['detail']} {problem.get('remedy')}", problem


def mission_with_table(length):
    """A mission that flies a trajectory table of this many characters."""
    rows = "t_s,north_m,east_m,down_m\n0,0,0,-9\n9,9,0,-9"
    steps = [{"step": "take_off", "height_m": 9}, {"step": "table", "file": "long"}]
    return {**MISSION, "steps": steps, "tables": {"long": rows.ljust(length)}}


def test_an_insertion_that_makes_the_mission_too_large_to_store_is_refused(client):
    stored = store(client, "Long", mission_with_table(600_000))
    huge = {**MISSION, "tables": {"other": "x" * 600_000}}
    response = client.post("plans/insert", json={"plan": huge, "plan_id": stored["id"], "at": ["steps", 1]})
    assert (response.status_code, response.json()["field"]) == (422, "plan_id")
    assert "only 1044480 can be stored" in response.json()["detail"]
    assert "fewer rows" in response.json()["remedy"]


def test_a_trajectory_file_becomes_a_table_of_a_mission(client):
    file = io.BytesIO()
    np.save(file, np.array([[0, 0, 0, -10], [4, 8, 0, -10]], dtype=float))
    table = client.post("plans/table", params={"filename": "line.npy"}, content=file.getvalue()).json()
    text = "t_s,north_m,east_m,down_m\n0,0,0,-10\n4,8,0,-10\n"
    assert table == {"name": "line.csv", "text": text, "rows": 2, "duration_s": 4.0, "has_yaw": False}
    steps = [MISSION["steps"][0], {"step": "table", "file": table["name"]}, MISSION["steps"][2]]
    mission = {**MISSION, "steps": steps, "tables": {table["name"]: table["text"]}}
    check = client.post("plans/check", json={"plan": mission}).json()
    assert "step_invalid" not in [finding["code"] for finding in check["findings"]]
    assert [8, 0, -10] in [leg["points"][-1][1:] for leg in check["flight"]["legs"]]
    refused = client.post("plans/table", params={"filename": "a.npy"}, content=b"t_s")
    assert (refused.status_code, refused.json()["field"]) == (422, "body")
    assert refused.json()["remedy"] == "Save one array with numpy.save."
    assert "The file is empty" in client.post("plans/table", content=b"").json()["detail"]


def test_a_mission_is_exported_to_yaml_and_imported_again(client):
    exported = client.post("plans/export", params={"format": "yaml"}, json={"plan": MISSION})
    assert exported.text.startswith("format: offboard-gcs-mission")
    imported = client.post("plans/import", params={"filename": "a.yaml"}, content=exported.content).json()
    assert (imported["format"], imported["kind"], imported["plan"]["name"]) == (
        "yaml",
        "offboard_mission",
        "Name in the file",
    )
    refused = client.post("plans/export", params={"format": "kml"}, json={"plan": MISSION})
    assert "Write it as yaml or json" in json.dumps(refused.json())
    refused = client.post(
        "plans/import", params={"filename": "a.yaml"}, content=b"name: a\nsteps:\n- step: jump\n"
    )
    assert "line 3, step 1" in refused.json()["detail"]


def test_the_schema_of_both_documents_is_published(client):
    mission = client.get("plans/schema/offboard_mission").json()
    assert {"TakeOff", "Helix", "Branch"} <= set(mission["$defs"])
    assert "RallyPoint" in client.get("plans/schema/waypoint_plan").json()["$defs"]
    assert client.get("plans/schema/other").status_code == 422
