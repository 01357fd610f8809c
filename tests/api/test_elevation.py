"""Elevation files over HTTP: the list, checks of plans, and plans at altitudes above terrain."""

import pytest

from tests.support.api_client import api_client
from tests.support.elevation_files import LAT_DEG, LON_DEG, hill_elevation, write_elevation_file

HOME = {"lat_deg": LAT_DEG - 0.01, "lon_deg": LON_DEG, "alt_amsl_m": 500}


def item(lat_offset_deg, value_m, reference="terrain"):
    altitude = {"value_m": value_m, "reference": reference}
    return {"kind": "waypoint", "lat_deg": LAT_DEG + lat_offset_deg, "lon_deg": LON_DEG, "altitude": altitude}


def plan(*items):
    return {"planned_home": HOME, "items": list(items)}


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    data = tmp_path_factory.mktemp("data")
    (data / "elevation").mkdir()
    with api_client(data, path="/api/v1/") as client:
        write_elevation_file(data / "elevation" / "hill.tif", hill_elevation(500.0, 80.0))
        (data / "elevation" / "broken.tif").write_bytes(b"II*\x00 no more")
        yield client


def finding_codes(check):
    return [finding["code"] for finding in check["findings"]]


def test_files_are_listed_and_unreadable_files_have_an_error(client):
    listing = client.get("elevation").json()
    assert [file["name"] for file in listing["files"]] == ["hill.tif"]
    assert listing["files"][0]["south_deg"] < LAT_DEG < listing["files"][0]["north_deg"]
    (problem,) = listing["unreadable"]
    assert "broken.tif" in problem
    assert listing["folder"].endswith("elevation")


def test_altitudes_above_terrain_are_resolved_and_added_items_remove_the_terrain_findings(client):
    above_terrain = plan(item(-0.009, 30), item(0.009, 30))
    check_before = client.post("plans/check", json={"plan": above_terrain}).json()
    assert finding_codes(check_before).count("terrain_unresolved") == 2
    assert max(height for _, height in check_before["ground"]) == pytest.approx(80, abs=2)
    assert any("broken.tif" in text for text in check_before["not_known"])
    without_tolerance = client.post("plans/ground", json={"plan": above_terrain}).json()
    assert (without_tolerance["resolved"], without_tolerance["unknown"], without_tolerance["added"]) == (
        2,
        0,
        0,
    )
    assert "terrain_hit" in finding_codes(
        client.post("plans/check", json={"plan": without_tolerance["plan"]}).json()
    )
    terrain_following = client.post("plans/ground", json={"plan": above_terrain, "tolerance_m": 5}).json()
    assert terrain_following["added"] == len(terrain_following["plan"]["items"]) - 2 > 0
    codes_after = finding_codes(client.post("plans/check", json={"plan": terrain_following["plan"]}).json())
    assert not {"terrain_unresolved", "terrain_hit", "terrain_near", "terrain_outdated"} & set(codes_after)


def test_a_finding_about_a_mission_into_a_hill_names_the_step(client):
    mission = {
        "format": "offboard-gcs-mission",
        "name": "Into the hill",
        "home": HOME,
        "steps": [
            {"step": "take_off", "height_m": 30},
            {"step": "fly", "points": [{"offset_ned_m": [1100, 0, -30]}]},
            {"step": "land"},
        ],
    }
    check = client.post("plans/check", json={"plan": mission}).json()
    assert [
        (finding["code"], finding["place"]["step"])
        for finding in check["findings"]
        if "terrain" in finding["code"]
    ] == [("terrain_hit", "step 2")]
    assert check["ground"]


def test_outside_the_elevation_files_the_ground_is_reported_as_not_known(client):
    elsewhere = {"items": [{**item(0, 30), "lat_deg": -33.0}]}
    check = client.post("plans/check", json={"plan": elsewhere}).json()
    assert check["ground"] == []
    assert "No elevation file covers the plan: the ground below it is not known." in check["not_known"]
    resolution = client.post("plans/ground", json={"plan": elsewhere}).json()
    assert (resolution["resolved"], resolution["unknown"]) == (0, 1)


@pytest.mark.parametrize(
    ("body", "field"),
    [
        ({"plan": plan(), "tolerance_m": 0.1}, "tolerance_m"),
        ({"tolerance_m": 5}, "plan"),
        ({"plan": plan(), "tol": 1}, "tol"),
    ],
)
def test_an_error_about_an_invalid_request_names_the_field(client, body, field):
    response = client.post("plans/ground", json=body)
    assert response.status_code == 422
    assert field in response.json()["field"]
