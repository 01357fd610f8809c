"""Replays recorded ROS 2 dialogues of a real PX4 to the simulated vehicle.

The tests compare all recorded replies, the changes of the vehicle's state with their times, and the list of
modes over MAVLink. `EXPLAINED` must explain each difference.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.contract.ros2_dialogues import (
    RECORDINGS_FOLDER,
    Ros2DialoguePlayer,
    TimedDialogue,
    compare,
    dialogue_parameters,
    load_dialogues,
    timed_dialogues,
)
from tests.contract.ros2_flight_dialogues import GROUPS as FLIGHT_GROUPS
from tests.support.ros2_vehicle import Ros2Vehicle
from vehicle_sim.px4_version import V1_16
from vehicle_sim.ros2.topics import COMMAND_ACK

GROUPS = (
    "vehicle_command", "service", "timing", "qos", "registration", "requirements", "slots", "timeouts",
    "message_format", "namespace", "inputs",
)  # fmt: skip
QUICK_BOOTS = frozenset({"ground", "agent", "x_reg", "x_extra", "x_slots", "ns1", "x_inputs"})
"""Boots of PX4 whose dialogues `make test` replays; `make nightly` replays all boots, also those that
wait for lost replies."""
SLOWEST_REPLY_S = 0.036
"""The recorded replies took 3 to 35 ms."""
EXPLAINED = {
    "burst_20": "Twenty messages arrive at once here; PX4 took two before its queue kept only the last four.",
    "burst_of_10": "Ten requests arrive at once here; PX4's client took two before its queue kept the last.",
    "set_nav_state_bad": "31 and 200 are not numbers of a mode: PX4's reply is the same, "
    "but here the mode does not change.",
    "executor_activate_immediately": "The first check of the mode runs before its component has replied; "
    "PX4 ran it 10 ms later.",
}
NOT_REPLAYED = {
    "agent_restart": "There is no agent that could restart; a mode without replies is removed here, too.",
    "agent_late": "There is no agent that could be late: the vehicle publishes when it is connected.",
    "px4_reboot": "The vehicle's process ends and PX4 boots again, as at every boot.",
    "two_vehicles_one_agent": "Two processes, each with its own namespace; the recording sends them nothing.",
}
"""Dialogues about PX4's agent and processes (group `link`)."""


@pytest.fixture(scope="module")
def player() -> Ros2DialoguePlayer:
    return Ros2DialoguePlayer()


@pytest.mark.parametrize(
    "timed_dialogue",
    dialogue_parameters(timed_dialogues(load_dialogues(GROUPS)), lambda session: session not in QUICK_BOOTS),
)
def test_a_replayed_dialogue_has_the_recorded_replies_and_states(
    player: Ros2DialoguePlayer, timed_dialogue: TimedDialogue
) -> None:
    player.play(timed_dialogue)
    found = compare(player, timed_dialogue.dialogue)
    if timed_dialogue.dialogue["id"] in EXPLAINED:
        assert found, f"{timed_dialogue.dialogue['id']} no longer differs: delete it from EXPLAINED"
    else:
        assert not found


def test_the_reply_to_a_command_takes_no_longer_than_the_recorded_replies() -> None:
    vehicle = Ros2Vehicle(px4=V1_16)
    sent_s = vehicle.sim.time_s
    vehicle.command(31999)
    vehicle.run(0.1)
    (received_s,) = [received_s for received_s, topic, _ in vehicle.received_messages if topic == COMMAND_ACK]
    assert received_s - sent_s <= SLOWEST_REPLY_S


def test_every_explained_dialogue_was_recorded(reference_data: Path) -> None:
    assert reference_data
    assert EXPLAINED.keys() <= {dialogue["id"] for dialogue in load_dialogues(GROUPS)}


def test_the_dialogues_that_are_not_replayed_are_exactly_the_listed_ones(reference_data: Path) -> None:
    assert reference_data
    groups = [path.stem for path in RECORDINGS_FOLDER.glob("*.jsonl")]
    not_replayed = [each["id"] for each in load_dialogues(tuple(set(groups) - {*GROUPS, *FLIGHT_GROUPS}))]
    assert sorted(not_replayed) == sorted(NOT_REPLAYED)
