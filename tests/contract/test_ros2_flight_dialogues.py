"""Replays recorded ROS 2 dialogues of a real PX4 in flight, with external modes, executors and overrides.

The tests compare replies and states. They compare times only until the first landing, whose time depends on
the altitude.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.contract.ros2_dialogues import (
    TimedDialogue,
    compare,
    dialogue_parameters,
    load_dialogues,
    timed_dialogues,
)
from tests.contract.ros2_flight_dialogues import GROUPS, Ros2FlightPlayer, first_landing_s

ONE_BOOT_PER_GROUP = frozenset({"x_gone_back", "x_exec", "d2_timeout", "x_repl5", "x_two"})
"""One boot of PX4 for each group; with ALL_DIALOGUES=1 all boots are replayed."""
SHORTEST_BOOT = "x_repl5"
"""The only boot that `make test` replays."""
IGNORED = frozenset({"pre_flight_checks_pass"})
"""When a mode fails, PX4 reports its failed checks for one more cycle (12 ms), the simulator does not."""
EARLIER_LANDING = "The returning simulated vehicle lands and disarms before the next mode is selected."
EXPLAINED = {
    "lost_rtl_armchk0": EARLIER_LANDING,
    "lost_rtl": EARLIER_LANDING,
    "lost_stop": EARLIER_LANDING,
    "no_auto_disarm": "PX4 was in Hold before its failsafe landed it; the simulated one lands already.",
}

USE_ALL_BOOTS = os.environ.get("ALL_DIALOGUES") == "1"
DIALOGUES = [
    each for each in load_dialogues(GROUPS) if USE_ALL_BOOTS or each["session"] in ONE_BOOT_PER_GROUP
]
"""Whole boots, because each dialogue begins in the state in which the previous one ended."""

pytestmark = pytest.mark.flight


@pytest.fixture(scope="module")
def player() -> Ros2FlightPlayer:
    return Ros2FlightPlayer()


@pytest.mark.parametrize(
    "timed_dialogue",
    dialogue_parameters(timed_dialogues(DIALOGUES), lambda session: session != SHORTEST_BOOT),
)
def test_a_replayed_dialogue_in_flight_has_the_recorded_replies_and_states(
    player: Ros2FlightPlayer, timed_dialogue: TimedDialogue
) -> None:
    player.play(timed_dialogue)
    found = compare(
        player, timed_dialogue.dialogue, until_s=first_landing_s(timed_dialogue.dialogue), ignored=IGNORED
    )
    if timed_dialogue.dialogue["id"] in EXPLAINED:
        assert found, f"{timed_dialogue.dialogue['id']} no longer differs: delete it from EXPLAINED"
    else:
        assert not found


def test_every_explained_dialogue_was_recorded(reference_data: Path) -> None:
    assert reference_data
    assert EXPLAINED.keys() <= {dialogue["id"] for dialogue in load_dialogues(GROUPS)}


def test_the_replayed_boots_include_one_of_each_group(reference_data: Path) -> None:
    assert reference_data
    for group in GROUPS:
        assert ONE_BOOT_PER_GROUP & {dialogue["session"] for dialogue in load_dialogues((group,))}, group
