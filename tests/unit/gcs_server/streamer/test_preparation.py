"""Missions that are compiled before arming: when they are compiled again, and when they may begin."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, cast

import pytest

from gcs_server.streamer.missions.preparation import (
    COMPILING,
    MIN_INTERVAL_S,
    RETRY_S,
    Conditions,
    Preparation,
)
from gcs_server.streamer.missions.start import Start

FIRST, SECOND = cast(Start, object()), cast(Start, object())
HERE = Conditions((0.0, 0.0, 0.0), 0.1, {"height_max_m": 50.0})


@pytest.mark.parametrize(
    ("change", "compiles", "ready"),
    [
        ({}, False, True),
        ({"position_ned_m": (0.2, 0.0, -0.1)}, False, True),
        ({"position_ned_m": (0.6, 0.0, 0.0)}, True, True),
        ({"position_ned_m": (30.0, 0.0, 0.0)}, True, False),
        ({"yaw_ned_rad": math.tau + 0.12}, False, True),
        ({"yaw_ned_rad": 0.3}, True, True),
        ({"yaw_ned_rad": 2.0}, True, False),
        ({"settings": {"height_max_m": 40.0}}, True, False),
    ],
)
def test_a_mission_is_compiled_again_after_a_change(
    change: dict[str, Any], compiles: bool, ready: bool
) -> None:
    prepared = Preparation(FIRST, HERE)
    assert prepared.update(5.0, replace(HERE, **change)) == compiles
    assert prepared.ready == ready
    assert prepared.reason == ("" if ready else COMPILING)


def test_without_a_position_the_mission_is_not_ready() -> None:
    prepared = Preparation(FIRST, HERE)
    assert prepared.update(5.0, None)
    assert not prepared.ready


def test_a_mission_is_compiled_once_at_a_time_and_not_continuously() -> None:
    prepared, moved = Preparation(FIRST, HERE), replace(HERE, position_ned_m=(30.0, 0.0, 0.0))
    assert prepared.update(5.0, moved)
    assert not prepared.update(9.0, moved)
    prepared.succeeded(SECOND, moved, 10.0)
    assert not prepared.update(10.1, HERE)
    assert prepared.update(10.0 + MIN_INTERVAL_S, HERE)
    prepared.succeeded(SECOND, HERE, 12.0)
    assert not prepared.update(20.0, HERE)
    assert prepared.start is SECOND


def test_a_mission_that_cannot_be_compiled_does_not_begin_and_is_tried_again() -> None:
    prepared = Preparation(FIRST, HERE)
    assert prepared.update(5.0, replace(HERE, settings={}))
    prepared.failed("The path leaves the geofence.", 6.0)
    assert not prepared.update(6.1, HERE)
    assert not prepared.ready
    assert prepared.start is None
    assert prepared.reason == "The path leaves the geofence."
    assert prepared.update(6.0 + RETRY_S, HERE)
