"""Replays recorded ROS 2 dialogues of a real PX4 v1.17 to the simulated one.

They are those of a vehicle on the ground, in the order of their boot; `explained_1_17.tsv` has the rest. The
flights of these boots are recorded in part only: `test_ros2_px4_1_17_flights.py` flies them again.
"""

from __future__ import annotations

import dataclasses
import json

import pytest

from tests.contract.explained import rows_of_1_17
from tests.contract.ros2_dialogues import (
    CHECK_REPLY,
    CHECK_REQUEST,
    Dialogue,
    Ros2DialoguePlayer,
    TimedDialogue,
    compare,
    dialogue_parameters,
    recorded_masks,
    timed_dialogues,
    with_present_names,
)
from tests.support.dds_recordings import FOLDERS
from vehicle_sim.external_modes.slots import FIRST_MODE
from vehicle_sim.px4_version import V1_17

ON_THE_GROUND = (
    "all_topics", "suffix_names", "protocol_2", "service", "arm", "disarm", "unknown",
    "set_nav_state_alt_cruise", "do_set_mode_alt_cruise", "set_nav_state_hold", "set_nav_state_200",
    "set_mode_hold", "register_reply_v1_17", "select_arm_disarm", "unregister", "old_client_old_name",
    "old_client_select", "old_layout_new_name", "old_layout_new_name_arm", "unregister2",
    "three_registrations", "one_goes_silent", "executor_register", "executor_arm", "api_version_2",
    "replace_rtl", "replace_rtl_select", "activate_immediately", "reply_timestamp_0", "reply_timestamp_now",
    "reply_timestamp_0.2_s_old", "reply_timestamp_0.5_s_old", "reply_timestamp_5_s_old",
    "reply_timestamp_1_h_ahead", "other_inputs", "overrides",
)  # fmt: skip
"""The dialogues in recorded order: those of `x_main`, `x_mode` and `x_more`."""
IN_FLIGHT = frozenset(
    {"offboard_flight", "hold", "land", "attitude_right", "attitude_old_name", "attitude_old_layout_new_name",
     "mode_flight", "replies_stop_in_flight", "replies_return", "takeoff", "levels", "offboard_lost", "end",
     "goto_in_hold"}
)  # fmt: skip


def load_dialogues() -> list[Dialogue]:
    """All recorded dialogues of v1.17, in the form of those of v1.16."""
    paths = sorted((FOLDERS["1.17"] / "dialogues").glob("*.jsonl"))
    lines = [line for path in paths for line in path.read_text(encoding="utf-8").splitlines()]
    return [with_present_names(json.loads(line), V1_17) for line in lines]


DIALOGUES = load_dialogues()
BEFORE_A_FLIGHT = frozenset({"select_arm_disarm", "old_layout_new_name_arm"})
"""Dialogues after which the components went on answering in a part that is not replayed."""
STAMP_MODE_REGISTERED = "Stamp Mode registered"
BY_ID = {each["id"]: each for each in DIALOGUES}
GROUND = [BY_ID[name] for name in ON_THE_GROUND if name in BY_ID]


TIMED = [
    dataclasses.replace(each, replies_continue=True) if each.dialogue["id"] in BEFORE_A_FLIGHT else each
    for each in timed_dialogues(GROUND)
]


class Player(Ros2DialoguePlayer):
    """Plays dialogues of v1.17; before those about the time of replies it registers their mode."""

    def __init__(self) -> None:
        super().__init__(V1_17)
        self._registered: list[tuple[int, str]] = []

    def _prepare(self, dialogue: Dialogue) -> None:
        if dialogue["precondition"] != STAMP_MODE_REGISTERED:
            return
        while self._registered:
            self._unregister(*self._registered.pop())
        checks = [each["fields"].get("registration_id", 0) for each in dialogue["send"] if "count" in each]
        valid = recorded_masks(dialogue)[0]
        for check in range(checks[0] + 1):
            name = f"Mode {check}"
            request = {"name": name, "register_arming_check": True, "register_mode": True}
            self.vehicle.send("/fmu/in/register_ext_component_request", request)
            self._run(0.1)
            self.vehicle.send("/fmu/in/config_control_setpoints", {"source_id": FIRST_MODE + check})
            self._registered.append((check, name))
        for check, name in self._registered[:]:
            if not valid >> check & 1:
                self._unregister(check, name)
                self._registered.remove((check, name))
        self._reply_for(0.4, [check for check, _ in self._registered])
        self._reply_for(0.6, checks[:1])

    def _unregister(self, check: int, name: str) -> None:
        fields = {"name": name, "arming_check_id": check, "mode_id": FIRST_MODE + check}
        self.vehicle.send("/fmu/in/unregister_ext_component", fields | {"mode_executor_id": -1})
        self._run(0.1)

    def _reply_for(self, seconds: float, checks: list[int]) -> None:
        end_s = self.vehicle.sim.time_s + seconds
        while self.vehicle.sim.time_s < end_s:
            read_count = len(self.vehicle.received_messages)
            self._run(0.02)
            for _, topic, fields in self.vehicle.received_messages[read_count:]:
                for check in checks if topic == CHECK_REQUEST else ():
                    reply = {"request_id": fields["request_id"], "registration_id": check}
                    self.vehicle.send(CHECK_REPLY, reply, can_arm_and_run=True)


@pytest.fixture(scope="module")
def player() -> Player:
    return Player()


@pytest.mark.parametrize("timed_dialogue", dialogue_parameters(TIMED, lambda _: False))
def test_a_dialogue_of_v1_17_has_the_recorded_replies_and_states(
    player: Player, timed_dialogue: TimedDialogue
) -> None:
    player.play(timed_dialogue)
    found = compare(player, timed_dialogue.dialogue)
    row = f"ros2:{timed_dialogue.dialogue['id']}"
    if row in rows_of_1_17():
        assert found, f"{row} no longer differs: delete it from explained_1_17.tsv"
    else:
        assert not found


def test_every_recorded_dialogue_is_replayed_or_flown() -> None:
    if not DIALOGUES:
        pytest.skip("the ROS 2 recordings of PX4 v1.17 are not beside this checkout")
    assert {each["id"] for each in DIALOGUES} == {*ON_THE_GROUND, *IN_FLIGHT}
    rows = {row.removeprefix("ros2:") for row in rows_of_1_17() if row.startswith("ros2:")}
    assert rows <= set(ON_THE_GROUND)
