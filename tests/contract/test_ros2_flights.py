"""Replays flights of a real PX4, which were commanded over ROS 2, on the topics of the simulated vehicle.

The flights have setpoints of the wrong kind, lost streams, setpoints outside Offboard or PX4's example node;
`tests/bench` compares the other flights. The tests compare the motion since the first event, and the changes
of mode and arming.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from tests.bench.ros2_flights import MANOEUVRES
from tests.contract.ros2_flight_dialogues import GROUPS as DIALOGUE_GROUPS
from tests.contract.ros2_flights import (
    FOLDER,
    Flight,
    farthest_point_m,
    fly,
    largest_errors,
    largest_excess,
    state_changes,
    state_differences,
)

pytestmark = pytest.mark.flight

NAV_STATE_LAND = 18
SPREAD_M = (1.4, 0.8)
"""Largest horizontal and vertical differences between recorded flights with equal setpoints [m]: the example
node and a step, three flights each; a hover, four flights. The simulated vehicle has no noise here."""
LANDING_TOLERANCE_M = 1.3
"""Largest vertical difference between flights that have a landing [m]."""
DISARMING_TOLERANCE_S = 6.0
"""PX4 detected the recorded landings from 5 m after 10.3 to 16.1 s."""
QUICK_FLIGHTS = frozenset({"all_nan", "hold_goto_30hz"})
"""Flights that `make test` replays; `make nightly` replays all of them."""
VELOCITY_FLIGHT = "loss_ocm_only"
"""A flight with vertical velocity setpoints: its altitude drifts with the error of the estimated vertical
speed. The replay has sensor noise."""
NOISE_SEEDS = range(4)
GROUND_DRIFT_FLIGHT = "nav_takeoff_7m_relative_wrong"
"""The commanded take-off altitude is below the vehicle, so PX4 takes off to the vehicle's own altitude. The
vehicle climbed because its altitude estimate had drifted downwards on the ground; the replay gives the
simulated GPS this drift. The drift in the air is unknown: only the order of the modes and the farthest points
after the go-to are compared."""
GO_TO_S = 12.3
"""Time of the go-to in this flight."""
USE_ALL_FLIGHTS = os.environ.get("ALL_DIALOGUES") == "1"


def flight_names() -> list[str]:
    """Names of the flights that neither `tests/bench` nor the tests of the dialogues compare."""
    index = FOLDER / "index.json"
    flights = json.loads(index.read_text()) if index.exists() else []
    return [
        flight["id"]
        for flight in flights
        if flight["id"] not in MANOEUVRES and flight["group"] not in DIALOGUE_GROUPS
    ]


def vertical_limit_m(flight: Flight) -> float:
    """Limit for the vertical difference of a flight."""
    lands = any(nav_state == NAV_STATE_LAND for _, nav_state, _ in flight.states)
    return LANDING_TOLERANCE_M if lands else SPREAD_M[1]


@pytest.mark.parametrize(
    "name",
    [
        each
        for each in flight_names()
        if each not in (VELOCITY_FLIGHT, GROUND_DRIFT_FLIGHT) and (USE_ALL_FLIGHTS or each in QUICK_FLIGHTS)
    ],
)
def test_a_replayed_flight_is_within_the_spread_of_the_recorded_flights(name: str) -> None:
    flight = Flight.load(name)
    track, states = fly(flight)
    differences = state_differences(states, flight.states, DISARMING_TOLERANCE_S)
    horizontal_m, vertical_m = largest_errors(track, flight.track)
    if horizontal_m > SPREAD_M[0] or vertical_m > vertical_limit_m(flight):
        differences.append(f"{horizontal_m:.2f} m horizontally, {vertical_m:.2f} m vertically")
    assert not differences


@pytest.mark.skipif(not USE_ALL_FLIGHTS, reason="make nightly replays all flights")
def test_a_recorded_flight_with_drift_is_in_the_range_of_simulated_flights_with_noise(
    reference_data: Path,
) -> None:
    assert reference_data
    flight = Flight.load(VELOCITY_FLIGHT)
    simulated = [fly(flight, noise=seed) for seed in NOISE_SEEDS]
    assert not any(state_differences(states, flight.states, DISARMING_TOLERANCE_S) for _, states in simulated)
    horizontal_m, vertical_m = largest_excess([track for track, _ in simulated], flight.track)
    assert horizontal_m <= SPREAD_M[0]
    assert vertical_m <= vertical_limit_m(flight)


@pytest.mark.skipif(not USE_ALL_FLIGHTS, reason="make nightly replays all flights")
def test_a_take_off_to_the_present_altitude_climbs_if_the_altitude_estimate_drifts_down_on_the_ground(
    reference_data: Path,
) -> None:
    assert reference_data
    flight = Flight.load(GROUND_DRIFT_FLIGHT)
    track, states = fly(flight, with_ground_drift=True)
    assert [each[1:] for each in state_changes(states)] == [each[1:] for each in state_changes(flight.states)]
    for simulated_m, recorded_m, limit_m in zip(
        farthest_point_m(track, GO_TO_S), farthest_point_m(flight.track, GO_TO_S), SPREAD_M, strict=True
    ):
        assert abs(simulated_m - recorded_m) <= limit_m
    _, states = fly(flight)
    assert state_changes(states)[-1][1:] != state_changes(flight.states)[-1][1:], (
        "the vehicle took off also without the drift"
    )


def test_every_named_flight_is_recorded(reference_data: Path) -> None:
    assert reference_data
    assert {VELOCITY_FLIGHT, GROUND_DRIFT_FLIGHT, *QUICK_FLIGHTS} <= set(flight_names())
