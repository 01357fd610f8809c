"""PMTiles archives at an address as map sources: read in parts, raster and vector; archives and servers that
are none are named."""

import gzip
import struct
import time

import pytest

from gcs_server.maps import archive as archives
from gcs_server.maps import tiles
from gcs_server.maps.archive import tile_id
from tests.support.api_client import api_client
from tests.support.archive_server import VECTOR_TILES, ArchiveServer, archive, directory, varint
from tests.support.tile_server import PNG

TILES = {
    tile_id(*place): PNG + repr(place).encode() for place in ((0, 0, 0), (1, 0, 1), (1, 1, 1), (3, 4, 2))
}


@pytest.fixture
def server():
    server = ArchiveServer(archive(TILES))
    yield server
    server.close()


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    with api_client(tmp_path_factory.mktemp("data"), path="/api/v1/") as client:
        yield client


@pytest.fixture
def client(running, monkeypatch):
    monkeypatch.setattr(tiles, "PAUSE_S", 0.0)
    yield running
    for source in running.get("map_sources").json()["sources"]:
        if source["own"]:
            running.delete(f"map_sources/{source['id']}")


def chosen(client, server, **fields):
    body = {"name": "World", "url": server.url, "may_save": True, **fields}
    added = client.post("map_sources", json=body)
    assert added.status_code == 201, added.text
    assert server.asked == [], "nothing is asked for before it is chosen"
    client.put("map_sources/chosen", json={"source": added.json()["id"]})
    return added.json()["id"]


@pytest.mark.parametrize(
    ("place", "number"),
    [
        ((0, 0, 0), 0),
        ((1, 0, 1), 2),
        ((1, 1, 0), 4),
        ((2, 0, 1), 8),
        ((5, 17, 11), 1209),
        ((13, 4289, 2868), 79_383_280),
        ((20, 549_123, 367_455), 1_300_615_530_159),
    ],
)
def test_numbers_of_tiles_as_the_page_has_them(place, number):
    assert tile_id(*place) == number


def test_an_archive_is_read_in_parts_and_its_tiles_are_kept(client, server):
    source = chosen(client, server)
    (shown,) = client.get("maps").json()["maps"]
    assert (shown["tiles"], shown["min_zoom"], shown["max_zoom"]) == ("raster", 0, 3)
    assert (shown["attribution"], shown["bounds_deg"]) == ("© Us", [-180, -85, 180, 85])
    for place in ((0, 0, 0), (1, 0, 1), (1, 1, 1), (3, 4, 2)):
        for _ in range(2):
            tile = client.get(f"map_sources/{source}/{place[0]}/{place[1]}/{place[2]}")
            assert (tile.status_code, tile.content) == (200, TILES[tile_id(*place)])
    assert len(server.asked) == 2 + 2 + 4, "begin, metadata, two leaves, four tiles; each once"
    for place in ("1/0/0", "3/0/0", "4/0/0"):
        assert client.get(f"map_sources/{source}/{place}").status_code == 204
    server.close()
    assert client.get(f"map_sources/{source}/3/4/2").content == TILES[tile_id(3, 4, 2)]


def test_vector_tiles_are_unpacked_and_their_layers_listed(client, server):
    server.content = archive(
        {0: b"\x1a\x02hi"}, kind=VECTOR_TILES, packed=True, metadata={"vector_layers": [{"id": "roads"}]}
    )
    source = chosen(client, server)
    (shown,) = client.get("maps").json()["maps"]
    assert (shown["tiles"], shown["layers"]) == ("vector", ["roads"])
    tile = client.get(f"map_sources/{source}/0/0/0")
    assert (tile.content, tile.headers["content-type"]) == (
        b"\x1a\x02hi",
        "application/vnd.mapbox-vector-tile",
    )
    region = {"source": source, "name": "x", "bounds_deg": [8, 47, 9, 48], "min_zoom": 0, "max_zoom": 3}
    refused = client.post("map_regions", json=region)
    assert (refused.json()["code"], "vector tiles" in refused.json()["detail"]) == ("refused", True)


def test_a_region_of_an_archive_is_saved(client, server):
    region = {"source": chosen(client, server), "name": "Part", "bounds_deg": [-180, -85, 180, 85]}
    operation = client.post("map_regions", json={**region, "min_zoom": 0, "max_zoom": 1}).json()
    deadline_s = time.monotonic() + 20
    while operation["state"] == "running":
        assert time.monotonic() < deadline_s
        time.sleep(0.02)
        operation = client.get(f"operations/{operation['id']}").json()
    assert operation["result"] == {"file": "Part.mbtiles", "tiles": 3}


def test_an_archive_that_changes_is_read_from_its_beginning(client, server):
    source = chosen(client, server)
    client.get(f"map_sources/{source}/0/0/0")
    other = {number: each + b" new" for number, each in TILES.items()}
    server.content, server.etag = archive({**other, tile_id(2, 0, 0): PNG}), '"2"'
    assert client.get(f"map_sources/{source}/3/4/2").content == other[tile_id(3, 4, 2)]


def huge_directory():
    return gzip.compress(varint(1) + varint(0) + varint(0) + varint(5_000_000) + varint(1))


def many_entries():
    return gzip.compress(varint(archives.MAX_ENTRIES + 1))


def bomb():
    return gzip.compress(bytes(archives.MAX_UNPACKED_BYTES + 10))[:10_000]


def large_tile():
    return directory([(0, 1, tiles.MAX_TILE_BYTES + 1, 0)])


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"<html>please sign in</html>" * 100, "no PMTiles archive"),
        (b"PMTiles\x02" + bytes(200), "another version"),
        (archive(TILES)[:150], "root directory"),
        (archive(TILES, kind=7), "neither PNG"),
        (archive(TILES, root=huge_directory()), "directory of 5,000,000 bytes"),
        (archive(TILES, root=many_entries()), "100,001 entries"),
        (archive(TILES, root=bomb()), "more than 4,000,000 bytes"),
        (archive(TILES, root=large_tile()), "tile of 2,000,001 bytes"),
        (archive(TILES, root=gzip.compress(b"\x80\x80")), "damaged directory"),
        (archive(TILES, root=gzip.compress(b"")), "damaged directory"),
        (archive(TILES, root=b"no gzip"), "cannot be unpacked"),
        (archive({0: b"<html>"}), "no PNG, JPEG or WebP image"),
        (archive(TILES, metadata=[1]), "no JSON object"),
    ],
)
def test_an_archive_that_is_none_is_named(client, server, content, text):
    server.content = content
    source = chosen(client, server)
    failed = client.get(f"map_sources/{source}/0/0/0")
    assert (failed.status_code, failed.json()["code"]) == (502, "map_source_failed")
    assert text in failed.json()["detail"]


def test_leaf_directories_that_never_end_are_named(client, server):
    leaf = directory([(0, 0, 10, 0)])
    whole = archive({0: PNG}, root=directory([(0, 0, len(leaf), 0)]))
    leaf = directory([(0, 0, len(leaf), 0)])
    begin = struct.unpack_from("<Q", whole, 8 + 4 * 8)[0]
    server.content = whole[:begin] + leaf + whole[begin + len(leaf) :]
    failed = client.get(f"map_sources/{chosen(client, server)}/0/0/0")
    assert "nested too deeply" in failed.json()["detail"]


@pytest.mark.parametrize(
    ("status", "text"), [(200, "ignores which part"), (404, "status 404"), (416, "status 416")]
)
def test_a_server_that_sends_no_parts_is_named_and_no_map_is_shown(client, server, status, text):
    server.status = status
    source = chosen(client, server)
    assert text in client.get(f"map_sources/{source}/0/0/0").json()["detail"]
    listing = client.get("maps").json()
    assert [each["name"] for each in listing["maps"] if each["format"] != "mbtiles"] == []
    assert text in listing["unreadable"][0]
