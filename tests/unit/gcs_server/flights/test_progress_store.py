"""The data folder stores how far a vehicle flew its plan; invalid files do not prevent the server's start."""

import asyncio
import json
from dataclasses import replace

import pytest

from gcs_server.flights import resume as interrupted
from gcs_server.flights.resume import FlightProgress, ProgressStore
from gcs_server.storage import records
from gcs_server.storage.records import Records
from gcs_server.streamer.offboard.limit_store import VehicleKey
from missions.values import HomePosition

KEY, OTHER_KEY = VehicleKey(1, None), VehicleKey(1, "0011223344556677")
HOME = HomePosition(lat_deg=47.0, lon_deg=8.0, alt_amsl_m=500.0)
PROGRESS = FlightProgress(0xFFFF_FFFF, "Field", 12, 10, False, 1_700_000_000.5, HOME)


def store_in(folder):
    store = ProgressStore(Records(folder))
    asyncio.run(store.load())
    return store


def test_progress_is_available_after_a_restart_for_the_same_vehicle_only(tmp_path):
    store = store_in(tmp_path / "flights")
    store.save(KEY, PROGRESS)
    store.close()
    reopened = store_in(tmp_path / "flights")
    assert (reopened.find(KEY), reopened.find(OTHER_KEY)) == (PROGRESS, None)
    reopened.save(KEY, replace(PROGRESS, finished=True, name=None, home=None))
    reopened.close()
    assert store_in(tmp_path / "flights").find(KEY).finished
    assert reopened.warnings() == []


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("format", 2),
        ("mission_id", -1),
        ("mission_id", 2**32),
        ("item", True),
        ("leg_start", 1e300),
        ("name", "x" * 301),
        ("finished", "no"),
        ("unix_s", float("nan")),
        ("home", {"lat_deg": 91}),
        ("home", [1]),
    ],
    ids=str,
)
def test_an_unreadable_file_causes_a_warning_and_the_next_flight_replaces_it(tmp_path, field, value):
    store = store_in(tmp_path)
    store.save(KEY, PROGRESS)
    store.save(OTHER_KEY, PROGRESS)
    store.close()
    file = tmp_path / "system-1.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), field: value}))
    reopened = store_in(tmp_path)
    assert (reopened.find(KEY), reopened.find(OTHER_KEY)) == (None, PROGRESS)
    (warning,) = reopened.warnings()
    assert "system-1.json cannot be read" in warning
    reopened.save(KEY, PROGRESS)
    reopened.close()
    assert reopened.warnings() == []


def test_a_file_that_cannot_be_written_causes_a_warning_and_the_progress_stays_in_memory(tmp_path):
    (tmp_path / "flights").write_text("a file instead of the folder")
    store = ProgressStore(Records(tmp_path / "flights"))
    store.save(KEY, PROGRESS)
    store.close()
    assert store.find(KEY) == PROGRESS
    assert "cannot be written" in store.warnings()[0]


def test_with_too_many_vehicles_the_oldest_record_is_removed(tmp_path, monkeypatch):
    monkeypatch.setattr(interrupted, "MAX_RECORDS", 2)
    monkeypatch.setattr(records, "MAX_RECORDS", 2)
    store = store_in(tmp_path)
    keys = [VehicleKey(system_id, None) for system_id in (1, 2, 3)]
    for number, key in enumerate(keys):
        store.save(key, replace(PROGRESS, unix_s=float(number)))
    store.close()
    assert [store_in(tmp_path).find(key) is not None for key in keys] == [False, True, True]
