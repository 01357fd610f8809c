"""Flights of a real PX4 commanded over ROS 2, replayed on the topics of the simulated vehicle: setpoints of
the wrong kind, lost streams, setpoints outside Offboard, PX4's example node. `tests/bench` compares the
others.

A flight is compared by its motion since the first event, and by the changes of mode and arming.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from tests.bench.ros2_flights import MANOEUVRES
from tests.contract.ros2_flight_dialogues import GROUPS as IN_DIALOGUES
from tests.contract.ros2_flights import (
    FOLDER,
    Flight,
    changes,
    farthest_m,
    fly,
    largest_errors,
    largest_excess,
    late_changes,
)

pytestmark = pytest.mark.flight

LAND = 18
SPREAD_M = (1.4, 0.8)
"""Largest horizontal and vertical differences between recorded flights with equal setpoints [m]: the example
node and a step, three flights each; a hover, four flights. The simulated vehicle has no noise here."""
LANDING_M = 1.3
"""Largest vertical difference between flights that have a landing [m]."""
DISARMING_S = 6.0
"""Recorded landings from 5 m took 10.3 to 16.1 s until they were detected."""
ALWAYS = frozenset({"all_nan", "hold_goto_30hz"})
"""Flights that `make test` replays; `make test-clients` replays all of them."""
FOLLOWS_VELOCITY = "loss_ocm_only"
"""A flight with vertical velocity setpoints: its altitude drifts with the error of the estimated vertical
speed. The replay has sensor noise."""
SEEDS = range(4)
DRIFTS_ON_GROUND = "nav_takeoff_7m_relative_wrong"
"""The commanded take-off altitude is below the vehicle, so PX4 takes off to the vehicle's own altitude. The
vehicle climbed because its altitude estimate had drifted downwards on the ground; the replay gives the
simulated GPS this drift. The drift in the air is unknown: only the order of the modes and the farthest points
after the go-to are compared."""
GO_TO_S = 12.3
WHOLE = os.environ.get("ALL_DIALOGUES") == "1"


def names() -> list[str]:
    """Names of the flights that neither the bench nor a dialogue compares."""
    index = FOLDER / "index.json"
    flights = json.loads(index.read_text()) if index.exists() else []
    return [
        flight["id"]
        for flight in flights
        if flight["id"] not in MANOEUVRES and flight["group"] not in IN_DIALOGUES
    ]


def vertical_limit_m(flight: Flight) -> float:
    """Limit for the vertical difference of a flight."""
    lands = any(nav_state == LAND for _, nav_state, _ in flight.states)
    return LANDING_M if lands else SPREAD_M[1]


@pytest.mark.parametrize(
    "name",
    [
        each
        for each in names()
        if each not in (FOLLOWS_VELOCITY, DRIFTS_ON_GROUND) and (WHOLE or each in ALWAYS)
    ],
)
def test_a_replayed_flight_is_within_the_spread_of_the_recorded_flights(name: str) -> None:
    flight = Flight.load(name)
    track, states = fly(flight)
    found = late_changes(states, flight.states, DISARMING_S)
    horizontal_m, vertical_m = largest_errors(track, flight.track)
    if horizontal_m > SPREAD_M[0] or vertical_m > vertical_limit_m(flight):
        found.append(f"{horizontal_m:.2f} m horizontally, {vertical_m:.2f} m vertically")
    assert not found


@pytest.mark.skipif(not WHOLE, reason="make test-clients replays all flights")
def test_a_recorded_flight_that_drifts_is_in_the_range_of_simulated_flights_with_noise(shared: Path) -> None:
    assert shared
    flight = Flight.load(FOLLOWS_VELOCITY)
    flown = [fly(flight, noise=seed) for seed in SEEDS]
    assert not any(late_changes(states, flight.states, DISARMING_S) for _, states in flown)
    horizontal_m, vertical_m = largest_excess([track for track, _ in flown], flight.track)
    assert horizontal_m <= SPREAD_M[0]
    assert vertical_m <= vertical_limit_m(flight)


@pytest.mark.skipif(not WHOLE, reason="make test-clients replays all flights")
def test_a_take_off_to_the_present_altitude_climbs_if_the_altitude_estimate_drifts_down_on_the_ground(
    shared: Path,
) -> None:
    assert shared
    flight = Flight.load(DRIFTS_ON_GROUND)
    track, states = fly(flight, with_ground_drift=True)
    assert [each[1:] for each in changes(states)] == [each[1:] for each in changes(flight.states)]
    for simulated_m, recorded_m, limit_m in zip(
        farthest_m(track, GO_TO_S), farthest_m(flight.track, GO_TO_S), SPREAD_M, strict=True
    ):
        assert abs(simulated_m - recorded_m) <= limit_m
    _, states = fly(flight)
    assert changes(states)[-1][1:] != changes(flight.states)[-1][1:], (
        "the vehicle took off also without the drift"
    )


def test_every_named_flight_is_recorded(shared: Path) -> None:
    assert shared
    assert {FOLLOWS_VELOCITY, DRIFTS_ON_GROUND, *ALWAYS} <= set(names())
