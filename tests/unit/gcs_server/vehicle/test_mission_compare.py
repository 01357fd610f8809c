"""A vehicle's items are compared with a plan by what they mean to PX4."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from gcs_server.vehicle.services.mission_compare import differences
from missions.formats.mavlink_items import WireItem


def item(command: int, *params: float, frame: int = 6, **fields: Any) -> WireItem:
    padded = (*params, 0.0, 0.0, 0.0, 0.0)[:4]
    return replace(WireItem(0, frame, command, *padded, x=473_977_420, y=85_455_940, z=20.0), **fields)


@pytest.mark.parametrize(
    ("part", "sent", "returned"),
    [
        ("fence", item(5001, 4.0), item(5001, 4.0, frame=5, autocontinue=False, current=True)),
        ("fence", item(5003, 50.0, frame=3), item(5003, 50.0, frame=5, autocontinue=False)),
        ("rally", item(5100, frame=3), item(5100, current=True)),
        ("mission", item(16, 0.0, 2.0, 0.0, -90.0), item(16, 0.0, 2.0, 0.0, 270.0)),
        ("mission", item(22, 0.0, 0.0, 0.0, 360.0), item(22, 0.0, 0.0, 0.0, 0.0)),
        ("mission", item(21, 0.0, 0.0, 0.0, math.nan, frame=3), item(21, 0.0, 0.0, 0.0, math.nan)),
        ("mission", item(177, 2.0, -1.0, frame=2), item(177, 2.0, 65_535.0, frame=2)),
        ("mission", item(19, 5.0, 1.0, 10.0, 90.0), item(19, 5.0, 1.0, 10.0, 1.0)),
        ("mission", item(201, 3.0), item(201, 0.0)),
        ("mission", item(80, 3.0), item(201, 0.0)),
        ("mission", item(22, 0.0, math.nan, math.nan, 0.0), item(22)),
    ],
)
def test_the_form_that_px4_returns_is_the_same_plan(part, sent, returned):
    assert differences(part, [sent], [returned]) == []
    assert differences(part, [returned], [sent]) == []
    assert differences(part, [sent], [sent]) == [], "a vehicle that returns items as sent has the plan too"


def test_a_parameter_that_px4_does_not_store_is_reported_but_is_the_same_plan():
    (difference,) = differences("mission", [item(16, 0.0, 2.0, 5.0)], [item(16, 0.0, 2.0, 0.0)])
    assert (difference.field, difference.planned, difference.held) == ("param3", 5.0, 0.0)
    assert not difference.essential


@pytest.mark.parametrize(
    ("part", "sent", "returned"),
    [
        ("fence", item(5001, 4.0), item(5002, 4.0, frame=5, autocontinue=False)),
        ("fence", item(5003, 50.0), item(5003, 60.0, frame=5, autocontinue=False)),
        ("fence", item(5003, 50.0), item(5003, 50.0, frame=5, autocontinue=False, x=473_977_421)),
        ("rally", item(5100, frame=3), item(5100, frame=5)),
        ("rally", item(5100, frame=3), item(5100, z=21.0)),
        ("mission", item(16, 0.0, 2.0, 0.0, -90.0), item(16, 0.0, 2.0, 0.0, 90.0)),
        ("mission", item(16, 0.0, 2.0, 0.0, 90.0), item(16, 0.0, 2.0, 0.0, math.nan)),
        ("mission", item(16, 30.0), item(16, 0.0)),
        ("mission", item(93, 0.0, 0.0, 0.0, 1.0, frame=2), item(93, 0.0, 0.0, 0.0, 361.0, frame=2)),
        ("mission", item(177, 2.0, -1.0, frame=2), item(177, 2.0, 3.0, frame=2)),
        ("mission", item(19, 5.0, 1.0), item(19, 5.0, 0.0)),
        ("mission", item(16, autocontinue=True), item(16, autocontinue=False)),
    ],
)
def test_another_flight_is_another_plan(part, sent, returned):
    assert [each.essential for each in differences(part, [sent], [returned])] == [True]
