"""Simulated time, and a link to a scripted autopilot, for all tests of this folder."""

import math
from collections.abc import Callable, Coroutine
from types import SimpleNamespace
from typing import Any

import pytest

from tests.protocol.fake_autopilot import HOLD, LAND, MANUAL, OFFBOARD, RTL, TAKEOFF, FakeAutopilot
from tests.protocol.memory_world import World
from tests.simulated_time import run_in_simulated_time
from vehicle_sim.mavlink import generated_dialect as sim


@pytest.fixture
def jump() -> Callable[[Callable[[], Coroutine[Any, Any, Any]]], Any]:
    """Runs a coroutine function on simulated time."""
    return run_in_simulated_time


@pytest.fixture
def kit() -> SimpleNamespace:
    """World, autopilot and modes for the test modules."""
    return SimpleNamespace(
        World=World,
        FakeAutopilot=FakeAutopilot,
        HOLD=HOLD,
        TAKEOFF=TAKEOFF,
        LAND=LAND,
        RTL=RTL,
        MANUAL=MANUAL,
        OFFBOARD=OFFBOARD,
        sim=sim,
        nan=math.nan,
    )
