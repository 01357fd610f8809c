"""Sources of heights: nothing is asked for before one is chosen; the ground of a region becomes an elevation
file that the checks use; wrong tiles, a full disk and a cancelled saving are named and leave nothing."""

import math
import time

import numpy as np
import pytest

from gcs_server.maps import regions, tiles
from gcs_server.maps.regions import Region
from gcs_server.plans import ground_regions
from missions.terrain.files import BoundingBox, Elevation
from missions.terrain.terrarium import heights_of, pixel_positions
from tests.support.api_client import api_client
from tests.support.elevation_files import (
    LAT_DEG,
    LON_DEG,
    flat_elevation,
    hill_elevation,
    write_elevation_file,
)
from tests.support.terrarium_tiles import tile, tile_at
from tests.support.tile_server import PNG, TileServer

HILL = hill_elevation(500.0, 80.0)
BOUNDS = [LON_DEG - 0.01, LAT_DEG - 0.01, LON_DEG + 0.01, LAT_DEG + 0.01]


def hill_tile(path):
    zoom, x, y = (int(part) for part in path.removesuffix(".png").split("/")[1:])
    return tile_at(HILL, zoom, x, y)


@pytest.fixture
def server():
    server = TileServer(hill_tile)
    yield server
    server.close()


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    data = tmp_path_factory.mktemp("data")
    (data / "elevation").mkdir()
    with api_client(data, path="/api/v1/") as client:
        yield client, data / "elevation"


@pytest.fixture
def client(running, monkeypatch):
    """One server for all tests, without own sources and elevation files before each."""
    monkeypatch.setattr(tiles, "PAUSE_S", 0.05)
    client, folder = running
    yield client
    for source in client.get("elevation/sources").json()["sources"]:
        if source["own"]:
            client.delete(f"elevation/sources/{source['id']}")
    for path in folder.glob("*"):
        path.unlink()


@pytest.fixture
def folder(running):
    return running[1]


@pytest.fixture
def source(client, server):
    """An own source that is chosen."""
    added = client.post(
        "elevation/sources", json={"name": "Hills", "url": server.url, "may_save": True, "attribution": "Us"}
    )
    assert added.status_code == 201, added.text
    client.put("elevation/sources/chosen", json={"source": added.json()["id"]})
    return added.json()["id"]


def region(source, **changes):
    return {"source": source, "name": "Test field", "bounds_deg": BOUNDS, "zoom": 13, **changes}


def saved(client, body):
    response = client.post("elevation/regions", json=body)
    assert response.status_code == 202, response.text
    operation, deadline_s = response.json(), time.monotonic() + 40
    while operation["state"] == "running":
        assert time.monotonic() < deadline_s
        time.sleep(0.02)
        operation = client.get(f"operations/{operation['id']}").json()
    return operation


def test_nothing_is_asked_for_before_a_source_is_chosen_and_a_region_is_saved(client, server):
    added = client.post("elevation/sources", json={"name": "Hills", "url": server.url, "may_save": True})
    listing = client.get("elevation/sources").json()
    assert listing["chosen"] is None
    assert [each["id"] for each in listing["sources"]] == ["terrain_tiles", added.json()["id"]]
    for path in ("elevation/regions/size", "elevation/regions"):
        refused = client.post(path, json=region("own1"))
        assert (refused.status_code, refused.json()["code"]) == (409, "refused"), refused.text
    client.put("elevation/sources/chosen", json={"source": "own1"})
    assert client.post("elevation/regions/size", json=region("own1")).json()["tiles"] == 2
    assert server.asked == []


def test_a_saved_region_is_the_ground_of_profile_and_checks(client, server, source, folder):
    operation = saved(client, region(source))
    assert (operation["state"], operation["result"]) == ("succeeded", {"file": "Test field.tif", "tiles": 2})
    assert [path.name for path in folder.iterdir()] == ["Test field.tif"]
    (file,) = client.get("elevation").json()["files"]
    assert (file["name"], file["from_tiles"], file["attribution"]) == ("Test field.tif", True, "Us")
    assert file["spacing_m"] == pytest.approx(
        40_075_016 / 2**13 / 256 * math.cos(math.radians(LAT_DEG)), rel=0.01
    )
    ground = Elevation.from_files([folder / "Test field.tif"]).ground(
        BoundingBox(BOUNDS[0], BOUNDS[1], BOUNDS[2], BOUNDS[3])
    )
    offsets = np.random.default_rng(1).uniform(-0.01, 0.01, (2, 200))
    lats, lons = offsets[0] + LAT_DEG, offsets[1] + LON_DEG
    assert ground.altitudes_amsl_m(lats, lons) == pytest.approx(HILL(lats, lons), abs=0.6)
    altitude = {"value_m": 30, "reference": "home"}
    items = [
        {"kind": "waypoint", "lat_deg": LAT_DEG + d, "lon_deg": LON_DEG, "altitude": altitude}
        for d in (-0.009, 0.009)
    ]
    home = {"lat_deg": LAT_DEG - 0.0095, "lon_deg": LON_DEG, "alt_amsl_m": 500}
    check = client.post("plans/check", json={"plan": {"planned_home": home, "items": items}}).json()
    assert max(height for _, height in check["ground"]) == pytest.approx(80, abs=2)
    assert "terrain_hit" in [each["code"] for each in check["findings"]]
    again = client.post("elevation/regions", json=region(source))
    assert (again.status_code, again.json()["field"]) == (422, "name")
    server.close()
    assert saved(client, region(source, name="Kept"))["state"] == "succeeded", "its tiles are kept"


def test_own_files_come_before_saved_tiles_even_if_their_grid_is_coarser(client, source, folder):
    saved(client, region(source, zoom=14))
    write_elevation_file(folder / "survey.tif", flat_elevation(321.0))
    files = client.get("elevation").json()["files"]
    assert [file["name"] for file in files] == ["survey.tif", "Test field.tif"]
    assert files[0]["spacing_m"] > files[1]["spacing_m"]
    ground = Elevation.from_files(folder.iterdir()).ground(
        BoundingBox.around_positions([(LAT_DEG, LON_DEG)], 200)
    )
    assert ground.altitude_amsl_m(LAT_DEG, LON_DEG) == pytest.approx(321.0, abs=0.1)
    assert ground.spacing_m < 8.0


def test_the_sea_floor_is_no_ground(client, server, source, folder):
    server.answer = tile(np.linspace(-40.0, 60.0, 256)[None, :].repeat(256, axis=0))
    saved(client, region(source))
    ground = Elevation.from_files(folder.iterdir()).ground(BoundingBox(*BOUNDS))
    assert 0.0 <= np.nanmin(ground.amsl_m) < 0.1


WRONG = tile(np.full((256, 256), 500.0))


@pytest.mark.parametrize(
    ("answer", "text"),
    [
        (b"<html>please sign in</html>", "no PNG image"),
        (PNG + bytes(tiles.MAX_TILE_BYTES), "more than 2 MB"),
        (b"", "no PNG image"),
        (tile(np.full((300, 300), 500.0)), "300 by 300 pixels"),
        (WRONG[:-40], "cannot be read"),
        (tile(np.full((256, 256), 29_000.0)), "shows no heights (one would be 29,000 m)"),
    ],
)
def test_answers_that_show_no_heights_are_named_and_leave_nothing(
    client, server, source, folder, answer, text
):
    server.answer = answer
    operation = saved(client, region(source))
    assert operation["state"] == "failed"
    assert text in operation["error"]["detail"]
    assert list(folder.glob("*")) == []


def test_tiles_of_two_sizes_make_no_file(client, server, source, folder):
    sides = iter((256, 512, 256, 512))
    server.answer = lambda path: tile_at(HILL, *(int(p) for p in path[1:-4].split("/")), side=next(sides))
    operation = saved(client, region(source))
    assert "tiles of two sizes" in operation["error"]["detail"]
    assert list(folder.glob("*")) == []


def test_a_region_that_is_too_large_is_refused_before_anything_is_asked(client, server, source):
    refused = client.post("elevation/regions/size", json=region(source, bounds_deg=[8, 47, 9, 48]))
    assert (refused.status_code, refused.json()["code"]) == (409, "refused")
    assert f"at most {ground_regions.MAX_TILES}" in refused.json()["detail"]
    assert client.post("elevation/regions/size", json=region(source, zoom=20)).status_code == 422
    assert client.post("elevation/regions", json=region(source, name="../up")).json()["field"] == "name"
    assert server.asked == []


@pytest.mark.parametrize("disk_s", [0.0, 0.3])
def test_a_cancelled_saving_leaves_nothing(client, server, source, folder, monkeypatch, disk_s):
    begin = regions._begin
    monkeypatch.setattr(regions, "_begin", lambda part: time.sleep(disk_s) or begin(part))
    server.answer = lambda path: time.sleep(0.3) or hill_tile(path)
    operation = client.post("elevation/regions", json=region(source, zoom=15)).json()
    assert client.delete(f"operations/{operation['id']}").status_code in (200, 204)
    deadline_s = time.monotonic() + 20
    while client.get(f"operations/{operation['id']}").json()["state"] == "running":
        assert time.monotonic() < deadline_s
        time.sleep(0.02)
    assert client.get(f"operations/{operation['id']}").json()["state"] == "cancelled"
    time.sleep(2 * disk_s)
    assert list(folder.glob("*")) == []


def test_the_choice_survives_a_restart_apart_from_the_map_source(tmp_path, server):
    with api_client(tmp_path, path="/api/v1/") as client:
        client.post("elevation/sources", json={"name": "Hills", "url": server.url})
        client.put("elevation/sources/chosen", json={"source": "own1"})
    with api_client(tmp_path, path="/api/v1/") as client:
        assert client.get("elevation/sources").json()["chosen"] == "own1"
        assert client.get("map_sources").json()["chosen"] is None
        refused = client.post("elevation/regions/size", json=region("own1"))
        assert "terms of Hills" in refused.json()["detail"]
        unknown = client.put("elevation/sources/chosen", json={"source": "osm"}).json()
        assert (unknown["code"], "elevation source" in unknown["detail"]) == ("unknown_map_source", True)
        assert client.delete("elevation/sources/own1").status_code == 204
        assert client.get("elevation/sources").json()["chosen"] is None


def test_the_known_ground_is_served_as_tiles_until_a_file_changes(client, source, folder):
    assert client.get("elevation").json()["tiles_url"] is None
    write_elevation_file(folder / "hill.tif", HILL)
    url = client.get("elevation").json()["tiles_url"].removeprefix("/api/v1/")
    zoom, x, y = next(iter(Region((LON_DEG, LAT_DEG, LON_DEG, LAT_DEG), 13, 13).places()))
    first = client.get(f"{url}/{zoom}/{x}/{y}")
    assert (first.status_code, first.headers["content-type"]) == (200, "image/png")
    assert "max-age" in first.headers["cache-control"]
    heights_m = heights_of(first.content)
    expected_m = HILL(*pixel_positions(zoom, x, y, 512))
    assert heights_m[expected_m > 501.0] == pytest.approx(expected_m[expected_m > 501.0], abs=1.5)
    started_s = time.monotonic()
    assert client.get(f"{url}/{zoom}/{x}/{y}").content == first.content
    assert time.monotonic() - started_s < 0.2, "it is kept"
    for place in (f"{zoom}/0/0", f"7/{x >> 6}/{y >> 6}", f"15/{x << 2}/{y << 2}", "8/256/0"):
        assert client.get(f"{url}/{place}").status_code == 204, place
    write_elevation_file(folder / "hill.tif", flat_elevation(100.0))
    assert not client.get("elevation").json()["tiles_url"].endswith(url)
    old = client.get(f"{url}/{zoom}/{x}/{y}")
    assert old.headers["cache-control"] == "no-cache", "the address of the old file shows the new ground"
    assert np.median(heights_of(old.content)) == pytest.approx(100.0, abs=0.1)
    assert len(list((folder.parent / "cache" / "ground_tiles").glob("*.sqlite"))) == 1
