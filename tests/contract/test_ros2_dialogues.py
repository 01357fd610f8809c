"""Recorded ROS 2 dialogues of a real PX4 repeated on the simulated vehicle: answers, states, their times.

A dialogue is compared by the answers to commands and by the changes of arming, mode and failsafe that were
recorded; a difference has to be explained below.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.support.ros2_vehicle import TYPES, Ros2Vehicle
from vehicle_sim.ros2.topics import COMMAND_ACK, SERVICE_REQUEST

RECORDED = Path(__file__).resolve().parents[3] / "shared" / "px4" / "dds" / "dialogues"
GROUPS = ("vehicle_command", "service")
SLOWEST_ANSWER_S = 0.036
"""Recorded from 3 to 35 ms."""
COMPARED = {
    "/fmu/out/vehicle_status_v1": ("arming_state", "nav_state", "nav_state_user_intention", "failsafe"),
    "/fmu/out/failsafe_flags": ("offboard_control_signal_lost", "manual_control_signal_lost"),
}
EXPLAINED = {
    "burst_20": "Twenty messages arrive at once here; PX4 took two before the last four were left.",
    "mavlink_command_seen": "Sent over MAVLink, which tests/contract/test_every_dialogue.py covers.",
    "set_nav_state_bad": "The numbers 31 and 200 name no mode: answered alike, but the mode stays as it is.",
}


def _dialogues() -> Iterator[dict[str, Any]]:
    for group in GROUPS:
        path = RECORDED / f"{group}.jsonl"
        if path.exists():
            yield from (json.loads(line) for line in path.read_text().splitlines())


def _fields(fields: dict[str, Any]) -> dict[str, Any]:
    """As numbers; null is NaN."""
    return {k: math.nan if v is None else 0 if v == "now" else v for k, v in fields.items()}


def _topic(name: str) -> str:
    return SERVICE_REQUEST if name.endswith("vehicle_commandRequest") else name


def _play(vehicle: Ros2Vehicle, dialogue: dict[str, Any]) -> None:
    sends = sorted(_events(dialogue), key=lambda event: event[0])
    began_s = vehicle.sim.time_s
    for at_s, topic, fields in sends:
        vehicle.run(max(0.0, began_s + at_s - vehicle.sim.time_s))
        vehicle.send(topic, fields)
    compared = {COMMAND_ACK, *COMPARED}
    last_s = max(
        [each["dt_s"] for each in dialogue["received"] if each.get("topic") in compared], default=0.0
    )
    vehicle.run(max(0.0, began_s + last_s - vehicle.sim.time_s) + 0.5)


def _events(dialogue: dict[str, Any]) -> Iterator[tuple[float, str, dict[str, Any]]]:
    for sent in dialogue["send"]:
        topic = _topic(sent["topic"])
        if topic not in TYPES:
            continue
        for n in range(sent.get("count", 1)):
            yield sent["dt_s"] + n / sent.get("streamed_hz", 1), topic, _fields(sent["fields"])


def _answers_recorded(dialogue: dict[str, Any]) -> list[tuple[int, int, int, int]]:
    return [_answer(each["fields"]) for each in dialogue["received"] if each.get("topic") == COMMAND_ACK]


def _answer(ack: dict[str, Any]) -> tuple[int, int, int, int]:
    return ack["command"], ack["result"], ack["target_system"], ack["target_component"]


def _changes_recorded(dialogue: dict[str, Any], topic: str, name: str) -> list[Any]:
    here = [each.get("changed", {}) for each in dialogue["received"] if each.get("topic") == topic]
    return [change[name][1] for change in here if name in change]


def _changes(vehicle: Ros2Vehicle, topic: str, name: str, since_s: float) -> list[Any]:
    before = [f[name] for at_s, t, f in vehicle.received if t == topic and at_s <= since_s][-1:]
    values = before + [f[name] for f in vehicle.all(topic, since_s)]
    return [new for old, new in itertools.pairwise(values) if new != old]


@pytest.fixture(scope="module")
def vehicle() -> Ros2Vehicle:
    return Ros2Vehicle()


@pytest.mark.parametrize("dialogue", list(_dialogues()), ids=lambda dialogue: dialogue["id"])
def test_a_recorded_dialogue_goes_the_same_way(vehicle, dialogue):
    vehicle.run(0.5)
    began_s = vehicle.sim.time_s
    _play(vehicle, dialogue)
    answers = [_answer(ack) for ack in vehicle.all(COMMAND_ACK, began_s)]
    recorded = _answers_recorded(dialogue)
    changes = {
        (topic, name): (_changes(vehicle, topic, name, began_s), _changes_recorded(dialogue, topic, name))
        for topic, names in COMPARED.items()
        for name in names
    }
    differs = answers != recorded or any(ours != theirs for ours, theirs in changes.values())
    if dialogue["id"] in EXPLAINED:
        assert differs, f"{dialogue['id']} is as recorded: take it off EXPLAINED"
        return
    assert answers == recorded
    for key, (ours, theirs) in changes.items():
        assert ours == theirs, key


def test_answers_come_as_soon_as_recorded(vehicle):
    vehicle.run(1.0)
    sent_s = vehicle.sim.time_s
    vehicle.command(31999)
    vehicle.run(0.1)
    (at_s,) = [at_s for at_s, topic, _ in vehicle.received if topic == COMMAND_ACK and at_s > sent_s]
    assert at_s - sent_s <= SLOWEST_ANSWER_S


def test_every_explained_dialogue_was_recorded(shared: Path) -> None:
    assert shared
    assert EXPLAINED.keys() <= {dialogue["id"] for dialogue in _dialogues()}
