"""Recorded ROS 2 dialogues of a real PX4 repeated on the simulated vehicle: answers, states, their times.

A dialogue is compared by all answers that were recorded, the changes of the vehicle's state with their
times, and the list of modes over MAVLink. A difference has to be explained below.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.contract.ros2_dialogues import Player, Scene, compare, load, scenes
from tests.support.ros2_vehicle import Ros2Vehicle
from vehicle_sim.ros2.topics import COMMAND_ACK

GROUPS = (
    "vehicle_command", "service", "timing", "qos", "registration", "requirements", "slots", "timeouts",
    "message_format", "namespace", "inputs",
)  # fmt: skip
SLOWEST_ANSWER_S = 0.036
"""Recorded from 3 to 35 ms."""
EXPLAINED = {
    "burst_20": "Twenty messages arrive at once here; PX4 took two before the last four were left.",
    "burst_of_10": "Ten requests arrive at once here; PX4's client took two before the last one was left.",
    "set_nav_state_bad": "The numbers 31 and 200 name no mode: answered alike, but the mode stays as it is.",
    "executor_activate_immediately": "The first check of the mode runs before its component has answered; "
    "PX4 ran it 10 ms later.",
}


@pytest.fixture(scope="module")
def player() -> Player:
    return Player()


@pytest.mark.parametrize("scene", scenes(load(GROUPS)), ids=lambda scene: scene.dialogue["id"])
def test_a_recorded_dialogue_goes_the_same_way(player: Player, scene: Scene) -> None:
    player.play(scene)
    found = compare(player, scene.dialogue)
    if scene.dialogue["id"] in EXPLAINED:
        assert found, f"{scene.dialogue['id']} is as recorded: take it off EXPLAINED"
    else:
        assert not found


def test_answers_come_as_soon_as_recorded() -> None:
    vehicle = Ros2Vehicle()
    sent_s = vehicle.sim.time_s
    vehicle.command(31999)
    vehicle.run(0.1)
    (at_s,) = [at_s for at_s, topic, _ in vehicle.received if topic == COMMAND_ACK]
    assert at_s - sent_s <= SLOWEST_ANSWER_S


def test_every_explained_dialogue_was_recorded(shared: Path) -> None:
    assert shared
    assert EXPLAINED.keys() <= {dialogue["id"] for dialogue in load(GROUPS)}
