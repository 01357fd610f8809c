"""Recorded ROS 2 dialogues of a real PX4 in flight: external modes flown, lost and replaced, executors,
overrides. Replies and the vehicle's state are compared; times only until the first landing, because its time
depends on the altitude.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.contract.ros2_dialogues import TimedDialogue, compare, dialogue_parameters, load, timed_dialogues
from tests.contract.ros2_flight_dialogues import GROUPS, Ros2FlightPlayer, landed_s

ONE_OF_EACH = frozenset({"x_gone_back", "x_exec", "d2_timeout", "x_repl5", "x_two"})
"""Boots of PX4, one of each group; `make test-clients` repeats all of them."""
SHORTEST = "x_repl5"
"""The boot that `make test` repeats, too."""
IGNORED = frozenset({"pre_flight_checks_pass"})
"""In flight PX4 reports the checks of a failed mode for one cycle of 12 ms, until PX4 has left the mode."""
LOW_RETURN = "The return lands earlier here and is disarmed before the next mode is selected."
EXPLAINED = {
    "lost_rtl_armchk0": LOW_RETURN,
    "lost_rtl": LOW_RETURN,
    "lost_stop": LOW_RETURN,
    "no_auto_disarm": "PX4 was in Hold before the landing of a failsafe; here that landing has begun.",
}

WHOLE = os.environ.get("ALL_DIALOGUES") == "1"
DIALOGUES = [each for each in load(GROUPS) if WHOLE or each["session"] in ONE_OF_EACH]
"""Whole boots, because each dialogue begins in the state that the previous one left."""

pytestmark = pytest.mark.flight


@pytest.fixture(scope="module")
def player() -> Ros2FlightPlayer:
    return Ros2FlightPlayer()


@pytest.mark.parametrize(
    "timed_dialogue", dialogue_parameters(timed_dialogues(DIALOGUES), lambda session: session != SHORTEST)
)
def test_a_replayed_dialogue_in_flight_has_the_recorded_replies_and_states(
    player: Ros2FlightPlayer, timed_dialogue: TimedDialogue
) -> None:
    player.play(timed_dialogue)
    found = compare(
        player, timed_dialogue.dialogue, until_s=landed_s(timed_dialogue.dialogue), ignored=IGNORED
    )
    if timed_dialogue.dialogue["id"] in EXPLAINED:
        assert found, f"{timed_dialogue.dialogue['id']} no longer differs: delete it from EXPLAINED"
    else:
        assert not found


def test_every_explained_dialogue_was_recorded(shared: Path) -> None:
    assert shared
    assert EXPLAINED.keys() <= {dialogue["id"] for dialogue in load(GROUPS)}


def test_each_group_has_a_boot_that_is_always_repeated(shared: Path) -> None:
    assert shared
    for group in GROUPS:
        assert ONE_OF_EACH & {dialogue["session"] for dialogue in load((group,))}, group
