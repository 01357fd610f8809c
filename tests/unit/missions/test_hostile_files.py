"""Reading any file ends within limited time and memory, with a plan or with a PlanError."""

from __future__ import annotations

import json
import time
import tracemalloc
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions import plan
from missions.bounded_json import MAX_FILE_BYTES
from missions.errors import PlanError
from missions.formats import csv_table, geojson, kml, qgc_plan, waypoints
from missions.formats.results import ImportOptions
from missions.values import Altitude

OPTIONS = ImportOptions(altitude=Altitude(value_m=20.0, reference="home"))
READERS: dict[str, Callable[[bytes], Any]] = {
    "own JSON": plan.read,
    "plan": qgc_plan.read,
    "waypoints": waypoints.read,
    "csv": lambda data: csv_table.read(data, OPTIONS),
    "geojson": lambda data: geojson.read(data, OPTIONS),
    "kml": lambda data: kml.read(data, OPTIONS),
}
MAX_TIME_S, MAX_MEMORY_BYTES = 10.0, 300_000_000
"""Limits of processor time and memory for the largest file; documented in docs/missions.md."""


def a_plan_file(**mission: Any) -> bytes:
    fields = {"items": [], "version": 2, **mission}
    return json.dumps({"fileType": "Plan", "mission": fields, "version": 1}).encode()


NEARLY_MAX_BYTES = MAX_FILE_BYTES - 200
HOSTILE_FILES = {
    "100 MB": b" " * 100_000_000,
    "deep lists": b"[" * 1_000_000,
    "deep objects": b'{"a":' * 100_000,
    "unclosed text": b'{"a":"' + b"\\" * 100_000,
    "not UTF-8": b"\xff\xfe\x00",
    "empty file": b"",
    "NUL": b"\x00" * 100,
    "NaN": a_plan_file(plannedHomePosition=[float("nan"), 0, 0]),
    "1e308": b'{"fileType":"Plan","mission":{"version":2,"items":[],"hoverSpeed":1e308}}',
    "1e999": b'{"fileType":"Plan","mission":{"version":2,"items":[],"hoverSpeed":1e999}}',
    "many digits": b'{"fileType":' + b"9" * 1_000_000 + b"}",
    "repeated key": b'{"fileType":"Plan","fileType":"Plan"}',
    "lone surrogate": b'{"fileType":"Plan\\ud800"}',
    "wrong types": a_plan_file(items=[{"type": "SimpleItem", "command": [], "frame": {}, "params": "x"}]),
    "many empty lists": b"[" + b"[]," * (NEARLY_MAX_BYTES // 3) + b"[]]",
    "many keys": b"{" + b",".join(b'"%d":0' % n for n in range(240_000)) + b"}",
    "many commas": b"QGC WPL 110\n" + b"," * NEARLY_MAX_BYTES,
    "many lines": b"QGC WPL 110\n" + b"\n" * NEARLY_MAX_BYTES,
    "many items": b"QGC WPL 110\n" + b"1 0 3 16 0 0 0 0 1 1 1 1\n" * 20_000,
    "long table": b"lat_deg,lon_deg\n" + b"1,1\n" * (NEARLY_MAX_BYTES // 4),
    "wide table": b"lat_deg" + b",lat_deg" * (NEARLY_MAX_BYTES // 8),
    "long line": b"<kml><Placemark><LineString><coordinates>" + b"1,1\n" * (NEARLY_MAX_BYTES // 4 - 40)
    + b"</coordinates></LineString></Placemark></kml>",
    "many elements": b"<kml>" + b"<a/>" * (NEARLY_MAX_BYTES // 4 - 10) + b"</kml>",
    "many attributes": b"<kml " + b" ".join(b'a%d=""' % n for n in range(600_000)) + b"/>",
}  # fmt: skip


def plan_error_of(read: Callable[[bytes], Any], data: bytes) -> PlanError | None:
    """The PlanError that the reader raises; None if it returns a plan. Any other exception fails the test."""
    try:
        read(data)
    except PlanError as error:
        return error
    return None


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("name", HOSTILE_FILES)
def test_a_hostile_file_is_refused_with_a_reason_and_in_limited_time(name: str, reader: str) -> None:
    began_s = time.process_time()
    error = plan_error_of(READERS[reader], HOSTILE_FILES[name])
    assert error is not None
    assert error.place
    assert error.fix.endswith(".")
    assert len(str(error)) < 1000
    assert time.process_time() - began_s < MAX_TIME_S


@pytest.mark.parametrize(("name", "reader"), [("many empty lists", "plan"), ("many items", "waypoints")])
def test_a_hostile_file_takes_limited_memory(name: str, reader: str) -> None:
    tracemalloc.start()
    try:
        with pytest.raises(PlanError):
            READERS[reader](HOSTILE_FILES[name])
        assert tracemalloc.get_traced_memory()[1] < MAX_MEMORY_BYTES
    finally:
        tracemalloc.stop()


@settings(deadline=None, max_examples=100)
@given(data=st.binary(max_size=300) | st.text(max_size=300).map(lambda text: text.encode("utf-8", "ignore")))
def test_any_bytes_give_a_plan_or_a_plan_error(data: bytes) -> None:
    for read in READERS.values():
        plan_error_of(read, data)


any_json = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=8,
)
MISSION_KEYS = ["items", "plannedHomePosition", "hoverSpeed", "cruiseSpeed", "version"]
ITEM_KEYS = ["type", "command", "frame", "params", "autoContinue", "Altitude", "AltitudeMode", "doJumpId"]


@settings(deadline=None, max_examples=150)
@given(data=st.data())
def test_a_plan_file_with_any_value_in_any_field_gives_a_plan_or_a_plan_error(data: st.DataObject) -> None:
    item = {
        "type": "SimpleItem",
        "command": 16,
        "frame": 3,
        "params": [0, 0, 0, None, 47, 8, 20],
        "AltitudeMode": 3,
    }
    mission: dict[str, Any] = {"version": 2, "items": [item]}
    parent, keys = data.draw(st.sampled_from([(item, ITEM_KEYS), (mission, MISSION_KEYS)]))
    parent[data.draw(st.sampled_from(keys))] = data.draw(any_json)
    document = json.dumps({"fileType": "Plan", "mission": mission})
    plan_error_of(lambda text: qgc_plan.write(qgc_plan.read(text).plan), document.encode())
