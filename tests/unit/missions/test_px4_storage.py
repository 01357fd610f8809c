"""PX4's storage of items, against recorded uploads and downloads of a real PX4."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.formats.mavlink_items import WireItem, items_from_wire, mission_items
from missions.formats.px4_storage import Part, as_flown, refusal, stored_items
from missions.items import Jump
from missions.plan import Plan

NUMBERS = {None: math.nan, "inf": math.inf, "-inf": -math.inf}
FIELDS = (
    "seq", "frame", "command", "autocontinue", "param1", "param2", "param3", "param4", "x", "y", "z"
)  # fmt: skip


def wire_item(fields: dict[str, Any]) -> WireItem:
    values = {name: NUMBERS.get(fields[name], fields[name]) for name in FIELDS}
    return WireItem(**values | {"autocontinue": bool(fields["autocontinue"] & 1)})


def assert_equal(stored: WireItem, returned: WireItem, case: str) -> None:
    for name in FIELDS:
        expected, value = getattr(returned, name), getattr(stored, name)
        # The recordings have nine digits of a 32-bit number.
        assert value == pytest.approx(expected, rel=1e-6, abs=1e-12, nan_ok=True), (case, name)


def test_each_recorded_item_is_stored_as_recorded(reference_data: Path) -> None:
    count = 0
    for line in (reference_data / "px4/items/items.jsonl").read_text().splitlines():
        case = json.loads(line)
        if case["msg"] != "MISSION_ITEM_INT" or not case.get("downloaded"):
            continue
        (stored,) = stored_items("mission", [wire_item(case["item"])])
        assert_equal(stored, wire_item(case["downloaded"]), case["id"])
        count += 1
    assert count > 400


def test_each_recorded_item_is_refused_as_recorded(reference_data: Path) -> None:
    """Refused at the upload, or rejected afterwards for its command."""
    rejecting = {"navigator_mis_unsup_cmd", "navigator_mis_vtol_items"}
    count = 0
    for line in (reference_data / "px4/items/items.jsonl").read_text().splitlines():
        case = json.loads(line)
        item = case["item"]
        is_point_of_other_part = 5001 <= item["command"] <= 5100 or item["mission_type"] != 0
        if case["msg"] != "MISSION_ITEM_INT" or is_point_of_other_part or case["ack"] is None:
            continue
        rejected = rejecting & {each["name"] for each in case["events"]}
        flown = case["ack"]["type"] == 0 and not rejected
        assert (refusal(wire_item(item)) is None) == flown, (case["id"], refusal(wire_item(item)))
        count += 1
    assert count > 700


@pytest.mark.parametrize("part", ["fence", "rally"])
def test_each_recorded_zone_and_rally_point_is_stored_as_recorded(reference_data: Path, part: Part) -> None:
    """Recorded uploads without other commands, and downloads in the same form of message."""
    count = 0
    for line in (reference_data / f"px4/items/{part}.jsonl").read_text().splitlines():
        case = json.loads(line)
        sent = [each["fields"] for each in case["send"] if each["msg"] == "MISSION_ITEM_INT"]
        listed = (case.get("stored") or {}).get("items")
        returned = {each["seq"]: each for each in listed} if isinstance(listed, list) else {}
        accepted = (case.get("ack") or {}).get("type") == 0 and not case.get("send_total")
        if not accepted or "_with_cmd" in case["id"] or "download_float" in case["id"]:
            continue
        stored = stored_items(part, [wire_item(fields) for fields in sent])
        for item in stored:
            if item.seq in returned:
                assert_equal(item, wire_item(returned[item.seq]), case["id"])
                count += 1
    assert count > {"fence": 180, "rally": 20}[part]


def items(part: Part) -> st.SearchStrategy[WireItem]:
    number = st.floats(width=32, allow_nan=True, allow_infinity=True)
    integer = st.integers(-(2**31), 2**31 - 1)
    commands = {
        "mission": [16, 17, 19, 20, 21, 22, 31, 80, 84, 93, 177, 178, 195, 201, 206, 4501],
        "fence": [5000, 5001, 5002, 5003, 5004],
        "rally": [5100],
    }
    frames = st.sampled_from((0, 2, 3, 5, 6) if part == "mission" else (0, 3, 5, 6))
    return st.builds(
        WireItem, st.just(0), frames, st.sampled_from(commands[part]), number, number, number, number,
        integer, integer, number, st.booleans(),
    )  # fmt: skip


@pytest.mark.parametrize("part", ["mission", "fence", "rally"])
@settings(max_examples=100)
@given(data=st.data())
def test_a_stored_item_is_stored_unchanged(part: Part, data: st.DataObject) -> None:
    once = stored_items(part, [data.draw(items(part))])
    (again,), (first,) = stored_items(part, once), once
    for name in FIELDS:
        expected = getattr(first, name)
        # An angle loses its last digits once more.
        tolerance = 1e-4 if name == "param4" else 0.0
        assert getattr(again, name) == pytest.approx(expected, rel=0, abs=tolerance, nan_ok=True) or (
            name == "param4"
            and expected >= 360.0 - 1e-4  # also what PX4's wrapping leaves of millions of turns
        )


def test_an_endless_jump_is_sent_as_a_number_that_px4_can_store_and_shown_as_endless() -> None:
    (sent,) = mission_items(Plan(items=(Jump(target_index=0, repeat=-1),)))
    assert sent.param2 == 65_535.0
    assert items_from_wire([as_flown(*stored_items("mission", [sent]))]) == (Jump(target_index=0, repeat=-1),)


def test_a_region_of_interest_with_a_position_is_shown_as_location() -> None:
    """PX4 keeps the mode of ROI, but returns 0."""
    sent = WireItem(1, 6, 201, 3.0, 0.0, 0.0, 0.0, 473_980_118, 85_457_269, 12.0)
    (returned,) = stored_items("mission", [sent])
    assert returned.param1 == 0.0
    assert as_flown(returned).param1 == 3.0
