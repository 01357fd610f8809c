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
from tests.contract.ros2_flights import FOLDER, Flight, fly, largest_errors, late_changes

pytestmark = pytest.mark.flight

LAND = 18
SPREAD_M = (1.4, 0.8)
"""Largest horizontal and vertical differences between recorded flights with equal setpoints: the node and a
step, three times each, and a hovering vehicle, four times [m]. The simulated vehicle has no noise here."""
LANDING_M = 1.3
"""The same of the height, if the flight has a landing [m]."""
DISARMING_S = 6.0
"""Recorded landings from 5 m took 10.3 to 16.1 s until they were detected."""
ALWAYS = frozenset({"all_nan", "hold_goto_30hz"})
"""Flights that `make test` replays; `make test-clients` replays all of them."""
EXPLAINED = {
    "loss_ocm_only": "Which setpoints PX4's mode overwrites depends on the delays of their delivery: 3.6 m "
    "down here, 4.2 m there.",
    "nav_takeoff_7m_relative_wrong": "The altitude was below the vehicle, so PX4 used the vehicle's own. "
    "PX4's estimate then descended by 0.3 m on the ground, more than the 0.2 m that start a take-off; the "
    "simulated estimate drifts less, so the vehicle stays there and is disarmed.",
    "att_thrust_positive_z": "PX4's vehicle was still flying back, from 1.1 m north, when the flight began.",
}
WHOLE = os.environ.get("ALL_DIALOGUES") == "1"


def names() -> list[str]:
    """The flights that neither the bench nor a dialogue compares."""
    index = FOLDER / "index.json"
    flights = json.loads(index.read_text()) if index.exists() else []
    return [
        each["id"] for each in flights if each["id"] not in MANOEUVRES and each["group"] not in IN_DIALOGUES
    ]


@pytest.mark.parametrize("name", [each for each in names() if WHOLE or each in ALWAYS])
def test_a_replayed_flight_is_within_the_spread_of_the_recorded_ones(name: str) -> None:
    flight = Flight.load(name)
    track, states = fly(flight)
    found = late_changes(states, flight.states, DISARMING_S)
    horizontal_m, vertical_m = largest_errors(track, flight.track)
    lands = any(nav_state == LAND for _, nav_state, _ in flight.states)
    if horizontal_m > SPREAD_M[0] or vertical_m > (LANDING_M if lands else SPREAD_M[1]):
        found.append(f"{horizontal_m:.2f} m horizontally, {vertical_m:.2f} m vertically")
    if name in EXPLAINED:
        assert found, f"{name} no longer differs: delete it from EXPLAINED"
    else:
        assert not found


def test_every_explained_flight_is_replayed(shared: Path) -> None:
    assert shared
    assert {*EXPLAINED, *ALWAYS} <= set(names())
