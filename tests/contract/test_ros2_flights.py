"""Flights of a real PX4 commanded over ROS 2, replayed on the topics of the simulated vehicle: setpoints of
the wrong kind, lost streams, setpoints outside Offboard, the published node. The bench compares the others.

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
    fly,
    largest_errors,
    largest_excess,
    late_changes,
)

pytestmark = pytest.mark.flight

RTL, LAND = 5, 18
SPREAD_M = (1.4, 0.8)
"""Largest horizontal and vertical differences between recorded flights with equal setpoints: the node and a
step, three times each, and a hovering vehicle, four times [m]. The simulated vehicle has no noise here."""
LANDING_M = 1.3
"""The same of the height, if the flight has a landing [m]."""
DISARMING_S = 6.0
"""Recorded landings from 5 m took 10.3 to 16.1 s until they were detected."""
ALWAYS = frozenset({"all_nan", "hold_goto_30hz"})
"""Flights that `make test` replays; `make test-clients` replays all of them."""
NOISY: dict[str, tuple[int, ...]] = {
    # the height follows a velocity, so it drifts with the error of the estimated vertical speed
    "loss_ocm_only": (0, 1, 2, 3),
    # the altitude was below the vehicle, so PX4 used the vehicle's own, and climbed when its estimate had
    # descended by 0.2 m on the ground; in one of four simulated flights it does
    "nav_takeoff_7m_relative_wrong": (12, 14, 27),
}
"""Flights that depend on the noise of PX4's sensors, and the seeds that are flown with noise."""
WHOLE = os.environ.get("ALL_DIALOGUES") == "1"


def names() -> list[str]:
    """The flights that neither the bench nor a dialogue compares."""
    index = FOLDER / "index.json"
    flights = json.loads(index.read_text()) if index.exists() else []
    return [
        each["id"] for each in flights if each["id"] not in MANOEUVRES and each["group"] not in IN_DIALOGUES
    ]


def height_limit_m(flight: Flight) -> float:
    """Largest vertical difference of a flight."""
    lands = any(nav_state in (RTL, LAND) for _, nav_state, _ in flight.states)
    return LANDING_M if lands else SPREAD_M[1]


@pytest.mark.parametrize(
    "name", [each for each in names() if each not in NOISY and (WHOLE or each in ALWAYS)]
)
def test_a_replayed_flight_is_within_the_spread_of_the_recorded_ones(name: str) -> None:
    flight = Flight.load(name)
    track, states = fly(flight)
    found = late_changes(states, flight.states, DISARMING_S)
    horizontal_m, vertical_m = largest_errors(track, flight.track)
    if horizontal_m > SPREAD_M[0] or vertical_m > height_limit_m(flight):
        found.append(f"{horizontal_m:.2f} m horizontally, {vertical_m:.2f} m vertically")
    assert not found


@pytest.mark.skipif(not WHOLE, reason="make test-clients replays all flights")
@pytest.mark.parametrize("name", NOISY)
def test_a_flight_that_depends_on_sensor_noise_is_in_the_range_of_simulated_ones(
    name: str, shared: Path
) -> None:
    assert shared
    flight = Flight.load(name)
    flown = [fly(flight, noise=seed) for seed in NOISY[name]]
    assert any(not late_changes(states, flight.states, DISARMING_S) for _, states in flown)
    horizontal_m, vertical_m = largest_excess([track for track, _ in flown], flight.track)
    assert horizontal_m <= SPREAD_M[0]
    assert vertical_m <= height_limit_m(flight)


def test_every_named_flight_is_recorded(shared: Path) -> None:
    assert shared
    assert {*NOISY, *ALWAYS} <= set(names())
