"""The checks find errors in exactly the missions that a real PX4 v1.16 refused, apart from `STRICTER`.

The data are recorded uploads: MISSION_ACK, events, and the items (frame, command, four parameters, x, y, z,
autocontinue; null is NaN).
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from missions.checks import CheckLimits, check
from missions.formats.mavlink_items import WireItem, items_from_wire, mission_items
from missions.plan import Plan
from missions.values import HomePosition

FILE = Path(__file__).parents[2] / "data" / "plans" / "recorded_missions.jsonl"
UPLOADS = [json.loads(line) for line in FILE.read_text(encoding="utf-8").splitlines()]
HOME = HomePosition(lat_deg=47.397742, lon_deg=8.545594, alt_amsl_m=489.0)
STRICTER = {"altitude_below_home"}
"""Codes of errors in missions that PX4 accepts, and then flies into the ground."""
INT_FRAMES = {0: 5, 3: 6}
"""MAV_FRAME of MISSION_ITEM_INT for each MAV_FRAME of MISSION_ITEM."""


def wire_items(upload: dict[str, Any], frames: dict[int, int]) -> list[WireItem]:
    """The items of an upload; `frames` has the new frame for each frame to replace."""
    items: list[WireItem] = []
    for seq, (frame, command, *params, x, y, z, autocontinue) in enumerate(upload["items"]):
        p1, p2, p3, p4, z = (math.nan if value is None else float(value) for value in (*params, z))
        frame = frames.get(frame, frame)
        items.append(WireItem(seq, frame, command, p1, p2, p3, p4, x, y, z, bool(autocontinue), seq == 0))
    return items


@pytest.mark.parametrize("upload", UPLOADS, ids=lambda upload: upload["name"])
def test_the_checks_find_errors_in_exactly_the_missions_that_px4_refused(upload: dict[str, Any]) -> None:
    plan = Plan(items=items_from_wire(wire_items(upload, {})), planned_home=HOME)
    findings = check(plan, CheckLimits(leg_max_m=None))
    errors = [each for each in findings if each.severity == "error" and each.code not in STRICTER]
    assert bool(errors) == (upload["ack"] != 0 or bool(upload["events"])), errors


@pytest.mark.parametrize("upload", UPLOADS, ids=lambda upload: upload["name"])
def test_a_recorded_mission_is_encoded_unchanged(upload: dict[str, Any]) -> None:
    items = items_from_wire(wire_items(upload, {}))
    assert repr(list(mission_items(Plan(items=items)))) == repr(wire_items(upload, INT_FRAMES))
