"""Map sources: nothing is asked for before one is chosen; tiles are kept, shown when the source is gone, and
saved for the field; wrong addresses and answers are refused in words."""

import re
import sqlite3
import time
from contextlib import closing

import pytest

from gcs_server.errors import InvalidRequest
from gcs_server.maps import sources, tiles
from gcs_server.maps.regions import Region
from gcs_server.maps.sources import MapSource, address_of_tiles
from gcs_server.maps.tiles import KeptTile, TileStore
from tests.support.api_client import api_client
from tests.support.tile_server import PNG, TileServer

BOUNDS = [8.54, 47.39, 8.56, 47.41]


@pytest.fixture
def server():
    server = TileServer()
    yield server
    server.close()


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    data = tmp_path_factory.mktemp("data")
    with api_client(data) as client:
        yield client, data / "maps"


@pytest.fixture
def client(running, monkeypatch):
    """One server for all tests, which has no own sources and no map files before each."""
    monkeypatch.setattr(tiles, "PAUSE_S", 0.05)
    client, folder = running
    yield client
    for source in client.get("/api/v1/map_sources").json()["sources"]:
        if source["own"]:
            client.delete(f"/api/v1/map_sources/{source['id']}")
    for path in folder.glob("*"):
        path.unlink()


@pytest.fixture
def folder(running):
    return running[1]


def add(client, url, **fields):
    body = {"name": "Field", "url": url, "attribution": "Us", "may_save": True, **fields}
    response = client.post("/api/v1/map_sources", json=body)
    assert response.status_code == 201, response.text
    return response.json()["id"]


def choose(client, source):
    return client.put("/api/v1/map_sources/chosen", json={"source": source})


def ended(client, operation):
    deadline_s = time.monotonic() + 20
    while operation["state"] == "running":
        assert time.monotonic() < deadline_s
        time.sleep(0.02)
        operation = client.get(f"/api/v1/operations/{operation['id']}").json()
    return operation


def test_nothing_is_asked_for_before_a_source_is_chosen(client, server):
    source = add(client, server.url)
    listing = client.get("/api/v1/map_sources").json()
    assert listing["chosen"] is None
    assert [each["id"] for each in listing["sources"]] == ["osm", "opentopomap", "esri_imagery", source]
    assert listing["sources"][-1]["host"].startswith("127.0.0.1:")
    refused = client.get(f"/api/v1/map_sources/{source}/3/4/2")
    assert (refused.status_code, refused.json()["code"]) == (409, "refused")
    assert client.get("/api/v1/maps").json()["maps"] == []
    assert server.asked == []


def test_the_chosen_source_is_drawn_below_the_files_and_its_tiles_are_kept(client, server):
    source = add(client, server.url)
    choose(client, source)
    (shown,) = client.get("/api/v1/maps").json()["maps"]
    assert (shown["url"], shown["format"], shown["tiles"]) == (
        f"/api/v1/map_sources/{source}",
        "source",
        "raster",
    )
    assert (shown["attribution"], shown["max_zoom"]) == ("Us", 19)
    for _ in range(2):
        tile = client.get(f"{shown['url']}/3/4/2")
        assert (tile.status_code, tile.headers["content-type"]) == (200, "image/png")
        assert tile.content == PNG + b"/3/4/2.png"
    assert [path for path, _ in server.asked] == ["/3/4/2.png"]
    assert server.asked[0][1].startswith("offboard-gcs/")  # as the terms of public sources ask
    assert client.get(f"{shown['url']}/3/8/0").status_code == 204  # beyond the edge of the world
    assert client.get(f"{shown['url']}/20/0/0").status_code == 204  # beyond its greatest zoom


def test_a_source_that_is_gone_still_shows_what_was_kept(client, server, monkeypatch):
    source = add(client, server.url)
    choose(client, source)
    first = client.get(f"/api/v1/map_sources/{source}/3/4/2")
    server.close()
    monkeypatch.setattr(tiles, "FRESH_S", -1.0)
    assert client.get(f"/api/v1/map_sources/{source}/3/4/2").content == first.content
    failed = client.get(f"/api/v1/map_sources/{source}/3/4/3")
    assert (failed.status_code, failed.json()["code"]) == (502, "map_source_failed")
    assert "Field (127.0.0.1" in failed.json()["detail"]
    assert "Field" in client.get("/api/v1/map_sources").json()["sources"][-1]["problem"]


@pytest.mark.parametrize(
    ("status", "answer", "expected", "text"),
    [
        (200, b"<html>please sign in</html>", 502, "no PNG, JPEG or WebP image"),
        (200, PNG + bytes(tiles.MAX_TILE_BYTES), 502, "more than 2 MB"),
        (200, b"", 502, "no PNG"),
        (500, b"", 502, "status 500"),
        (404, b"none", 204, ""),
    ],
)
def test_answers_that_are_no_tile_are_named(client, server, status, answer, expected, text):
    source = add(client, server.url)
    choose(client, source)
    server.status, server.answer = status, answer
    response = client.get(f"/api/v1/map_sources/{source}/1/0/0")
    assert response.status_code == expected
    assert text in response.text


def test_a_failing_source_is_not_asked_for_every_tile(client, server, monkeypatch):
    monkeypatch.setattr(tiles, "PAUSE_S", 60.0)
    source = add(client, server.url)
    choose(client, source)
    server.status = 503
    for x in range(4):
        assert client.get(f"/api/v1/map_sources/{source}/4/{x}/0").status_code == 502
    assert len(server.asked) == 1


def test_the_choice_and_own_sources_survive_a_restart(tmp_path, server):
    with api_client(tmp_path) as client:
        choose(client, add(client, server.url))
    with api_client(tmp_path) as client:
        assert client.get("/api/v1/map_sources").json()["chosen"] == "own1"
        assert client.delete("/api/v1/map_sources/own1").status_code == 204
        assert client.get("/api/v1/map_sources").json()["chosen"] is None
        usual = client.delete("/api/v1/map_sources/osm")
        assert (usual.status_code, usual.json()["code"]) == (409, "refused")
        assert choose(client, "other").json()["code"] == "unknown_map_source"
        assert client.delete("/api/v1/map_sources/own1").status_code == 404


def test_a_file_of_another_version_is_kept_and_named(tmp_path, server):
    file = tmp_path / "map_sources" / "sources.json"
    file.parent.mkdir()
    file.write_text('{"chosen": "osm", "own": [], "layers": []}')
    with api_client(tmp_path) as client:
        assert client.get("/api/v1/map_sources").json()["chosen"] is None
        (warning,) = client.get("/api/v1/warnings").json()["warnings"]
        assert "sources.json cannot be read: layers" in warning["text"]
        refused = choose(client, "osm")
        assert refused.json()["code"] == "refused"
    assert "layers" in file.read_text()


def test_a_region_is_saved_as_a_map_file(client, server):
    source = add(client, server.url)
    choose(client, source)
    region = {"source": source, "name": "Test field", "bounds_deg": BOUNDS, "min_zoom": 10, "max_zoom": 15}
    size = client.post("/api/v1/map_regions/size", json=region).json()
    assert size["tiles"] == Region(tuple(BOUNDS), 10, 15).count() == 23
    assert server.asked == []
    operation = client.post("/api/v1/map_regions", json=region).json()
    operation = ended(client, operation)
    assert (operation["state"], operation["result"]) == (
        "succeeded",
        {"file": "Test field.mbtiles", "tiles": 23},
    )
    choose(client, None)
    server.close()
    (shown,) = client.get("/api/v1/maps").json()["maps"]
    assert (shown["min_zoom"], shown["max_zoom"], shown["attribution"]) == (10, 15, "Us")
    assert shown["bounds_deg"] == BOUNDS
    zoom, x, y = next(iter(Region(tuple(BOUNDS), 10, 15).places()))
    assert client.get(f"{shown['url']}/{zoom}/{x}/{y}").content == PNG + f"/{zoom}/{x}/{y}.png".encode()
    again = client.post("/api/v1/map_regions", json=region)
    assert (again.status_code, again.json()["field"]) == (422, "name")


def test_a_source_that_stops_answering_ends_the_saving_and_leaves_nothing(client, server, folder):
    source = add(client, server.url)
    server.status = 500
    region = {"source": source, "name": "half", "bounds_deg": BOUNDS, "min_zoom": 10, "max_zoom": 12}
    operation = ended(client, client.post("/api/v1/map_regions", json=region).json())
    assert (operation["state"], operation["error"]["code"]) == ("failed", "map_source_failed")
    assert list(folder.glob("*")) == []


@pytest.mark.parametrize(
    ("change", "code", "text"),
    [
        ({"source": "osm"}, "refused", "do not allow"),
        ({"max_zoom": 19, "bounds_deg": [8, 47, 9, 48]}, "refused", "at most 50,000"),
        ({"bounds_deg": [9, 47, 8, 48]}, "invalid_request", "West must be less"),
        ({"min_zoom": 13, "max_zoom": 12}, "invalid_request", "zooms 13 to 12"),
        ({"max_zoom": 20}, "invalid_request", "0 to 19"),
        ({"name": "../up"}, "invalid_request", "cannot be the name"),
    ],
)
def test_a_region_that_cannot_be_saved_is_refused(client, server, change, code, text):
    region = {
        "source": add(client, server.url),
        "name": "x",
        "bounds_deg": BOUNDS,
        "min_zoom": 3,
        "max_zoom": 9,
    }
    response = client.post("/api/v1/map_regions", json={**region, **change})
    assert response.json()["code"] == code
    assert text in response.json()["detail"]


@pytest.mark.parametrize(
    ("pasted", "tile"),
    [
        ("https://a.example/{z}/{x}/{y}.png", "https://a.example/5/17/11.png"),
        ("https://{s}.example/{Z}/{X}/{-y}", "https://a.example/5/17/20"),
        ("https://a.example/t{quadkey}.jpg", "https://a.example/t12023.jpg"),
        (
            "https://a.example/wmts/l/3857/{TileMatrix}/{TileRow}/{TileCol}.png",
            "https://a.example/wmts/l/3857/5/11/17.png",
        ),
        (
            "https://a.example/?SERVICE=WMTS&REQUEST=GetTile&TileMatrixSet=m&TileMatrix=m:7&TileRow=3&TileCol=4",
            "https://a.example/?SERVICE=WMTS&REQUEST=GetTile&TileMatrixSet=m&TileMatrix=m:5&TileRow=11&TileCol=17",
        ),
    ],
)
def test_addresses_as_other_programs_write_them(pasted, tile):
    source = MapSource("x", "x", address_of_tiles(pasted), "", 19, may_save=False)
    assert source.tile_url(5, 17, 11) == tile


@pytest.mark.parametrize(
    ("pasted", "text"),
    [
        ("file:///etc/passwd", "http"),
        ("https:///{z}/{x}/{y}", "name a computer"),
        ("https://a.example/tiles", "names no tile"),
        ("https://a.example/{Style}/{z}/{x}/{y}", "{Style}"),
        ("https://a.example/?request=GetCapabilities&service=WMTS", "description of a WMTS"),
        ("https://a.example/{z}/{x}/{y} .png", "spaces"),
    ],
)
def test_an_address_that_is_none_is_refused_with_the_reason(pasted, text):
    with pytest.raises(InvalidRequest, match=re.escape(text)):
        address_of_tiles(pasted)


def test_a_damaged_store_is_replaced_and_the_oldest_tiles_go_first(tmp_path, monkeypatch):
    path = tmp_path / "s.sqlite"
    path.write_bytes(b"not a database" * 100)
    store = TileStore(path)
    assert store.get(0, 0, 0) is None
    monkeypatch.setattr(tiles, "SIZE_CHECK_EVERY", 1)
    monkeypatch.setattr(tiles, "MAX_STORE_BYTES", 200_000)
    for x in range(100):
        store.put(7, x, 0, KeptTile(PNG + bytes(10_000), float(x)))
    assert store.size_bytes() <= 220_000
    assert store.get(7, 0, 0) is None
    assert store.get(7, 99, 0) is not None
    store.close()


def test_too_many_own_sources_are_refused(client, monkeypatch):
    monkeypatch.setattr(sources, "MAX_OWN_SOURCES", 1)
    add(client, "http://a.example/{z}/{x}/{y}")
    body = {"name": "Second", "url": "http://b.example/{z}/{x}/{y}"}
    assert client.post("/api/v1/map_sources", json=body).json()["code"] == "refused"
    body["name"] = "OpenStreetMap"
    assert client.post("/api/v1/map_sources", json=body).json()["field"] == "name"


def test_a_saved_file_has_the_rows_of_mbtiles(client, server, folder):
    region = {"source": add(client, server.url), "name": "w", "bounds_deg": [-180, -85, 180, 85]}
    ended(client, client.post("/api/v1/map_regions", json={**region, "min_zoom": 0, "max_zoom": 1}).json())
    with closing(sqlite3.connect(folder / "w.mbtiles")) as database:
        rows = dict(((z, x, y), content) for z, x, y, content in database.execute("SELECT * FROM tiles"))
    assert len(rows) == 5
    assert rows[1, 0, 0] == PNG + b"/1/0/1.png"  # counted from the south
