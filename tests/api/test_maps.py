"""The operator's map files: listed with their metadata, read in parts, served as tiles."""

import gzip
import json
import os
import sqlite3
import struct
from contextlib import closing

import pytest

from gcs_server.storage import maps as map_files
from tests.support.api_client import api_client

FAKE_PNG = b"\x89PNG\r\n\x1a\n not really"


def write_pmtiles(path, *, tile_type=2, metadata=None, bounds=(8.5, 47.3, 8.6, 47.4), data=b"tiles" * 100):
    compressed_metadata = gzip.compress(json.dumps(metadata or {}).encode())
    tiles_offset = 127 + len(compressed_metadata)
    # offset and length of root directory, metadata, leaf directories and tiles, then three numbers of tiles
    numbers = [127, 0, 127, len(compressed_metadata), tiles_offset, 0, tiles_offset, len(data), 1, 1, 1]
    header = b"PMTiles" + bytes([3]) + struct.pack("<11Q", *numbers)
    # clustered, metadata compressed by gzip, tiles not compressed, type, minimum and maximum zoom
    header += bytes([1, 2, 1, tile_type, 3, 15])
    header += struct.pack("<4i", *(round(b * 1e7) for b in bounds)) + bytes([10]) + struct.pack("<2i", 0, 0)
    path.write_bytes(header + compressed_metadata + data)


def write_mbtiles(path, *, metadata=None, tiles=((1, 0, 1, FAKE_PNG),)):
    with closing(sqlite3.connect(path)) as database:
        database.execute("CREATE TABLE metadata (name text, value text)")
        database.execute("CREATE TABLE tiles (zoom_level int, tile_column int, tile_row int, tile_data blob)")
        rows = {"format": "png", "bounds": "8.5,47.3,8.6,47.4", **(metadata or {})}
        database.executemany("INSERT INTO metadata VALUES (?, ?)", rows.items())
        database.executemany("INSERT INTO tiles VALUES (?, ?, ?, ?)", tiles)
        database.commit()


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "maps").mkdir()
    return tmp_path / "maps"


@pytest.fixture
def client(tmp_path, folder):
    with api_client(tmp_path) as client:
        yield client


def test_without_map_files_the_list_is_empty_and_the_folder_is_named(client, folder):
    assert client.get("/api/v1/maps").json() == {"folder": str(folder), "maps": [], "unreadable": []}


def test_the_list_has_the_metadata_of_each_file(client, folder):
    write_pmtiles(folder / "a.pmtiles", metadata={"attribution": "Somebody"})
    write_pmtiles(
        folder / "b c.pmtiles", tile_type=1, metadata={"vector_layers": [{"id": "roads"}, {"id": "water"}]}
    )
    write_mbtiles(folder / "c.mbtiles")
    (folder / "notes.txt").write_text("not a map")
    a, b, c = client.get("/api/v1/maps").json()["maps"]
    assert (a["tiles"], a["format"], a["min_zoom"], a["max_zoom"]) == ("raster", "pmtiles", 3, 15)
    assert (a["attribution"], a["bounds_deg"]) == ("Somebody", [8.5, 47.3, 8.6, 47.4])
    assert (b["tiles"], b["layers"], b["url"]) == ("vector", ["roads", "water"], "/api/v1/maps/b%20c.pmtiles")
    assert (c["format"], c["min_zoom"], c["max_zoom"], c["attribution"]) == ("mbtiles", 1, 1, None)


def test_damaged_files_are_listed_with_the_reason(client, folder):
    (folder / "cut.pmtiles").write_bytes(b"PMTiles\x03 short")
    (folder / "other.pmtiles").write_bytes(b"x" * 200)
    (folder / "empty.mbtiles").write_bytes(b"")
    write_mbtiles(folder / "odd.mbtiles", metadata={"format": "tiff"})
    write_mbtiles(folder / "none.mbtiles", tiles=())
    listing = client.get("/api/v1/maps").json()
    assert listing["maps"] == []
    assert len(listing["unreadable"]) == 5
    assert any("odd.mbtiles" in line and "tiff" in line for line in listing["unreadable"])
    assert any("none.mbtiles" in line and "no tiles" in line for line in listing["unreadable"])


def test_a_pmtiles_file_is_read_in_parts(client, folder):
    write_pmtiles(folder / "a.pmtiles")
    whole = (folder / "a.pmtiles").read_bytes()
    part = client.get("/api/v1/maps/a.pmtiles", headers={"Range": "bytes=0-126"})
    assert (part.status_code, part.content) == (206, whole[:127])
    assert part.headers["content-range"] == f"bytes 0-126/{len(whole)}"
    assert part.headers["etag"]
    assert client.get("/api/v1/maps/a.pmtiles", headers={"Range": "bytes=999999-"}).status_code == 416
    assert client.get("/api/v1/maps/a.pmtiles").content == whole


def test_the_api_numbers_tile_rows_from_the_north_and_the_file_from_the_south(client, folder):
    write_mbtiles(folder / "c.mbtiles")  # row 1 of 2, counted from the south
    tile = client.get("/api/v1/maps/c.mbtiles/1/0/0")
    assert (tile.status_code, tile.content, tile.headers["content-type"]) == (200, FAKE_PNG, "image/png")
    assert client.get("/api/v1/maps/c.mbtiles/1/0/1").status_code == 204


def test_vector_tiles_are_sent_compressed_as_stored(client, folder):
    write_mbtiles(
        folder / "v.mbtiles", metadata={"format": "pbf"}, tiles=((0, 0, 0, gzip.compress(b"shapes")),)
    )
    tile = client.get("/api/v1/maps/v.mbtiles/0/0/0")
    assert (tile.headers["content-encoding"], tile.content) == ("gzip", b"shapes")


@pytest.mark.parametrize(
    "name", ["missing.pmtiles", "..%2fjournal.jsonl", "..%2f..%2fa.pmtiles", ".hidden.pmtiles", "notes.txt"]
)
def test_only_map_files_of_the_folder_are_served(client, folder, name):
    (folder / "notes.txt").write_text("private")
    write_pmtiles(folder / ".hidden.pmtiles")
    assert client.get(f"/api/v1/maps/{name}").status_code == 404


def test_invalid_tile_numbers_get_status_422(client, folder):
    write_mbtiles(folder / "c.mbtiles")
    assert client.get("/api/v1/maps/c.mbtiles/99/0/0").status_code == 422
    assert client.get("/api/v1/maps/c.mbtiles/1/0/x").status_code == 422


HOSTILE_VIEWS = {
    "recursive": "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) "
    "SELECT i AS zoom_level, 0 AS tile_column, 0 AS tile_row, x'00' AS tile_data FROM n",
    "large": "SELECT a.i AS zoom_level, 0 AS tile_column, 0 AS tile_row, x'00' AS tile_data "
    "FROM many a, many b, many c WHERE a.i + b.i + c.i < 0",
    "of text": "SELECT 1 AS zoom_level, 0 AS tile_column, 0 AS tile_row, 'text' AS tile_data",
    "of a huge value": "SELECT 1 AS zoom_level, 0 AS tile_column, 0 AS tile_row, "
    "zeroblob(900000000) AS tile_data",
}


@pytest.mark.parametrize("view", HOSTILE_VIEWS)
def test_a_view_that_never_ends_is_an_unreadable_map_and_takes_no_thread(client, folder, view, monkeypatch):
    monkeypatch.setattr(map_files, "QUERY_DEADLINE_S", 0.05)
    with closing(sqlite3.connect(folder / "hostile.mbtiles")) as database:
        database.execute("CREATE TABLE metadata (name text, value text)")
        database.execute("CREATE TABLE many (i int)")
        database.executemany("INSERT INTO many VALUES (?)", [(n,) for n in range(2000)])
        database.execute(f"CREATE VIEW tiles AS {HOSTILE_VIEWS[view]}")
        database.commit()
    if view.startswith("of"):
        response = client.get("/api/v1/maps/hostile.mbtiles/1/0/1")
        assert (response.status_code, response.json()["code"]) == (409, "map_file")
        return
    (reason,) = client.get("/api/v1/maps").json()["unreadable"]
    assert "hostile.mbtiles cannot be read" in reason
    assert client.get("/api/v1/maps/hostile.mbtiles/1/0/0").status_code == 409


def test_metadata_that_unpack_to_gigabytes_are_refused_after_a_megabyte(client, folder):
    write_pmtiles(folder / "bomb.pmtiles")
    content = (folder / "bomb.pmtiles").read_bytes()
    bomb = gzip.compress(b" " * 50_000_000)
    header = bytearray(content[:127])
    struct.pack_into("<2Q", header, 8 + 2 * 8, len(content), len(bomb))
    (folder / "bomb.pmtiles").write_bytes(bytes(header) + content[127:] + bomb)
    (reason,) = client.get("/api/v1/maps").json()["unreadable"]
    assert "larger than 1,000,000 bytes" in reason


def test_a_map_file_is_read_again_only_if_it_has_changed(client, folder, monkeypatch):
    write_mbtiles(folder / "green.mbtiles")
    assert client.get("/api/v1/maps/green.mbtiles/1/0/0").status_code == 200
    monkeypatch.setattr(map_files, "_mbtiles", lambda path: (_ for _ in ()).throw(ValueError("it was read")))
    assert client.get("/api/v1/maps/green.mbtiles/1/0/0").status_code == 200
    os.utime(folder / "green.mbtiles", ns=(1, 1))
    assert "it was read" in client.get("/api/v1/maps").json()["unreadable"][0]
