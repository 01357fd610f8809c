"""Elevation files over HTTP: the list, checks of plans, and plans at altitudes above terrain."""

import asyncio
from types import SimpleNamespace

import pytest

from gcs_server.clock import SystemClock
from gcs_server.plans import known_ground
from gcs_server.plans.work import PlanWork
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


def test_an_item_below_home_is_an_error_unless_the_ground_there_is_known(client):
    def severity(lat_offset_deg, planned_home):
        low = {"planned_home": planned_home, "items": [item(lat_offset_deg, -20, "home")]}
        findings = client.post("plans/check", json={"plan": low}).json()["findings"]
        return {each["code"]: each["severity"] for each in findings}.get("altitude_below_home")

    on_hill = {"lat_deg": LAT_DEG, "lon_deg": LON_DEG, "alt_amsl_m": 580}
    assert severity(-0.02, on_hill) == "warning", "the plain is 80 m lower than the summit"
    assert severity(-0.06, on_hill) == "error", "beyond the elevation data"


def test_the_ground_around_a_target_is_read_from_the_files_once(tmp_path, monkeypatch):
    monkeypatch.setattr(known_ground, "TIMEOUT_S", 60.0)  # the machine may be busy
    ground = asyncio.run(read_ground(tmp_path, LAT_DEG))
    assert ground.altitude_amsl_m(LAT_DEG, LON_DEG) == pytest.approx(580, abs=3)
    assert ground.altitude_amsl_m(LAT_DEG + 0.02, LON_DEG) == pytest.approx(500, abs=3)
    assert ground.altitude_amsl_m(LAT_DEG + 0.028, LON_DEG) is None, "beyond the area that is read at once"
    assert asyncio.run(read_ground(tmp_path, LAT_DEG + 1.0)) is None


async def read_ground(folder, lat_deg):
    """The known ground of a vehicle after a go-to to this latitude was requested."""
    write_elevation_file(folder / "hill.tif", hill_elevation(500.0, 80.0))
    work = PlanWork(folder)
    vehicle = SimpleVehicle()
    try:
        reader = known_ground.KnownGround(SystemClock(), None, work)
        await reader.read_around(vehicle, lat_deg, LON_DEG)
        first = vehicle.command.floor.grounds
        await reader.read_around(vehicle, lat_deg + 0.005, LON_DEG)
        assert vehicle.command.floor.grounds is first, "the ground of a near position is not read again"
        return first[0] if first else None
    finally:
        work.close()


def test_the_relief_around_a_position_is_read_from_the_files(tmp_path):
    async def read(folder):
        work = PlanWork(folder)
        try:
            return [await known_ground.relief_around(work, LAT_DEG + shift, LON_DEG) for shift in (0.0, 1.0)]
        finally:
            work.close()

    write_elevation_file(tmp_path / "hill.tif", hill_elevation(500.0, 80.0))
    relief, elsewhere = asyncio.run(read(tmp_path))
    assert relief.altitude_amsl_m(LAT_DEG, LON_DEG) == pytest.approx(580, abs=1)
    assert relief.altitude_amsl_m(LAT_DEG + 0.02, LON_DEG) == pytest.approx(500, abs=1)
    assert elsewhere is None


class SimpleVehicle:
    """A vehicle with nothing but the ground that is known around it."""

    def __init__(self):
        self.command = SimpleNamespace(floor=SimpleNamespace(grounds=()))
