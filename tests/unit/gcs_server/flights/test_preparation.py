"""Missions that are compiled before arming: when they are compiled again, and when they may begin."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, cast

import pytest

from gcs_server.flights.mission_values import Start
from gcs_server.flights.preparation import (
    COMPILING,
    MIN_INTERVAL_S,
    RETRY_S,
    CompileInputs,
    Preparation,
)
from missions.geodesy import LocalOrigin

FIRST_START, SECOND_START = cast(Start, object()), cast(Start, object())
ORIGIN = LocalOrigin(47.0, 8.0, 480.0)
INPUTS = CompileInputs((0.0, 0.0, 0.0), 0.1, ORIGIN, {"height_max_m": 50.0})


@pytest.mark.parametrize(
    ("change", "compiled_again", "ready"),
    [
        ({}, False, True),
        ({"position_ned_m": (0.2, 0.0, -0.1)}, False, True),
        ({"position_ned_m": (0.6, 0.0, 0.0)}, True, True),
        ({"position_ned_m": (30.0, 0.0, 0.0)}, True, False),
        ({"yaw_ned_rad": math.tau + 0.12}, False, True),
        ({"yaw_ned_rad": 0.3}, True, True),
        ({"yaw_ned_rad": 2.0}, True, False),
        ({"origin": replace(ORIGIN, alt_amsl_m=480.2)}, False, True),
        ({"origin": replace(ORIGIN, lat_deg=47.000005)}, True, True),
        ({"origin": replace(ORIGIN, alt_amsl_m=485.0)}, True, False),
        ({"origin": None}, True, False),
        ({"settings": {"height_max_m": 40.0}}, True, False),
    ],
)
def test_a_mission_is_compiled_again_after_a_large_change(
    change: dict[str, Any], compiled_again: bool, ready: bool
) -> None:
    preparation = Preparation(FIRST_START, INPUTS)
    assert preparation.update(5.0, replace(INPUTS, **change)) == compiled_again
    assert preparation.ready == ready
    assert preparation.reason == ("" if ready else COMPILING)


def test_without_a_position_the_mission_is_not_ready() -> None:
    preparation = Preparation(FIRST_START, INPUTS)
    assert preparation.update(5.0, None)
    assert not preparation.ready


def test_a_mission_is_not_compiled_twice_at_a_time_and_not_continuously() -> None:
    preparation = Preparation(FIRST_START, INPUTS)
    inputs_elsewhere = replace(INPUTS, position_ned_m=(30.0, 0.0, 0.0))
    assert preparation.update(5.0, inputs_elsewhere)
    assert not preparation.update(9.0, inputs_elsewhere)
    preparation.succeeded(SECOND_START, inputs_elsewhere, 10.0)
    assert not preparation.update(10.1, INPUTS)
    assert preparation.update(10.0 + MIN_INTERVAL_S, INPUTS)
    preparation.succeeded(SECOND_START, INPUTS, 12.0)
    assert not preparation.update(20.0, INPUTS)
    assert preparation.start is SECOND_START


def test_a_mission_that_cannot_be_compiled_does_not_begin_and_is_tried_again() -> None:
    preparation = Preparation(FIRST_START, INPUTS)
    assert preparation.update(5.0, replace(INPUTS, settings={}))
    preparation.failed("The path leaves the geofence.", 6.0)
    assert not preparation.update(6.1, INPUTS)
    assert not preparation.ready
    assert preparation.start is None
    assert preparation.reason == "The path leaves the geofence."
    assert preparation.update(6.0 + RETRY_S, INPUTS)
