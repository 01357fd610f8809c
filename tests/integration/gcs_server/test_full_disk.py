"""A disk without room while a region is saved: a clear error, and nothing half-written. The limit of a
file's size takes the place of the full disk, in a process of its own."""

import json
import sqlite3
import subprocess
import sys
from contextlib import closing

import pytest

from tests.support.elevation_files import LAT_DEG, LON_DEG, hill_elevation
from tests.support.terrarium_tiles import tile_at
from tests.support.tile_server import TileServer

PROGRAM = """
import asyncio, json, resource, sys
from pathlib import Path
from gcs_server.clock import SystemClock
from gcs_server.errors import GcsError
from gcs_server.maps import regions
from gcs_server.maps.sources import MapSource
from gcs_server.maps.tiles import Tiles
from missions.errors import PlanError
from missions.terrain import terrarium

url, folder, limit, what = sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]), sys.argv[4]
source = MapSource("own1", "Field", url, "", 19, may_save=True)
region = regions.Region((8.49, 47.39, 8.51, 47.41), 13, 13)

async def save():
    tiles = Tiles(SystemClock(), folder / "cache")
    try:
        await regions.save(tiles, source, region, folder / "field.mbtiles", lambda *_: None)
    finally:
        await tiles.close()

try:
    if limit:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    if what == "map":
        asyncio.run(save())
    else:
        terrarium.write_file(folder / "tiles.mbtiles", folder / ".field.tif.made", "Us")
    print(json.dumps(None))
except GcsError as error:
    print(json.dumps([error.message, error.remedy]))
except PlanError as error:
    print(json.dumps([error.reason, error.fix]))
"""


def run(url, folder, limit_bytes, what):
    """The error in words; None: it was saved."""
    command = [sys.executable, "-c", PROGRAM, url, str(folder), str(limit_bytes), what]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    return json.loads(result.stdout.splitlines()[-1])


@pytest.fixture
def url():
    hill = hill_elevation(500.0, 80.0)
    server = TileServer(lambda path: tile_at(hill, *(int(part) for part in path[1:-4].split("/"))))
    yield server.url
    server.close()


def test_a_full_disk_while_a_map_is_saved_is_named_and_leaves_nothing(tmp_path, url):
    text, remedy = run(url, tmp_path, 12_000, "map")
    assert "field.mbtiles cannot be written" in text
    assert "Make room" in remedy
    assert [path.name for path in tmp_path.iterdir() if path.name != "cache"] == []
    assert run(url, tmp_path, 0, "map") is None, "with room it is saved"
    assert (tmp_path / "field.mbtiles").is_file()


def test_a_full_disk_while_the_ground_is_written_is_named(tmp_path):
    hill = hill_elevation(500.0, 80.0, lat_deg=LAT_DEG, lon_deg=LON_DEG)
    with closing(sqlite3.connect(tmp_path / "tiles.mbtiles")) as database, database:
        database.execute("CREATE TABLE tiles (zoom_level, tile_column, tile_row, tile_data)")
        tile = tile_at(hill, 13, 4289, 2868)
        database.execute("INSERT INTO tiles VALUES (13, 4289, ?, ?)", ((1 << 13) - 1 - 2868, tile))
    text, remedy = run("", tmp_path, 4_000, "ground")
    assert "cannot be written (File too large)" in text
    assert "Make room" in remedy
    assert run("", tmp_path, 0, "ground") is None
