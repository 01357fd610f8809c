"""Tests each rule for differences that the recording caused, at its bound."""

import functools
import json
import struct
from pathlib import Path
from typing import Any

from tests.contract import rules
from tests.contract.recordings import STREAMED_TO_THE_END, mission_of_200_items, with_all_items
from tests.contract.replay_vehicle import Received
from tests.contract.unrecorded_states import RECEPTION_DELAY_S, UNRECORDED_STATES
from vehicle_sim.mavlink.services.mission import add_to_id


def statustext(dt_s: float, text: str) -> Received:
    return Received(dt_s, "STATUSTEXT", {"text": text, "severity": 6})


def text_of(message: Received) -> str:
    return message.values["text"]


def command_to_itself(dt_s: float, confirmation: int, component: int = 0) -> Received:
    values = {"command": 2003, "confirmation": confirmation, "target_component": component}
    return Received(dt_s, "COMMAND_LONG", values)


def test_repeats_of_a_command_sent_before_the_dialogue_are_ignored() -> None:
    too_early = [command_to_itself(0.9, 1), command_to_itself(1.4, 2), command_to_itself(1.9, 3)]
    in_time = [command_to_itself(1.0, 1), command_to_itself(1.5, 2), command_to_itself(2.0, 3)]
    others = [command_to_itself(0.1, 0), command_to_itself(0.1, 4), command_to_itself(0.1, 1, component=154)]
    assert rules.without_earlier_repeats(too_early + in_time + others) == in_time + others


def test_only_the_first_and_last_messages_of_a_long_burst_are_compared() -> None:
    simulated = [statustext(float(n), str(n)) for n in range(9)]
    compared = rules.first_and_last(simulated, "burst; only the first 2 and last 3 messages are kept")
    assert [text_of(m) for m in compared] == ["0", "1", "6", "7", "8"]
    assert (
        rules.first_and_last(simulated, "all of them") == rules.first_and_last(simulated, None) == simulated
    )
    assert (
        rules.first_and_last(simulated[:4], "only the first 2 and last 3 messages are kept") == simulated[:4]
    )


def test_messages_may_change_places_within_a_tenth_of_a_second() -> None:
    missing, extra = (
        [statustext(1.0, "a"), statustext(1.0, "b"), statustext(1.0, "c")],
        [statustext(1.09, "a"), statustext(1.2, "b")],
    )
    pairs = rules.swapped_pairs(missing, extra, text_of)
    assert [(real.values["text"], sim.dt_s) for real, sim in pairs] == [("a", 1.09)]
    assert [text_of(m) for m in missing] == ["b", "c"]
    assert [text_of(m) for m in extra] == ["b"]


def test_frequent_messages_are_compared_by_their_number() -> None:
    real = [statustext(0.1 * n, "often") for n in range(30)] + [statustext(1.0, "once")]
    sim = real[:28]
    recorded, simulated, different_counts = rules.compare_frequent(real, sim, text_of)
    assert ([text_of(m) for m in recorded], simulated, different_counts) == (["once"], [], [])
    assert rules.compare_frequent(real, real[:26], text_of)[2] == [("often", 30, 26)]
    rare = [statustext(0.1 * n, "eight") for n in range(8)]
    assert rules.compare_frequent(rare, rare[:7], text_of)[:2] == (rare, rare[:7])


def test_only_messages_near_the_end_may_be_missing_in_the_recording() -> None:
    simulated = [
        statustext(1.6, "a"),
        statustext(1.8, "b"),
        statustext(1.8, "c"),
        Received(1.9, "COMMAND_ACK", {"command": 400}),
    ]
    compared = rules.without_last_moment(simulated, [statustext(1.8, "c")], 2.0)
    assert [m.values.get("text", "ack") for m in compared] == ["a", "c", "ack"]


def test_only_the_altitudes_of_a_return_may_differ() -> None:
    sample_text = "RTL: start return at 530 m (30 m above destination)\t"
    assert rules.without_altitudes(sample_text) == "RTL: start return at … m (… m above destination)\t"
    assert rules.altitudes_in(sample_text) == [530.0, 30.0]
    other_text = "Climb to 10.0 meters above home"
    assert (rules.without_altitudes(other_text), rules.altitudes_in(other_text)) == (other_text, [])
    assert rules.return_altitudes(list(struct.pack("<ii", 530, -3)) + [0] * 32) == [530.0, -3.0]


def hash_row(real: int, sim: int) -> rules.Row:
    return ("PARAM_VALUE", "[_HASH_CHECK].param_value", real, sim)


def test_the_parameter_hash_changes_and_reverts_when_that_of_px4_does() -> None:
    hashes = rules.ParameterHashes()
    assert not hashes.without_hashes([hash_row(1, 10), hash_row(2, 20), hash_row(1, 10)])
    assert hashes.without_hashes([hash_row(1, 20)]), (
        "accepted although only PX4's hash returned to its earlier value"
    )
    assert hashes.without_hashes([hash_row(3, 20)]), "accepted although only PX4's hash changed"
    other_row = ("PARAM_VALUE", "[MPC_XY_CRUISE].param_value", 1, 10)
    assert hashes.without_hashes([other_row]) == [other_row]


def test_the_entries_of_a_directory_may_have_any_order() -> None:
    def entries(data: bytes, offset: int = 0) -> list[str]:
        return rules.listed_entries({"offset": offset}, data.hex())

    assert entries(b"Dlog\0S\0Fa\t1\0") == entries(b"S\0Fa\t1\0Dlog\0")
    assert entries(b"Dlog\0S\0") != entries(b"Dlog\0")
    assert entries(b"Fa\t1\0") != entries(b"Fa\t2\0")
    assert entries(b"Fa\t1\0S\0", 5) == entries(b"S\0Dlog\0", 5) != entries(b"S\0", 5)


def test_the_upload_of_200_items_has_px4s_checksum() -> None:
    items: list[dict[str, Any]] = [item | {"param4": float("nan")} for item in mission_of_200_items()]
    assert functools.reduce(add_to_id, items, 0) == 2898809883


def test_each_unrecorded_starting_state_has_evidence_and_named_dialogues_exist(reference_data: Path) -> None:
    dialogues: dict[str, dict[str, Any]] = {}
    for path in (reference_data / "px4" / "dialogues").glob("*.jsonl"):
        lines = path.read_text(encoding="utf-8").splitlines()
        dialogues |= {each["id"]: each for each in map(json.loads, lines)}
    without_evidence = [
        name for name, state in UNRECORDED_STATES.items() if state.evidence not in json.dumps(dialogues[name])
    ]
    assert not without_evidence
    assert {name for name, _ in RECEPTION_DELAY_S} | STREAMED_TO_THE_END <= dialogues.keys()
    complete_dialogue = with_all_items(dialogues["mission_upload_200_items"])
    recorded_items = {
        entry["fields"]["seq"]: entry["fields"] for entry in dialogues["mission_upload_200_items"]["send"][1:]
    }
    all_items = {e["fields"]["seq"]: e["fields"] for e in complete_dialogue["send"][1:]}
    assert len(all_items) == 200
    for seq, fields in recorded_items.items():
        assert fields.items() <= {**all_items[seq], "target_system": fields["target_system"]}.items()
